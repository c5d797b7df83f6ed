"""Command line: ``swimmer-mj``, also ``python -m swimmer_mj``.

Every command imports what it needs when it runs. With ``--json`` a command prints one JSON object on standard output
and nothing else there. Exit status: 0 done, 1 a check failed, 2 bad usage or bad input (one line on standard error).
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import json as json_module
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro
from tyro.conf import FlagCreatePairsOff, Positional

if TYPE_CHECKING:
    from rich.console import Console

    from swimmer_mj.learning.trainer import Report, TrainConfig, TrainingRun

__all__ = ["main"]

_DESCRIPTION = "The swimmer of Coulom (2002) and the learner that makes it swim."

_app = tyro.extras.SubcommandApp()


def _command(function: Callable[..., None]) -> Callable[..., None]:
    """Make ``function`` a subcommand. Parsing returns the call, which :func:`main` then makes."""

    @functools.wraps(function)
    def parsed(*args: Any, **kwargs: Any) -> Any:
        return functools.partial(function, *args, **kwargs)

    _app.command(parsed)
    return function


DEMO_SPEED = 2.0
"""The demo trains until its swimmer is this fast, m/s; the best open-loop wave makes 0.54."""
DEMO_SECONDS = 45.0
"""Or for this long, s."""

Backend = Literal["osmesa", "egl", "glfw", "cgl"]


class CheckFailedError(Exception):
    """A check failed: exit status 1. Its message has been printed."""


# Commands --------------------------------------------------------------------------------------------------------


@_command
def demo(
    seed: int = 0, out: Path = Path("runs/demo"), backend: Backend | None = None, json: bool = False
) -> None:
    """Check the physics, teach the paper's swimmer to swim, evaluate it on MuJoCo, and draw it.

    Args:
        seed: Of the two learners that are trained side by side: of value gradients, and the paper's.
        out: Run directory; a number is added if it is taken.
        backend: OpenGL backend; OSMesa by default.
        json: Print one JSON object.
    """
    from swimmer_mj.render.backend import use_backend

    started = time.perf_counter()
    use_backend(
        backend
    )  # before MuJoCo is imported, and before minutes of training: what cannot be drawn says so now

    from swimmer_mj.learning.trainer import LOG, TrainConfig, TrainingRun, value_gradient_config
    from swimmer_mj.validation import physics_report

    console = _console(json)
    console.rule("1. Physics: A.3 against MuJoCo")
    checks = physics_report()
    _print_checks(console, checks)
    if not all(check.passed for check in checks):
        raise CheckFailedError

    console.rule("2. Learning: the value gradient, and beside it the paper's TD(λ), each on a core")
    out = _free_directory(out)
    best = TrainingRun(out / "value-gradient", value_gradient_config(seed))
    paper = TrainingRun(out / "td", TrainConfig(seed=seed))
    with console.status("compiling"):
        _compile([best.config, paper.config])
    training = time.perf_counter()
    _train(console, [best, paper], seconds=DEMO_SECONDS, enough=lambda run: run.best_speed >= DEMO_SPEED)
    training = time.perf_counter() - training
    if not best.history:
        raise ValueError(
            f"{DEMO_SECONDS:.0f} s were not enough for one evaluation on this machine; use train instead"
        )

    console.rule("3. Evaluation: dm_control on MuJoCo, 64 episodes of 20 s")
    result = _evaluate_run(best.directory, "best", episodes=64)
    _print_evaluation(console, result)

    console.rule("4. Pictures")
    beside = [("TD(λ), the paper's", paper.directory / LOG)] if paper.history else []
    pictures = _render_run(best.directory, best.directory, duration=13.0, fps=30, beside=beside)
    for path in pictures.values():
        console.print(f"  {path}")
    console.print(
        f"\nIt swims at [bold]{result['speed_mean']:.2f} m/s[/bold] after {training:.0f} s of learning with value "
        f"gradients (docs/beyond.md); the best open-loop wave makes 0.54 m/s. The paper's method, which took a week in "
        f"2002, came to {max(paper.best_speed, 0.0):.2f} m/s in the same {training:.0f} s; give it minutes with "
        f"swimmer-mj train. The demo took {time.perf_counter() - started:.0f} s in all."
    )
    if json:
        _print_json(
            {
                "run": str(best.directory),
                "seconds": time.perf_counter() - started,
                "training_seconds": training,
                "td_speed": max(paper.best_speed, 0.0),
                "trials": best.trial,
                **result,
                "pictures": {name: str(path) for name, path in pictures.items()},
            }
        )


@_command
def train(
    out: Path,
    method: Literal["td", "value-gradient"] = "td",
    seed: int = 0,
    seeds: str | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    links: int = 5,
    resume: bool = False,
    problem: Literal["swim", "pendulum"] = "swim",
    physics: Literal["analytic", "mujoco"] = "analytic",
    engine: Literal["fused", "population", "torch"] | None = None,
    neurons: int | None = None,
    eta: float | None = None,
    s_gamma: float | None = None,
    s_lambda: float = 1.0,
    vario_eta: bool = False,
    dtype: Literal["float32", "float64"] = "float32",
    evaluate_every: int | None = None,
    json: bool = False,
) -> None:
    """Train one learner, or one for each of several seeds, and keep the run in a directory.

    Args:
        out: Run directory. Several seeds have out/seed-0 and so on.
        method: td is the paper's continuous TD(lambda); value-gradient learns dV/dx as well, and is much faster.
        seed: Seed of initial weights and initial states.
        seeds: Several seeds instead, trained side by side: 0-7, or 1,4,9.
        trials: Stop at the first evaluation with at least this many trials.
        seconds: Stop after this many seconds. The default is 100,000 trials.
        links: Number of links.
        resume: Go on with the run that is in the directory, as it was configured.
        problem: What to learn.
        physics: Step the equations themselves, or the dm_control environment on MuJoCo (slower).
        engine: One compiled learner at a time, up to 16 of them in the lanes of a processor's vectors, or the readable
            reference in torch (slow). The default is population for more than 4 seeds, then the faster, else fused.
        neurons: Neurons of the cascade, the output counted; 60 by default for td, as in the paper. Without it,
            value-gradient has two layers of 64.
        eta: Learning rate of td; 0.04 by default (paper: 0.01, which takes ten times the trials).
        s_gamma: Shortness factor, 1/s; 1 by default for td, 0.5 for value-gradient.
        s_lambda: Decay of eligibility besides s_gamma, 1/s.
        vario_eta: Adapt the rate of each weight by vario-eta, instead of scaling the output unit's.
        dtype: Floating-point type of the network.
        evaluate_every: Trials, of 5 s of simulated time, between evaluations; 2,000 by default for td, else 1,000.
        json: Print one JSON object.
    """
    if seeds is not None and seed != 0:
        raise ValueError(f"give --seed or --seeds, not both (got {seed} and {seeds})")
    for name, value in (("--trials", trials), ("--seconds", seconds)):
        if value is not None and not value > 0:
            raise ValueError(f"{name} must be positive, got {value}")
    chosen = [seed] if seeds is None else _parse_seeds(seeds)

    if method == "value-gradient" and (eta is not None or vario_eta):
        raise ValueError(f"--{'vario-eta' if vario_eta else 'eta'} is for --method td")

    from swimmer_mj.learning.continuous_td import TDSettings
    from swimmer_mj.learning.trainer import TrainConfig, TrainingRun, value_gradient_config
    from swimmer_mj.learning.vario_eta import VarioEta
    from swimmer_mj.parameters import SwimmerParameters

    td = TDSettings(
        eta=0.04 if eta is None else eta,
        s_lambda=s_lambda,
        output_scaling=not vario_eta,
        vario=VarioEta() if vario_eta else None,
    )
    config = TrainConfig() if method == "td" else value_gradient_config(s_lambda=s_lambda)
    given = {"neurons": neurons, "s_gamma": s_gamma, "evaluate_every": evaluate_every}
    if neurons is not None:
        given["layers"] = None
    config = dataclasses.replace(
        config,
        problem=problem,
        parameters=SwimmerParameters(n_links=links),
        td=td,
        dtype=dtype,
        engine=engine
        or ("population" if len(chosen) > 4 and physics == "analytic" and method == "td" else "fused"),
        physics=physics,
        **{name: value for name, value in given.items() if value is not None or name == "layers"},
    )
    if resume:
        default = TrainConfig()
        fields = [
            f.name for f in dataclasses.fields(config) if getattr(config, f.name) != getattr(default, f.name)
        ]
        if fields or seed or seeds:
            named = ", ".join(fields or ["seed"])
            raise ValueError(f"--resume goes on with the run's own configuration: leave out {named}")
        runs = [TrainingRun(directory, resume=True) for directory in _run_directories(out)]
    else:
        directories = [out] if seeds is None else [out / f"seed-{s}" for s in chosen]
        runs = [
            TrainingRun(directory, dataclasses.replace(config, seed=s))
            for directory, s in zip(directories, chosen, strict=True)
        ]
    if trials is None and seconds is None:
        trials = 100_000
    console = _console(json)
    _train(console, runs, trials=trials, seconds=seconds)
    results = [
        {"run": str(r.directory), "seed": r.config.seed, "trials": r.trial, "best_speed": r.best_speed}
        if r.history
        else {"run": str(r.directory), "seed": r.config.seed, "trials": 0, "best_speed": None}
        for r in runs
    ]
    if json:
        _print_json({"runs": results})


@_command
def evaluate(
    run: Positional[Path],
    which: Literal["best", "last"] = "best",
    episodes: int = 64,
    json: bool = False,
) -> None:
    """Swimming speed of a trained run in dm_control on MuJoCo, and how far V is from the returns it predicts.

    Args:
        run: Run directory; with several seeds in it, each is evaluated and the interval is over seeds.
        which: The weights that were fastest while training, or the last.
        episodes: Episodes of 20 s; 64 by the definition of swimming speed.
        json: Print one JSON object.
    """
    if not 1 <= episodes <= 64:
        raise ValueError(f"--episodes must be between 1 and 64, got {episodes}")
    console = _console(json)
    directories = _run_directories(run)
    results = []
    for directory in directories:
        with console.status(f"evaluating {directory}"):
            results.append(_evaluate_run(directory, which, episodes))
        _print_evaluation(console, results[-1])
    if len(results) == 1:
        (summary,) = results
    else:
        import numpy as np

        from swimmer_mj.learning.evaluation import mean_and_interval

        mean, interval = mean_and_interval(np.array([result["speed_mean"] for result in results]))
        summary = {
            "speed_mean": mean,
            "speed_ci95": list(interval),
            "n_episodes": episodes * len(results),
            "n_seeds": len(results),
            "runs": results,
        }
        console.print(
            f"{len(results)} seeds: {mean:.3f} m/s, 95 % interval {interval[0]:.3f} to {interval[1]:.3f}"
        )
    if json:
        _print_json(summary)


@_command
def render(
    run: Positional[Path],
    out: Path | None = None,
    which: Literal["best", "last"] = "best",
    duration: float = 13.0,
    fps: int = 30,
    backend: Backend | None = None,
    json: bool = False,
) -> None:
    """Video, film strip, learning curve and plots of an episode of a trained run.

    Args:
        run: Run directory.
        out: Where to put them; the run directory by default.
        which: The weights that were fastest while training, or the last.
        duration: Length of the episode, s; the target direction is reversed after 5/13 of it, as in figure 3.
        fps: Frames per second of the video.
        backend: OpenGL backend; OSMesa by default.
        json: Print one JSON object.
    """
    if not duration >= 1:
        raise ValueError(f"--duration must be at least 1 s, got {duration}")

    from swimmer_mj.render.backend import use_backend

    use_backend(backend)
    console = _console(json)
    (directory,) = _run_directories(run)[:1]
    with console.status(f"drawing {directory}"):
        pictures = _render_run(directory, out or directory, duration, fps, which)
    for path in pictures.values():
        console.print(f"  {path}")
    if json:
        _print_json({name: str(path) for name, path in pictures.items()})


@_command
def view(
    task: Positional[Literal["swim3", "swim4", "swim5", "steer3", "steer4", "steer5"]],
    run: Positional[Path | None] = None,
    which: Literal["best", "last"] = "best",
    seed: int = 0,
) -> None:
    """Watch a task in dm_control's viewer: with the policy of a run, or with random torques.

    Args:
        task: Task of the dm_control suite.
        run: Run directory of a swimmer with as many links; random torques without one.
        which: The weights that were fastest while training, or the last.
        seed: Of initial states and random torques.
    """
    if lack := _lacks_screen():
        instead = f"swimmer-mj render {run or 'RUN'}"
        raise ValueError(f"view needs a screen and {lack}; for a video without one: {instead}")

    from swimmer_mj.render.backend import use_backend

    use_backend("glfw")  # the only one with windows
    _view(task, run, which, seed)


@_command
def validate(seed: int = 0, html: Path | None = None, json: bool = False) -> None:
    """Hold the statements of the physics against each other, an arbiter, invariants, closed forms and limits.

    Args:
        seed: Of the random swimmers, states and torques.
        html: Also write the report, with plots, as one page to this file.
        json: Print one JSON object.
    """
    from swimmer_mj.report import write_page
    from swimmer_mj.validation import full_report

    if html is not None and not html.parent.is_dir():
        raise ValueError(f"--html must be a file in an existing directory, got {html}")
    started = time.perf_counter()
    console = _console(json)
    sections = []
    for section in full_report(seed):
        console.print(f"[bold]{section.title}[/bold]")
        _print_checks(console, section.checks)
        sections.append(section)
    seconds = time.perf_counter() - started
    passed = all(section.passed for section in sections)
    if html is not None:
        write_page(html, sections, seed, seconds)
        console.print(f"  {html}")
    if json:
        _print_json(
            {
                "passed": passed,
                "seconds": seconds,
                "checks": [
                    {"section": section.title, **check.to_json()}
                    for section in sections
                    for check in section.checks
                ],
                "curves": [
                    {"section": section.title, **curve.to_json()}
                    for section in sections
                    for curve in section.curves
                ],
            }
        )
    if not passed:
        raise CheckFailedError


@_command
def figures(
    names: Positional[tuple[str, ...]] = (),
    rerun: bool = False,
    out: Path = Path("figures"),
    json: bool = False,
) -> None:
    """Draw the paper's figures and claims, from the logs that come with the package or from scratch.

    Args:
        names: Which; all of them by default, and their names where one is unknown.
        rerun: Compute the logs anew, in the directory logs within out (docs/reproduction.md says how long each takes).
        out: Directory of the pictures.
        json: Print one JSON object.
    """
    from swimmer_mj.learning.experiments import EXPERIMENTS, LOGS
    from swimmer_mj.render.figures import save_figure
    from swimmer_mj.render.reproduction import FIGURES

    for name in names:
        if name not in FIGURES:
            raise ValueError(f"there is no figure {name!r}; there are {', '.join(FIGURES)}")
    console = _console(json)
    logs = out / "logs" if rerun else LOGS
    pictures = {}
    for name in names or FIGURES:
        if rerun:
            logs.mkdir(parents=True, exist_ok=True)
            EXPERIMENTS[name].run(logs, report=lambda line: console.print(line, markup=False, soft_wrap=True))
        pictures[name] = out / f"{name}.png"
        save_figure(FIGURES[name](logs), pictures[name])
        console.print(f"{EXPERIMENTS[name].description}: {pictures[name]}", markup=False, soft_wrap=True)
    if json:
        _print_json({"pictures": {name: str(path) for name, path in pictures.items()}})


@_command
def bench(json: bool = False) -> None:
    """Steps per second of MuJoCo and of the learners, timed in one run.

    Args:
        json: Print one JSON object.
    """
    from swimmer_mj.learning.benchmark import run_benchmark

    console = _console(json)
    with console.status("timing"):
        rates = run_benchmark()
    table = _table("Steps per second", ("", "1/s"))
    for name, rate in rates.items():
        table.add_row(name, f"{rate:,.0f}")
    console.print(table)
    if json:
        _print_json(rates)


@_command
def info(run: Positional[Path | None] = None, json: bool = False) -> None:
    """What this package offers, or what a run is and how far it has come.

    Args:
        run: Run directory, if any.
        json: Print one JSON object.
    """
    import swimmer_mj

    facts: dict[str, Any]
    if run is None:
        facts = {
            "version": swimmer_mj.__version__,
            "tasks": [f"{kind}{n}" for kind in ("swim", "steer") for n in (3, 4, 5)],
            "problems": ["swim", "pendulum"],
            "paper": "R. Coulom (2002), Feedforward Neural Networks in Reinforcement Learning Applied to "
            "High-dimensional Motor Control",
            "parameters": dataclasses.asdict(swimmer_mj.PAPER),
        }
    else:
        from swimmer_mj.learning.trainer import load_policy

        _, config, checkpoint = load_policy(run)
        facts = {
            "run": str(run),
            "config": config.to_json(),
            "best": {key: checkpoint[key] for key in ("trial", "seconds", "speed", "mean_value")},
        }
    console = _console(json)
    console.print_json(json_module.dumps(facts))
    if json:
        _print_json(facts)


@_command
def doctor(backend: Backend | None = None, json: bool = False) -> None:
    """Is this installation sound? Versions, one rendered frame, the friction callback at work.

    Args:
        backend: OpenGL backend to try; OSMesa by default.
        json: Print one JSON object.
    """
    import platform
    from importlib.metadata import version

    from swimmer_mj.render.backend import BackendError, probe
    from swimmer_mj.validation import callback_self_test

    packages = ("swimmer-mj", "mujoco", "dm-control", "numpy", "torch", "numba", "scipy")
    report: dict[str, Any] = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "versions": {package: version(package) for package in packages},
    }
    problems = []
    try:
        report["rendering"] = dataclasses.asdict(probe(backend))
    except BackendError as error:
        problems.append(f"rendering: {error}")
        report["rendering"] = {"error": str(error)}
    try:
        check = callback_self_test()
        report["callback"] = {**dataclasses.asdict(check), "passed": check.passed}
        if not check.passed:
            problems.append(f"callback: {check.name}: error {check.error:.1e} exceeds {check.tolerance:.0e}")
    except RuntimeError as error:
        problems.append(f"callback: {error}")
        report["callback"] = {"error": str(error)}
    report["problems"] = problems
    console = _console(json)
    console.print_json(json_module.dumps(report))
    if json:
        _print_json(report)
    for problem in problems:
        console.print(f"[red]{problem}[/red]")
    if problems:
        raise CheckFailedError


# Parts of commands -----------------------------------------------------------------------------------------------


def _train(
    console: Console,
    runs: Sequence[TrainingRun],
    *,
    trials: int | None = None,
    seconds: float | None = None,
    enough: Callable[[TrainingRun], bool] = lambda run: False,
) -> None:
    """Train ``runs`` together, with a live table on a terminal and a line an evaluation elsewhere."""
    import torch

    from swimmer_mj.learning.trainer import train_together

    torch.set_num_threads(1)  # the learners are the parallelism
    started = time.monotonic()
    news: dict[int, dict[str, str]] = {id(run): {"run": run.directory.name} for run in runs}
    columns = ("run", "trials", "trials/s", "elapsed", "<V>", "<H²>", "speed", "best")

    def table() -> Any:
        drawn = _table(None, columns)
        for row in news.values():
            drawn.add_row(*(row.get(column, "") for column in columns))
        return drawn

    with _live(console, table) as live:

        def report(report: Report) -> None:
            row = news[id(report.run)]
            row["elapsed"] = f"{time.monotonic() - started:.0f} s"
            if report.progress is not None:
                row["trials"] = f"{report.progress.trial:,}"
                row["trials/s"] = f"{report.progress.trials_per_second:.0f}"
            if report.metrics is not None:
                row["<V>"] = f"{report.metrics.mean_value:.3f} m"
                row["<H²>"] = f"{report.metrics.mean_squared_hamiltonian:.3f} m²/s²"
                row["speed"] = f"{report.metrics.speed:.3f} m/s"
                row["best"] = f"{report.run.best_speed:.3f} m/s"
                if live is None:
                    line = "  ".join(f"{column} {row[column]}" for column in columns if column in row)
                    console.print(line, soft_wrap=True)

        train_together(runs, trials=trials, seconds=seconds, enough=enough, report=report)


def _compile(configs: Sequence[TrainConfig]) -> None:
    """Have numba compile what runs of ``configs`` need, by a little work whose result is dropped."""
    import numpy as np

    from swimmer_mj.learning.methods import make_learning

    for config in configs:
        problem = config.make_problem()
        rng = np.random.default_rng(0)
        learning = make_learning(config, problem, config.make_network(problem))
        learning.learn(1, 0, rng)
        learning.judge(problem.initial_states(rng, 1))
        learning.rewards(problem.initial_states(rng, 1))


def _evaluate_run(directory: Path, which: Literal["best", "last"], episodes: int) -> dict[str, Any]:
    """Speed of a run's policy on MuJoCo; bias and error of its V against returns, by equation 1."""
    import numpy as np

    from swimmer_mj.learning.evaluation import evaluate_swimming
    from swimmer_mj.learning.policy import SwimmingPolicy
    from swimmer_mj.learning.trainer import evaluation_sample, load_policy
    from swimmer_mj.learning.value_gradient import ValueGradientLearner

    policy, config, info = load_policy(directory, which)
    if config.problem != "swim":
        raise ValueError(
            f"{directory} learned {config.problem!r}, and swimming speed is defined for swimmers only"
        )
    speed = evaluate_swimming(
        SwimmingPolicy(policy),
        config.parameters,
        n_episodes=episodes,
        workers=(os.cpu_count() or 1) if episodes > 8 else 1,  # a process takes seconds to start
    )
    states = evaluation_sample(policy.problem)
    sample = policy.judge(states)
    learner = ValueGradientLearner(policy.problem, policy.network)  # for its fast rollouts
    returns = learner.discounted_return(states, duration=10.0 / config.s_gamma)
    return {
        "run": str(directory),
        "seed": config.seed,
        "trials": info["trial"],
        "speed_mean": speed.mean,
        "speed_ci95": list(speed.ci95),
        "n_episodes": episodes,
        "mean_value": float(sample.value.mean()),
        "mean_squared_hamiltonian": float((sample.hamiltonian**2).mean()),
        "mean_return": float(returns.mean()),
        "value_bias": float((sample.value - returns).mean()),
        "value_rmse": float(np.sqrt(((sample.value - returns) ** 2).mean())),
    }


