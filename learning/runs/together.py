"""Advancing several runs together: in step where their method can, else side by side."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Literal, NamedTuple

import numpy as np

from swimmer_mj.learning.method import Along, Team, TeamMethod
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import Metrics, TrainingRun

__all__ = [
    "RESTORES",
    "SAVE_SECONDS",
    "STRETCH_SECONDS",
    "Pack",
    "Progress",
    "Report",
    "packed",
    "train_together",
]

SAVE_SECONDS = 20.0
"""Of learning that a run may lose when its process is killed; and a stretch."""
STRETCH_SECONDS = 0.5
"""How long learning goes on before anything else is looked at; at least for one trial."""
RESTORES = 10
"""How many times a run may start again from its last evaluation before its divergence is taken for what it is."""


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
    warning: str | None = None
    """After a divergence."""


def _team_key(config: RunConfig) -> Hashable | None:
    """What runs must share to learn in step; None: this one learns alone."""
    if not isinstance(config.method, TeamMethod):
        return None
    key = config.method.team_key(config.problem)
    return None if key is None else (key, config.evaluate_every)


def _team_size(config: RunConfig) -> int:
    return config.method.team_size if isinstance(config.method, TeamMethod) else 1


def packed(configs: Sequence[RunConfig], workers: int) -> list[list[int]]:
    """Indices of the runs that learn in step, a list a pack.

    The packs that can be made of the same runs are of about one size, and as few as keep all ``workers`` busy.
    """
    alike: dict[Hashable, list[int]] = {}
    for i, config in enumerate(configs):
        alike.setdefault(_team_key(config) or i, []).append(i)
    groups = list(alike.values())
    counts = [-(-len(group) // _team_size(configs[group[0]])) for group in groups]
    while sum(counts) < min(workers, len(configs)):
        largest = max(range(len(groups)), key=lambda k: len(groups[k]) / counts[k])
        counts[largest] += 1
    return [
        group[i * len(group) // count : (i + 1) * len(group) // count]
        for group, count in zip(groups, counts, strict=True)
        for i in range(count)
    ]


class Pack:
    """Runs that learn in step: a single one, or as many as their method puts in a team.

    What each computes does not depend on the others. A run that diverges leaves the pack, as it was last evaluated; the
    others go on. With ``restore``, it stays in the pack and goes on from there with other random numbers.
    """

    def __init__(self, runs: Sequence[TrainingRun], restore: bool = False) -> None:
        self.runs = list(runs)
        self.restore = restore
        if len(runs) > 1 and _team_key(runs[0].config) is None:
            raise ValueError(f"these runs learn one at a time, got {len(runs)}")
        self._diverged: list[str] = []
        self._join()

    def _join(self) -> None:
        """Have the learners of the runs that are left learn in step."""
        self._team: Team | None = None
        if self.runs and _team_key(self.runs[0].config) is not None:
            method = self.runs[0].config.method
            assert isinstance(method, TeamMethod)
            self._team = method.team([run.learning for run in self.runs])

    @staticmethod
    def of(runs: Sequence[TrainingRun], workers: int, restore: bool = False) -> list[Pack]:
        """Packs of ``runs`` that can learn in step: :func:`packed`."""
        shares = packed([run.config for run in runs], workers)
        return [Pack([runs[i] for i in share], restore) for share in shares]

    def advance(
        self,
        report: Callable[[Report], None] = lambda report: None,
        stretch: int = 100,
        stop: Callable[[], bool] = lambda: False,
    ) -> list[Metrics] | None:
        """Learn until the next evaluation, evaluate, and save; save in between what would be lost otherwise.

        Runs that were resumed may be out of step: then only those that are due are evaluated.

        Parameters
        ----------
        report : callable
            Called with each run's news after each stretch of trials and after the evaluation.
        stretch : int
            Trials between calls at most; fewer where they take longer than :data:`STRETCH_SECONDS`. The result does not
            depend on it.
        stop : callable
            Asked after each stretch. When it says True, the runs are saved as they stand, and None is returned.

        Raises
        ------
        FloatingPointError
            When the period is over for the others: it names the runs that have diverged and left the pack.
        """
        count = 1
        before = time.perf_counter()
        while self.runs and not self._due():
            count = min(count, stretch, *(run.left for run in self.runs))
            means = self._learn(count, report)
            before, elapsed = time.perf_counter(), time.perf_counter() - before
            rate = count / elapsed
            for run in self.runs:
                run.seconds += elapsed
            for run, along in means.items():
                report(Report(run, Progress(run.trial, rate, along), None))
            stopped = not self._due() and stop()
            for run in self.runs:
                if stopped or time.monotonic() - run.saved_at > SAVE_SECONDS:
                    run.save_unfinished()
            if stopped:
                self._say_what_diverged()
                return None
            count = max(1, round(STRETCH_SECONDS * rate))
        rows = []
        for run in self._due():
            try:
                rows.append(_evaluate(run, run.seconds + time.perf_counter() - before, report))
            except FloatingPointError as error:
                self._diverge(run, f"{run.directory}: {error}", report)
                self._join()
        self._say_what_diverged()
        return rows

    def _due(self) -> list[TrainingRun]:
        return [run for run in self.runs if run.left <= 0]

    def _learn(self, count: int, report: Callable[[Report], None]) -> dict[TrainingRun, Along]:
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
                self._diverge(run, f"{run.directory}: {along}", report)
            else:
                run.trial += count
                means[run] = along
        if len(means) < len(news):
            self._join()
        return means

    def _diverge(self, run: TrainingRun, why: str, report: Callable[[Report], None]) -> None:
        """Leave ``run`` as it was last evaluated, and go on without it, or with it from there."""
        where = f"trial {run.evaluated_trial:,}, " + ("as last evaluated" if run.history else "its beginning")
        if self.restore and run.restores < RESTORES:
            run.restart()
            warning = f"{why}; it goes on from {where}, with other random numbers ({run.restores} of {RESTORES} times)"
            report(Report(run, None, None, warning))
        else:
            run.forget_unfinished()
            self.runs.remove(run)
            self._diverged.append(f"{why}; it stands at {where}")
            report(Report(run, None, None, self._diverged[-1]))

    def _say_what_diverged(self) -> None:
        news, self._diverged = self._diverged, []
        if news:
            raise FloatingPointError("; ".join(news))


def _evaluate(run: TrainingRun, seconds: float, report: Callable[[Report], None]) -> Metrics:
    """Evaluate ``run``, which has taken ``seconds`` so far, save it and report that."""
    metrics = run.evaluate(seconds)
    run.save(metrics)
    report(Report(run, None, metrics))
    return metrics


def train_together(
    runs: Sequence[TrainingRun],
    *,
    trials: int | None = None,
    seconds: float | None = None,
    enough: Callable[[TrainingRun], bool] = lambda run: False,
    report: Callable[[Report], None] = lambda report: None,
    workers: int | None = None,
    stop: Callable[[], bool] = lambda: False,
    on_divergence: Literal["stop", "restore"] = "stop",
) -> None:
    """Advance several runs side by side, each in a thread (the compiled learner holds no lock).

    Parameters
    ----------
    runs : sequence of TrainingRun
        What to advance.
    trials : int, optional
        Each run stops at the first evaluation with at least this many trials.
    seconds : float, optional
        Wall-clock time after which all runs stop and are saved as they stand; what was never evaluated is, so that
        there is a result. More of them than workers share it.
    enough : callable
        As soon as it is true of one run after an evaluation, all runs stop.
    report : callable
        Called with news, from the threads of the runs.
    workers : int, optional
        Runs at a time; as many as there are cores by default.
    stop : callable
        When it says True, all runs stop after the stretch they are in, and are saved as they stand.
    on_divergence : "stop" or "restore"
        A run that diverges stops, or goes on from its last evaluation with other random numbers, :data:`RESTORES` times
        at most.

    Raises
    ------
    FloatingPointError
        When all others are done: it names the runs that have diverged, which stand where they last were evaluated.
    RunInUseError
        When another process learns in one of the directories; nothing was learned then.
    """
    restore = on_divergence == "restore"
    finished = threading.Event()
    diverged: list[str] = []

    def work(pack: Pack) -> None:
        deadline = time.monotonic() + share

        def over() -> bool:
            return finished.is_set() or time.monotonic() > deadline or stop()

        try:
            while pack.runs and not over():
                unfinished = [run for run in pack.runs if trials is None or run.evaluated_trial < trials]
                if len(unfinished) < len(pack.runs):
                    pack = Pack(unfinished, restore)
                try:
                    pack.advance(report, stop=over)
                except FloatingPointError as error:
                    diverged.append(str(error))
                if any(enough(run) for run in pack.runs):
                    finished.set()
            timed_out = time.monotonic() > deadline and not (finished.is_set() or stop())
            for run in pack.runs:
                if not (timed_out and run.trial > 0 and not run.history):
                    run.save_unfinished()  # it may be out of step with the one that was evaluated last
                    continue
                try:
                    _evaluate(run, run.seconds, report)
                except FloatingPointError as error:
                    run.save_unfinished()
                    diverged.append(f"{run.directory}: {error}; it was not evaluated")
        except BaseException:
            finished.set()
            raise

    workers = workers or os.cpu_count() or 1
    with contextlib.ExitStack() as held, ThreadPoolExecutor(workers) as pool:
        for run in runs:
            held.enter_context(run.held())
        packs = Pack.of(runs, workers, restore)
        share = np.inf if seconds is None else seconds / math.ceil(len(packs) / workers)
        futures = [pool.submit(work, pack) for pack in packs]
        try:
            for future in futures:
                future.result()
        except BaseException:
            finished.set()
            raise
    if diverged:
        raise FloatingPointError("; ".join(diverged))
