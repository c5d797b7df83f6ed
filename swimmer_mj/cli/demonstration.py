"""``demo``: all of it once, in about two minutes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swimmer_mj.cli.options import check_directory, check_seed
from swimmer_mj.cli.output import (
    CheckFailedError,
    make_console,
    print_checks,
    print_evaluation,
    print_json,
    print_line,
    status,
)
from swimmer_mj.cli.pictures import Backend, render_run
from swimmer_mj.cli.runs import free_directory
from swimmer_mj.cli.shots import places_in
from swimmer_mj.cli.training import train_runs
from swimmer_mj.cli.webpage import write_policy_page

if TYPE_CHECKING:
    from swimmer_mj.learning.runs.config import RunConfig

__all__ = ["DEMO_SECONDS", "DEMO_SPEED", "demo"]

DEMO_SPEED = 2.0
"""The demo trains until its swimmer is this fast, m/s; the best open-loop wave makes 0.61."""
DEMO_SECONDS = 45.0
"""Or for this long, s."""


def demo(
    seed: int = 0, out: Path = Path("runs/demo"), backend: Backend | None = None, json: bool = False
) -> None:
    """Check the physics, teach the paper's swimmer to swim, evaluate it on MuJoCo, draw it, and make it a web page.

    Args:
        seed: Of the two learners that are trained side by side: of value gradients, and the paper's.
        out: Run directory; a number is added if it is taken.
        backend: OpenGL backend; by default the one that MUJOCO_GL names, else OSMesa, or EGL without it.
        json: Print one JSON object.
    """
    check_seed(seed)
    check_directory(out)

    from swimmer_mj.render.backend import use_backend

    started = time.perf_counter()
    # Before MuJoCo is imported, and before minutes of training: what cannot be drawn says so now
    use_backend(backend)

    from swimmer_mj.learning.runs.config import RunConfig, value_gradient_config
    from swimmer_mj.learning.runs.evaluation import evaluate_run
    from swimmer_mj.learning.runs.run import LOG, TrainingRun, load_policy
    from swimmer_mj.learning.td.method import ETA
    from swimmer_mj.validation import physics_report

    console = make_console(json)
    console.rule("1. Physics: A.3 against MuJoCo")
    checks = physics_report()
    print_checks(console, checks)
    if failed := [check.to_json() for check in checks if not check.passed]:
        if json:
            print_json({"passed": False, "checks": failed})
        raise CheckFailedError

    console.rule("2. Learning: value gradients and the paper's TD(λ), a core each")
    out = free_directory(out)
    best = TrainingRun(out / "value-gradient", value_gradient_config(seed))
    paper = TrainingRun(out / "td", RunConfig(seed=seed))
    with status(console, "compiling"):
        _compile([best.config, paper.config])
    training = time.perf_counter()
    train_runs(console, [best, paper], seconds=DEMO_SECONDS, enough=lambda run: run.best_speed >= DEMO_SPEED)
    training = time.perf_counter() - training
    if not best.history:
        raise ValueError(
            f"{DEMO_SECONDS:.0f} s were not enough for one evaluation on this machine; use train instead"
        )

    console.rule("3. Evaluation: dm_control on MuJoCo, 64 episodes of 60 s")
    result = evaluate_run(best.directory, "best", episodes=64)
    print_evaluation(console, result)

    console.rule("4. Pictures")
    eta = f"η = {ETA}"
    beside = [(f"TD(λ), {eta}", paper.directory / LOG)] if paper.history else []
    pictures = render_run(best.directory, places_in(best.directory), beside=beside)
    for path in pictures.values():
        print_line(console, f"  {path}")
    html = best.directory / "swim.html"
    speed = result["speed_mean"], result["speed_ci95"]
    write_policy_page(html, best.directory, *load_policy(best.directory)[:2], speed)
    console.print(
        f"\nIt swims at [bold]{result['speed_mean']:.2f} m/s[/bold] after {training:.0f} s of learning with value "
        f"gradients (docs/beyond.md); the best open-loop wave makes 0.61 m/s. The paper's method, which took a week in "
        f"2002, came to {max(paper.best_speed, 0.0):.2f} m/s in the same {training:.0f} s, with {eta} in place of "
        f"0.01; give it minutes with swimmer-mj train. The demo took {time.perf_counter() - started:.0f} s in all."
    )
    print_line(console, f"Steer it, in a browser: {html}")
    if json:
        print_json(
            {
                "run": str(best.directory),
                "seconds": time.perf_counter() - started,
                "training_seconds": training,
                "td_speed": max(paper.best_speed, 0.0),
                **result,
                "pictures": {name: str(path) for name, path in pictures.items()},
                "page": str(html),
            }
        )


def _compile(configs: Sequence[RunConfig]) -> None:
    """Have numba compile what runs of ``configs`` need, by a little work whose result is dropped."""
    import numpy as np

    from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME

    for config in configs:
        learning = config.method.start(config.problem, config.seed)
        learning.learn(1)
        states = config.problem.initial_states(np.random.default_rng(0), 1)
        learning.judge(states)
        learning.rewards(states, EPISODE_DURATION, SETTLING_TIME)