def _render_run(
    directory: Path,
    out: Path,
    duration: float,
    fps: int,
    which: Literal["best", "last"] = "best",
    beside: Sequence[tuple[str, Path]] = (),
) -> dict[str, Path]:
    """Draw all there is to see of a run; the backend is chosen before."""
    import math

    from swimmer_mj.learning.evaluation import evaluation_states, record_episode
    from swimmer_mj.learning.trainer import LOG, load_policy
    from swimmer_mj.render.curves import OPEN_LOOP_SPEED, learning_curve, rollout_plot
    from swimmer_mj.render.figures import save_figure
    from swimmer_mj.render.strip import film_strip
    from swimmer_mj.render.video import frames, write_video

    policy, config, _ = load_policy(directory, which)
    if config.problem != "swim":
        raise ValueError(f"{directory} learned {config.problem!r}; only swimmers are drawn")
    n = config.parameters.n_links
    reversal = duration * 5 / 13
    trajectory = record_episode(
        policy,
        config.parameters,
        evaluation_states(n)[0],
        duration,
        lambda now: 0.0 if now < reversal - 1e-9 else math.pi,
    )
    paths = {
        "video": out / "swimmer.mp4",
        "film_strip": out / "film-strip.png",
        "learning_curve": out / "learning-curve.png",
        "episode": out / "episode.png",
        "trajectory": out / "trajectory.npz",
    }
    trajectory.save(paths["trajectory"])
    write_video(paths["video"], frames(trajectory, fps=fps), fps)
    save_figure(film_strip(trajectory), paths["film_strip"])
    label = "value gradient" if config.method == "value-gradient" else "TD(λ)"
    logs = [(f"{label}, seed {config.seed}", directory / LOG), *beside]
    save_figure(learning_curve(logs, reference_speed=OPEN_LOOP_SPEED.get(n)), paths["learning_curve"])
    save_figure(rollout_plot(trajectory), paths["episode"])
    return paths


