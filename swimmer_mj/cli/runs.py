"""``evaluate`` and ``info``: what a run has learned, and what it is."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import trust_modules
from swimmer_mj.cli.output import make_console, print_evaluation, print_facts, print_json, print_line, status

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "Which",
    "evaluate",
    "first_policy_directory",
    "free_directory",
    "info",
    "policy_directories",
    "run_directories",
]

Which = Literal["best", "last"]


def evaluate(
    run: Positional[Path],
    which: Which = "best",
    episodes: int = 64,
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """How good is what a run has learned, and how far is V from the returns it predicts.

    A swimmer's swimming speed, in dm_control on MuJoCo, and beside it its steady speed (from 30 to 60 s), the speed of
    its first 5 s, and the discounted return of equation 1. Of a task of dm_control or Gymnasium, the return of its
    episodes, the sum of its own rewards, in the environment as it is. Of another problem, the mean reward rate of its
    episodes, over the last 10 of 20 s if it does not say otherwise.

    Args:
        run: Run directory; with several seeds in it, each is evaluated and the interval is over seeds. Or the name of
            a pretrained policy, such as swim5-paper.
        which: The weights that were best while training, or the last.
        episodes: How many episodes; 64 by the definition of swimming speed. A task's are those of the seeds 0, 1, ..
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
        json: Print one JSON object.
    """
    if not 1 <= episodes <= 64:
        raise ValueError(f"--episodes must be between 1 and 64, got {episodes}")
    trust_modules(trust)

    from swimmer_mj.learning.runs.evaluation import evaluate_run

    console = make_console(json)
    results = []
    for directory in policy_directories(run):
        with status(console, f"evaluating {directory}"):
            results.append(evaluate_run(directory, which, episodes))
        print_evaluation(console, results[-1])
    if len(results) == 1:
        (summary,) = results
    else:
        summary = _over_seeds(results)
        for measure, unit in results[0]["units"].items():
            mean, (low, high) = summary[f"{measure}_mean"], summary[f"{measure}_ci95"]
            line = f"{measure.replace('_', ' ')} {mean:.3f} {unit}".strip()
            console.print(f"{len(results)} seeds: {line}, 95 % interval {low:.3f} to {high:.3f}")
    if json:
        print_json(summary)


def _over_seeds(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean and interval over the results of several seeds."""
    import numpy as np

    from swimmer_mj.intervals import mean_and_interval

    found: dict[str, Any] = {}
    for measure in results[0]["units"]:
        mean, interval = mean_and_interval(np.array([result[f"{measure}_mean"] for result in results]))
        found[f"{measure}_mean"], found[f"{measure}_ci95"] = mean, list(interval)
    return {
        **{key: results[0][key] for key in ("measure", "unit", "units")},
        **found,
        "n_episodes": sum(result["n_episodes"] for result in results),
        "n_seeds": len(results),
        "runs": results,
    }


def info(run: Positional[Path | None] = None, trust: tuple[str, ...] = (), json: bool = False) -> None:
    """What this package offers, or what a run is and how far it has come.

    Args:
        run: Run directory or name of a pretrained policy, if any; with several seeds in it, each is described.
        trust: Modules of one's own that may run when the run names them.
        json: Print one JSON object.
    """
    trust_modules(trust)
    console = make_console(json)
    if run is None:
        facts = _package_facts()
        print_facts(console, facts)
    else:
        runs = [_run_facts(directory) for directory in policy_directories(run)]
        for one in runs:
            print_facts(console, one)
        facts = {**runs[0], "run": str(run)} if len(runs) == 1 else {"run": str(run), "runs": runs}
    if json:
        print_json(facts)


def _package_facts() -> dict[str, Any]:
    """What this package offers."""
    import swimmer_mj
    from swimmer_mj.environments.swimming import TASKS
    from swimmer_mj.learning.pretrained import pretrained_names
    from swimmer_mj.learning.runs.registry import METHODS, PROBLEMS

    return {
        "version": swimmer_mj.__version__,
        "tasks": list(TASKS),
        "problems": list(PROBLEMS),
        "methods": list(METHODS),
        "pretrained": list(pretrained_names()),
        "paper": "R. Coulom (2002), Feedforward Neural Networks in Reinforcement Learning Applied to "
        "High-dimensional Motor Control",
        "parameters": dataclasses.asdict(swimmer_mj.PAPER),
    }


def _run_facts(directory: Path) -> dict[str, Any]:
    """What the run in ``directory`` is, and how far it has come."""
    from swimmer_mj.learning.runs.run import load_policy

    _, config, checkpoint = load_policy(directory)
    return {
        "run": str(directory),
        "config": config.to_json(),
        "best": {key: checkpoint[key] for key in ("trial", "seconds", "speed", "mean_value")},
    }


def run_directories(path: Path) -> list[Path]:
    """``path`` itself if it is a run, or the runs seed-0, seed-1 .. in it."""
    from swimmer_mj.learning.runs.config import CONFIG

    if (path / CONFIG).is_file():
        return [path]
    found = [p for p in path.glob("seed-*") if p.name[5:].isdigit() and (p / CONFIG).is_file()]
    if not found:
        raise FileNotFoundError(
            f"{path} is not a run directory: it has neither {CONFIG} nor seed-0, seed-1 .."
        )
    return sorted(found, key=lambda p: int(p.name[5:]))


def policy_directories(path: Path) -> list[Path]:
    """:func:`run_directories`, or the pretrained policy of that name: to be read, not to be resumed."""
    from swimmer_mj.learning.pretrained import pretrained_directory, pretrained_names

    names = pretrained_names()
    if str(path) in names:
        with contextlib.suppress(FileNotFoundError):  # also where there are only pictures of the policy
            return run_directories(path)
        return [pretrained_directory(str(path))]
    if not path.exists():
        raise FileNotFoundError(
            f"{path} is not a run directory, nor is it one of the pretrained policies {', '.join(names)}"
        )
    return run_directories(path)


def first_policy_directory(path: Path, console: Console) -> Path:
    """The first of :func:`policy_directories`; of several, a line says which."""
    first, *others = policy_directories(path)
    if others:
        print_line(console, f"{path} holds {len(others) + 1} runs; the first is taken: {first}")
    return first


def free_directory(path: Path) -> Path:
    """``path``, or the first of path-2, path-3 .. that does not exist."""
    candidate, k = path, 1
    while candidate.exists():
        k += 1
        candidate = path.with_name(f"{path.name}-{k}")
    return candidate
