"""The jobs of a sweep on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from swimmer_mj.files import replacing
from swimmer_mj.learning.runs.config import CONFIG
from swimmer_mj.learning.runs.jobs import DIVERGED, Job, News, unfinished
from swimmer_mj.learning.runs.lock import RunInUseError
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.runs.together import Report, train_together

__all__ = ["LocalEngine"]

AT_ONCE = 128
"""Runs in memory at a time."""


@dataclass(frozen=True)
class LocalEngine:
    """On all cores of this machine.

    Parameters
    ----------
    workers : int, optional
        On as many cores instead.
    patience : float
        Seconds to wait for runs that another process holds, before RunInUseError.
    """

    workers: int | None = None
    patience: float = 0.0

    def run(
        self,
        jobs: Sequence[Job],
        directory: Path,
        trials: int,
        report: Callable[[News], None],
        stop: Callable[[], bool],
    ) -> None:
        """See :class:`~swimmer_mj.learning.runs.jobs.Engine`; news after each evaluation."""
        until = time.monotonic() + self.patience
        while True:
            try:
                self._learn(jobs, directory, trials, report, stop)
                return
            except RunInUseError:
                if stop():
                    return
                if time.monotonic() > until:
                    raise
            time.sleep(1.0)

    def _learn(
        self,
        jobs: Sequence[Job],
        directory: Path,
        trials: int,
        report: Callable[[News], None],
        stop: Callable[[], bool],
    ) -> None:
        for some in _batches(unfinished(jobs, directory, trials), AT_ONCE):
            if stop():
                return
            runs = {_open(job, directory): job.name for job in some}

            def tell(news: Report, runs: dict[TrainingRun, str] = runs) -> None:
                if news.warning is not None:
                    with replacing(news.run.directory / DIVERGED) as partial:
                        partial.write_text(news.warning + "\n", encoding="utf-8")
                if news.warning is not None or news.metrics is not None:
                    report(News(runs[news.run], news.metrics, news.run.best_speed, news.warning))

            try:
                train_together(list(runs), trials=trials, report=tell, stop=stop, workers=self.workers)
            except FloatingPointError:
                continue  # tell() has written it down


def _batches(jobs: Sequence[Job], size: int) -> Iterator[Sequence[Job]]:
    for start in range(0, len(jobs), size):
        yield jobs[start : start + size]


def _open(job: Job, directory: Path) -> TrainingRun:
    path = directory / job.name
    return TrainingRun(path, job.config, resume=(path / CONFIG).exists())
