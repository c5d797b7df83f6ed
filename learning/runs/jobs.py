"""The jobs of a sweep, and what every engine that has them learn must know of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import CHECKPOINT, Metrics
from swimmer_mj.learning.runs.together import packed

__all__ = ["DIVERGED", "PATIENCE", "Engine", "Job", "News", "packs", "part", "state_of", "unfinished"]

DIVERGED = "diverged.txt"
"""In the directory of a run that has diverged: why. The run is left alone until it is removed."""
PATIENCE = 120.0
"""s to wait for a run that another process holds: what a lost machine has locked stays so for a while."""


@dataclass(frozen=True)
class Job:
    """One run."""

    name: str
    """Of its directory, inside that of the sweep."""
    settings: Mapping[str, Any]
    """What sets it apart from the others; the seed aside."""
    config: RunConfig


class News(NamedTuple):
    """What an engine reports of a job."""

    job: str
    """Its name; empty if this is of the engine."""
    metrics: Metrics | None = None
    """Of an evaluation."""
    best_speed: float | None = None
    """Of all evaluations so far."""
    warning: str | None = None
    """After a divergence, or when something else happened that one should know."""


class Engine(Protocol):
    """Where the jobs of a sweep learn."""

    def run(
        self,
        jobs: Sequence[Job],
        directory: Path,
        trials: int,
        report: Callable[[News], None],
        stop: Callable[[], bool],
    ) -> None:
        """Have ``jobs`` learn ``trials`` trials in ``directory``, those that are there only what is left of them.

        When ``stop`` says True, all are saved as they stand, and this returns. A job that diverges has ``diverged.txt``
        in its directory afterwards.
        """
        ...


def state_of(path: Path, trials: int) -> str:
    """One of done, diverged, unfinished: of the job in the directory ``path``."""
    if (path / DIVERGED).exists():
        return "diverged"
    if (path / CHECKPOINT).exists() and load_checkpoint(path / CHECKPOINT)[1]["trial"] >= trials:
        return "done"
    return "unfinished"


def unfinished(jobs: Sequence[Job], directory: Path, trials: int) -> list[Job]:
    """Those of ``jobs`` with something left to learn."""
    return [job for job in jobs if state_of(directory / job.name, trials) == "unfinished"]


def packs(jobs: Sequence[Job], workers: int) -> list[list[Job]]:
    """Jobs that learn in step: as few packs as keep all ``workers`` busy."""
    return [[jobs[i] for i in share] for share in packed([job.config for job in jobs], workers)]


def part(jobs: Sequence[Job], k: int, n: int) -> list[Job]:
    """The ``k``-th, from 1, of ``n`` parts of ``jobs``, which are the same whatever was learned already."""
    return [job for pack in packs(jobs, n)[k - 1 :: n] for job in pack]
