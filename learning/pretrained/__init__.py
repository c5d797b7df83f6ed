"""Policies that come with the package: one directory each, as a training run leaves it.

    from swimmer_mj.learning import load_pretrained

    agent = load_pretrained("swim5-paper")
    action = agent(environment.reset().observation)

``best.json`` in a directory is the policy's card: configuration, seed, trials, the commit it was shipped at, its
swimming speed by the definition of docs/metrics.md or the return of its task, and how it was chosen. A directory goes
wherever a run's goes, as in ``swimmer_mj.learning.runs.run.load_policy``. Most are swimmers; the others learned tasks
of dm_control and Gymnasium, which must be installed for them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from swimmer_mj.learning.problems.swim.environment import SwimmingPolicy
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import CONFIG
from swimmer_mj.learning.runs.run import BEST, load_policy

__all__ = [
    "PRETRAINED",
    "load_pretrained",
    "pretrained_card",
    "pretrained_directory",
    "pretrained_names",
    "pretrained_swimmers",
]

PRETRAINED = Path(__file__).parent
"""Where they are."""


def pretrained_names() -> tuple[str, ...]:
    """Of all policies."""
    return tuple(sorted(path.parent.name for path in PRETRAINED.glob(f"*/{CONFIG}")))


def pretrained_swimmers() -> tuple[str, ...]:
    """Of those that swim, which are all but a few."""
    return tuple(name for name in pretrained_names() if _task(name) is None)


def _task(name: str) -> str | None:
    """The environment that a policy learned; None for a swimmer."""
    problem = json.loads((PRETRAINED / name / CONFIG).read_text(encoding="utf-8"))["problem"]
    return None if isinstance(problem, str) else problem.get("environment")


def pretrained_directory(name: str) -> Path:
    """The directory of a policy.

    Raises
    ------
    ValueError
        There is no such policy.
    """
    if name not in pretrained_names():
        raise ValueError(f"there is no pretrained policy {name!r}; there are {', '.join(pretrained_names())}")
    return PRETRAINED / name


def load_pretrained(name: str) -> SwimmingPolicy:
    """A policy as an agent for the swim and steer tasks of its number of links; ``agent.policy`` has V and H.

    Raises
    ------
    ValueError
        There is no such policy, or it is no swimmer's.
    """
    directory = pretrained_directory(name)
    if (task := _task(name)) is not None:
        raise ValueError(
            f"{name!r} learned {task}, and swimmers were asked for; use load_policy(pretrained_directory({name!r}))"
        )
    policy, _, _ = load_policy(directory)
    return SwimmingPolicy(policy)


def pretrained_card(name: str) -> dict[str, Any]:
    """What is known of a policy: ``config``, ``seed``, ``trial``, ``commit``, ``swimming_speed`` or ``return``, .."""
    return load_checkpoint(pretrained_directory(name) / BEST)[1]
