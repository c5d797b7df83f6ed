"""Advancing several runs together: in step where their method can, else side by side."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from swimmer_mj.learning.method import Along, Team, TeamMethod
from swimmer_mj.learning.runs.run import Metrics, TrainingRun

__all__ = ["Pack", "Progress", "Report", "train_together"]


class Progress(NamedTuple):
    """What a run reports while it learns."""

    trial: int
    trials_per_second: float
    """Over the last stretch of learning."""
    along: Along
    """Means along the last trials."""


class Report(NamedTuple):
    """News of one of several runs."""

    run: TrainingRun
    progress: Progress | None
    """After a stretch of learning."""
    metrics: Metrics | None
    """After an evaluation."""


def _team_key(run: TrainingRun) -> Hashable | None:
    """What runs must share to learn in step; None: this one learns alone."""
    method = run.config.method
    if not isinstance(method, TeamMethod):
        return None
    key = method.team_key(run.problem)
    return None if key is None else (key, run.config.evaluate_every)


def _team_size(run: TrainingRun) -> int:
    method = run.config.method
    return method.team_size if isinstance(method, TeamMethod) else 1


class Pack:
    """Runs that learn in step: a single one, or as many as their method puts in a team.

    What each computes does not depend on the others. A run that diverges leaves the pack, as it was last saved; the
    others go on.
    """

    def __init__(self, runs: Sequence[TrainingRun]) -> None:
        self.runs = list(runs)
        if len(runs) > 1 and _team_key(runs[0]) is None:
            raise ValueError(f"these runs learn one at a time, got {len(runs)}")
        self._diverged: list[str] = []
        self._join()

    def _join(self) -> None:
        """Have the learners of the runs that are left learn in step."""
        self._team: Team | None = None
        if self.runs and _team_key(self.runs[0]) is not None:
            method = self.runs[0].config.method
            assert isinstance(method, TeamMethod)
            self._team = method.team([run.learning for run in self.runs])

    @staticmethod
    def of(runs: Sequence[TrainingRun], workers: int) -> list[Pack]:
        """Packs of ``runs`` that can learn in step, all of about one size: as few as keep all ``workers`` busy."""
        alike: dict[Any, list[TrainingRun]] = {}
        for run in runs:
            alike.setdefault(_team_key(run) or id(run), []).append(run)
        groups = list(alike.values())
        counts = [-(-len(group) // _team_size(group[0])) for group in groups]
        while sum(counts) < min(workers, len(runs)):
            largest = max(range(len(groups)), key=lambda k: len(groups[k]) / counts[k])
            counts[largest] += 1
        return [
            Pack(group[i * len(group) // count : (i + 1) * len(group) // count])
            for group, count in zip(groups, counts, strict=True)
            for i in range(count)
        ]

    def advance(
        self,
        report: Callable[[Report], None] = lambda report: None,
        stretch: int = 100,
        stop: Callable[[], bool] = lambda: False,
    ) -> list[Metrics] | None:
        """Learn for ``evaluate_every`` trials, evaluate, and save.

        Parameters
        ----------
        report : callable
            Called with each run's news after each ``stretch`` of trials and after the evaluation.
        stretch : int
            Trials between calls; the result does not depend on it.
        stop : callable
            Asked after each stretch. When it says True, the period is left unfinished and forgotten: the runs stand
            where they last were saved, or at their beginning, and None is returned.

        Raises
        ------
        FloatingPointError
            When the period is over for the others: it names the runs that have diverged and left the pack.
        """
        started = time.perf_counter()
        left = self.runs[0].config.evaluate_every
        while left and self.runs:
            count = min(stretch, left)
            before = time.perf_counter()
            means = self._learn(count)
            left -= count
            rate = count / (time.perf_counter() - before)
            for run, along in means.items():
                report(Report(run, Progress(run.trial, rate, along), None))
            if left and stop():
                for run in self.runs:
                    run.forget_unsaved()
                self._join()
                self._say_what_diverged()
                return None
        rows = []
        for run in self.runs:
            metrics = run.evaluate(run.seconds + time.perf_counter() - started)
            run.save(metrics)
            report(Report(run, None, metrics))
            rows.append(metrics)
        self._say_what_diverged()
        return rows

    def _learn(self, count: int) -> dict[TrainingRun, Along]:
        """``count`` trials of each run: means along them, of those that have not diverged."""
        news: list[Along | FloatingPointError]
        if self._team is not None:
            news = self._team.learn(count)
        else:
            (run,) = self.runs
            try:
                news = [run.learning.learn(count)]
            except FloatingPointError as error:
                news = [error]
        means: dict[TrainingRun, Along] = {}
        for run, along in zip(list(self.runs), news, strict=True):
            if isinstance(along, FloatingPointError):
                self._drop(run, str(along))
            else:
                run.trial += count
                means[run] = along
        if len(means) < len(news):
            self._join()
        return means

    def _drop(self, run: TrainingRun, why: str) -> None:
        """Leave ``run`` as it was last saved, and go on without it."""
        self._diverged.append(f"{run.directory}: {why}")
        run.forget_unsaved()
        self.runs.remove(run)

    def _say_what_diverged(self) -> None:
        news, self._diverged = self._diverged, []
        if news:
            raise FloatingPointError("; ".join(news))


def train_together(
    runs: Sequence[TrainingRun],
    *,
    trials: int | None = None,
    seconds: float | None = None,
    enough: Callable[[TrainingRun], bool] = lambda run: False,
    report: Callable[[Report], None] = lambda report: None,
    workers: int | None = None,
) -> None:
    """Advance several runs side by side, each in a thread (the compiled learner holds no lock).

    Parameters
    ----------
    runs : sequence of TrainingRun
        What to advance.
    trials : int, optional
        Each run stops at the first evaluation with at least this many trials.
    seconds : float, optional
        Wall-clock time after which all runs stop. What a run learned since its last evaluation is dropped, in memory
        as on disk, so that it stays reproducible.
    enough : callable
        As soon as it is true of one run after an evaluation, all runs stop.
    report : callable
        Called with news, from the threads of the runs.
    workers : int, optional
        Runs at a time; as many as there are cores by default.

    Raises
    ------
    FloatingPointError
        When all others are done: it names the runs that have diverged, which stand where they last were saved.
    """
    deadline = np.inf if seconds is None else time.monotonic() + seconds
    finished = threading.Event()
    diverged: list[str] = []

    def over() -> bool:
        return finished.is_set() or time.monotonic() > deadline

    def work(pack: Pack) -> None:
        try:
            while pack.runs and not over():
                unfinished = [run for run in pack.runs if trials is None or run.trial < trials]
                if not unfinished:
                    return
                if len(unfinished) < len(pack.runs):
                    pack = Pack(unfinished)
                try:
                    if pack.advance(report, stop=over) is None:
                        return
                except FloatingPointError as error:
                    diverged.append(str(error))
                if any(enough(run) for run in pack.runs):
                    finished.set()
        except BaseException:
            finished.set()
            raise

    workers = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(work, pack) for pack in Pack.of(runs, workers)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            finished.set()
            raise
    if diverged:
        raise FloatingPointError("; ".join(diverged))
