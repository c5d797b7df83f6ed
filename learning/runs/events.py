"""The rows of metrics.csv as TensorBoard's events."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from swimmer_mj.learning.runs.run import Metrics

__all__ = ["EVENTS", "EventLogs", "require_writer"]

EVENTS = "tensorboard"
"""The directory of the events, in that of the run."""


class EventLogs:
    """Writes the events of several runs.

    A scalar a column, at the step ``trial``; the clock of an event is the run's ``seconds``. A run's events are written
    anew from its log with the first row that comes, so that the two say the same after a crash, too.
    """

    def __init__(self) -> None:
        require_writer()
        self._writers: dict[Path, Any] = {}

    def note(self, directory: Path, history: list[Metrics]) -> None:
        """Write the last row of ``history``, of the run in ``directory``; the first time, all of them."""
        if directory in self._writers:
            history = history[-1:]
        else:
            from tensorboardX import SummaryWriter

            for old in (directory / EVENTS).glob("events.out.tfevents.*"):
                old.unlink()
            self._writers[directory] = SummaryWriter(str(directory / EVENTS), flush_secs=20)
        for row in history:
            for name in ("mean_value", "mean_squared_hamiltonian", "speed"):
                self._writers[directory].add_scalar(name, getattr(row, name), row.trial, walltime=row.seconds)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for writer in self._writers.values():
            writer.close()


def require_writer() -> None:
    """ValueError if the package that writes events is not there."""
    if importlib.util.find_spec("tensorboardX") is None:
        raise ValueError('--tensorboard needs tensorboardX: pip install "swimmer-mj[tensorboard]"')