def _lacks_screen() -> str | None:
    """Why no window can be opened; None if nothing is known to be in the way."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if sys.platform == "linux" and not display:
        return "DISPLAY is not set"
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW says there what is said here
        return None if glfw.init() else f"{display or 'the screen'} cannot be opened"


def _view(task: str, run: Path | None, which: Literal["best", "last"], seed: int) -> None:
    """Open the viewer, until its window is closed; the backend is chosen before."""
    policy, config = None, None
    if run is not None:
        from swimmer_mj.learning.policy import SwimmingPolicy
        from swimmer_mj.learning.trainer import load_policy

        (directory,) = _run_directories(run)[:1]
        greedy, config, _ = load_policy(directory, which)
        if config.problem != "swim":
            raise ValueError(f"{directory} learned {config.problem!r}; only swimmers are shown")
        if (n := config.parameters.n_links) != int(task[-1]):
            raise ValueError(f"{directory} learned to move {n} links, and {task} has {task[-1]}")
        policy = SwimmingPolicy(greedy)

    import numpy as np
    from dm_control.viewer.application import Application

    import swimmer_mj

    task_kwargs: dict[str, Any] = {"random": seed, "time_limit": float("inf")}
    if config is not None:
        task_kwargs["params"] = config.parameters
    env = swimmer_mj.load(task, task_kwargs=task_kwargs)
    rng, shape = np.random.default_rng(seed), env.action_spec().shape

    def act(time_step: Any) -> Any:
        return rng.uniform(-1, 1, shape) if policy is None else policy(time_step.observation)

    try:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # GLFW says there what is said here
                window = Application(title=f"{task}: {run or 'random torques'}")
        except RuntimeError as error:
            raise ValueError(f"view needs a screen with OpenGL: {error}") from None
        _console(False).print(
            "Space: start, pause. [: follow the swimmer. Backspace: anew. F1: all keys.", markup=False
        )
        window.launch(env, policy=act)
    finally:
        env.physics.free()


def _run_directories(path: Path) -> list[Path]:
    """``path`` itself if it is a run, or the runs seed-0, seed-1 .. in it."""
    from swimmer_mj.learning.trainer import CONFIG

    if (path / CONFIG).is_file():
        return [path]
    found = [p for p in path.glob("seed-*") if p.name[5:].isdigit() and (p / CONFIG).is_file()]
    if not found:
        raise FileNotFoundError(
            f"{path} is not a run directory: it has neither {CONFIG} nor seed-0, seed-1 .."
        )
    return sorted(found, key=lambda p: int(p.name[5:]))


def _free_directory(path: Path) -> Path:
    """``path``, or the first of path-2, path-3 .. that does not exist."""
    candidate, k = path, 1
    while candidate.exists():
        k += 1
        candidate = path.with_name(f"{path.name}-{k}")
    return candidate


def _parse_seeds(text: str) -> list[int]:
    """[0, 1, 2, 5] of "0-2,5"."""
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)(?:\s*-\s*(\d+))?\s*", part)
        if match is None or (match[2] and int(match[2]) < int(match[1])):
            raise ValueError(f"--seeds must be like 0-7 or 1,4,9; got {text!r}")
        seeds.extend(range(int(match[1]), int(match[2] or match[1]) + 1))
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"--seeds names a seed twice: {text!r}")
    return seeds


# Output ----------------------------------------------------------------------------------------------------------


def _console(json: bool) -> Console:
    """Where people read: standard output, or nowhere when that is for JSON."""
    from rich.console import Console

    return Console(quiet=json, highlight=False)


def _print_json(value: dict[str, Any]) -> None:
    print(json_module.dumps(value, indent=2, allow_nan=False))


def _table(title: str | None, columns: Sequence[str]) -> Any:
    from rich.box import SIMPLE
    from rich.table import Table

    table = Table(title=title, box=SIMPLE, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    return table


@contextlib.contextmanager
def _live(console: Console, draw: Callable[[], Any]) -> Iterator[Any]:
    """A display that redraws itself on a terminal; None elsewhere."""
    if not console.is_terminal or console.quiet:
        yield None
        return
    from rich.live import Live

    with Live(get_renderable=draw, console=console, refresh_per_second=4) as live:
        yield live


def _print_checks(console: Console, checks: Sequence[Any]) -> None:
    table = _table(None, ("check", "error", "tolerance", ""))
    for check in checks:
        verdict = "[green]ok[/green]" if check.passed else "[red]FAILED[/red]"
        table.add_row(check.name, f"{check.error:.1e}", f"{check.tolerance:.0e}", verdict)
    console.print(table)


def _print_evaluation(console: Console, result: dict[str, Any]) -> None:
    low, high = result["speed_ci95"]
    console.print(
        f"seed {result['seed']}, {result['trials']:,} trials: swimming speed "
        f"[bold]{result['speed_mean']:.3f} m/s[/bold] "
        f"(95 % interval over {result['n_episodes']} episodes: {low:.3f} to {high:.3f})\n"
        f"<V> {result['mean_value']:.3f} m against a mean return of {result['mean_return']:.3f} m "
        f"(root mean square error {result['value_rmse']:.3f} m), <H²> {result['mean_squared_hamiltonian']:.3f} m²/s²"
    )


# Entry -----------------------------------------------------------------------------------------------------------


def _one_line(message: str) -> str:
    """A message without line breaks and without the boxes that the parser draws."""
    return " ".join(re.sub(r"\x1b\[[0-9;]*m|[─│╭╮╰╯]", " ", message).split())


def _complain(message: str) -> int:
    print(f"swimmer-mj: {_one_line(message)}", file=sys.stderr)
    return 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            command = _app.cli(
                prog="swimmer-mj", description=_DESCRIPTION, args=arguments, config=(FlagCreatePairsOff,)
            )
    except SystemExit as stop:
        return _complain(complaint.getvalue()) if stop.code else 0
    from swimmer_mj.render.backend import BackendError, use_backend

    with contextlib.suppress(BackendError):
        use_backend()  # else dm_control looks for a screen when it is imported, also where nothing is drawn
    try:
        command()
    except CheckFailedError:
        return 1
    except KeyboardInterrupt:
        return _complain("interrupted") and 130
    except (ValueError, OSError, FloatingPointError, BackendError) as error:
        return _complain(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
