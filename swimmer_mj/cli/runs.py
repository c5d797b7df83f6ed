"""``evaluate`` and ``info``: what a run has learned, and what it is."""

from __future__ import annotations

import contextlib
import dataclasses
import json as json_module
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_type_hints

from tyro.conf import Positional

from swimmer_mj.cli.output import make_console, print_evaluation, print_json, print_line, status

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "Which",
    "evaluate",
    "evaluate_run",
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
    json: bool = False,
) -> None:
    """Swimming speed of a trained run in dm_control on MuJoCo, and how far V is from the returns it predicts.

    Args:
        run: Run directory; with several seeds in it, each is evaluated and the interval is over seeds. Or the name of
            a pretrained policy, such as swim5-paper.
        which: The weights that were fastest while training, or the last.
        episodes: Episodes of 20 s; 64 by the definition of swimming speed.
        json: Print one JSON object.
    """
    if not 1 <= episodes <= 64:
        raise ValueError(f"--episodes must be between 1 and 64, got {episodes}")
    console = make_console(json)
    directories = policy_directories(run)
    results = []
    for directory in directories:
        with status(console, f"evaluating {directory}"):
            results.append(evaluate_run(directory, which, episodes))
        print_evaluation(console, results[-1])
    if len(results) == 1:
        (summary,) = results
    else:
        import numpy as np

        from swimmer_mj.learning.runs.evaluation import mean_and_interval

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
        print_json(summary)


def evaluate_run(directory: Path, which: Which, episodes: int) -> dict[str, Any]:
    """Speed of a run's policy on MuJoCo; bias and error of its V against returns, by equation 1."""
    import numpy as np

    from swimmer_mj.learning.networks.policy import SwimmingPolicy
    from swimmer_mj.learning.runs.evaluation import evaluate_swimming, known_interval
    from swimmer_mj.learning.runs.trainer import evaluation_sample, load_policy
    from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner

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
        "speed_ci95": known_interval(speed.ci95),
        "n_episodes": episodes,
        "mean_value": float(sample.value.mean()),
        "mean_squared_hamiltonian": float((sample.hamiltonian**2).mean()),
        "mean_return": float(returns.mean()),
        "value_bias": float((sample.value - returns).mean()),
        "value_rmse": float(np.sqrt(((sample.value - returns) ** 2).mean())),
    }


def info(run: Positional[Path | None] = None, json: bool = False) -> None:
    """What this package offers, or what a run is and how far it has come.

    Args:
        run: Run directory or name of a pretrained policy, if any; with several seeds in it, each is described.
        json: Print one JSON object.
    """
    if run is None:
        facts = _package_facts()
    else:
        runs = [_run_facts(directory) for directory in policy_directories(run)]
        facts = {**runs[0], "run": str(run)} if len(runs) == 1 else {"run": str(run), "runs": runs}
    console = make_console(json)
    console.print_json(json_module.dumps(facts))
    if json:
        print_json(facts)


def _package_facts() -> dict[str, Any]:
    """What this package offers."""
    import swimmer_mj
    from swimmer_mj.learning.pretrained import pretrained_names
    from swimmer_mj.learning.runs.trainer import TrainConfig

    return {
        "version": swimmer_mj.__version__,
        "tasks": list(swimmer_mj.SUITE),
        "problems": list(get_args(get_type_hints(TrainConfig)["problem"])),
        "pretrained": list(pretrained_names()),
        "paper": "R. Coulom (2002), Feedforward Neural Networks in Reinforcement Learning Applied to "
        "High-dimensional Motor Control",
        "parameters": dataclasses.asdict(swimmer_mj.PAPER),
    }


def _run_facts(directory: Path) -> dict[str, Any]:
    """What the run in ``directory`` is, and how far it has come."""
    from swimmer_mj.learning.runs.trainer import load_policy

    _, config, checkpoint = load_policy(directory)
    return {
        "run": str(directory),
        "config": config.to_json(),
        "best": {key: checkpoint[key] for key in ("trial", "seconds", "speed", "mean_value")},
    }


def run_directories(path: Path) -> list[Path]:
    """``path`` itself if it is a run, or the runs seed-0, seed-1 .. in it."""
    from swimmer_mj.learning.runs.trainer import CONFIG

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
