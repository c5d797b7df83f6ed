"""What is seen of runs while they learn: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swimmer_mj.cli.output import make_table, print_line

if TYPE_CHECKING:
    from rich.console import Console

    from swimmer_mj.learning.runs.run import TrainingRun
    from swimmer_mj.learning.runs.together import Report

__all__ = ["QUIET", "LearningDisplay", "time_left", "time_words"]

QUIET = 30.0
"""s without a line, where there is no live table."""


class LearningDisplay:
    """The news of runs that learn until ``trials`` or for ``seconds``, whichever is first."""

    def __init__(
        self, console: Console, runs: Sequence[TrainingRun], trials: int | None, seconds: float | None
    ) -> None:
        from swimmer_mj.learning.problems.forms import SwimmerForm

        self._console, self._trials, self._seconds = console, trials, seconds
        self._started = time.monotonic()
        self._news: dict[int, dict[str, str]] = {id(run): {"run": run.directory.name} for run in runs}
        self._first: dict[int, tuple[float, int]] = {}  # when a run was first heard of, and its trials then
        self._said = dict.fromkeys(self._news, self._started)  # when it last had a line
        swimmers = all(run.problem.form(SwimmerForm) is not None for run in runs)
        self._speed = "speed" if swimmers else "reward"
        self._units = (" m", " m²/s²", " m/s") if swimmers else ("", "", "")
        self._columns = ("run", "trials", "trials/s", "elapsed", "left", "<V>", "<H²>", self._speed, "best")

    def table(self) -> Any:
        """A row a run."""
        from rich.markup import escape

        drawn = make_table(None, self._columns)
        for row in self._news.values():
            drawn.add_row(*(escape(row.get(column, "")) for column in self._columns))
        return drawn

    def note(self, report: Report, live: bool) -> None:
        """Take news; where there is no table, print a line after an evaluation and each :data:`QUIET` s."""
        if report.warning is not None:
            print_line(self._console, report.warning)
        key, now = id(report.run), time.monotonic()
        row = self._news[key]
        row["elapsed"] = time_words(now - self._started)
        if (progress := report.progress) is not None:
            since, trial = self._first.setdefault(key, (now, progress.trial))
            left = None if self._trials is None else self._trials - progress.trial
            ends = math.inf if self._seconds is None else self._started + self._seconds - now
            seconds = min(ends, time_left(left, progress.trial - trial, now - since))
            row["trials"] = f"{progress.trial:,}"
            row["trials/s"] = f"{progress.trials_per_second:.0f}"
            row["left"] = "" if seconds == math.inf else time_words(seconds)
        if (metrics := report.metrics) is not None:
            in_m, in_m2_s2, in_m_s = self._units
            row["<V>"] = f"{metrics.mean_value:.3f}{in_m}"
            row["<H²>"] = f"{metrics.mean_squared_hamiltonian:.3f}{in_m2_s2}"
            row[self._speed] = f"{metrics.speed:.3f}{in_m_s}"
            row["best"] = f"{report.run.best_speed:.3f}{in_m_s}"
        if not live and (report.metrics is not None or now - self._said[key] > QUIET):
            self._said[key] = now
            line = "  ".join(f"{column} {row[column]}" for column in self._columns if row.get(column))
            print_line(self._console, line)


def time_left(trials_left: int | None, trials: int, seconds: float) -> float:
    """Seconds that ``trials_left`` will take when ``trials`` took ``seconds``; infinite if that is not known."""
    if trials_left is None or trials <= 0:
        return math.inf
    return max(0.0, trials_left * seconds / trials)


def time_words(seconds: float) -> str:
    """As people say it: 48 s, 12 min 5 s, 3 h 20 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{max(whole, 0)} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
