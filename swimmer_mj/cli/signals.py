"""SIGINT and SIGTERM while a run learns: it finishes its step and saves; a second signal stops at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

__all__ = ["StoppedError", "asked_to_stop"]


class StoppedError(Exception):
    """A command was stopped by a signal, and everything is saved."""

    def __init__(self, number: int, message: str) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}; {message}")
        self.status = 128 + number


@contextlib.contextmanager
def asked_to_stop() -> Iterator[Callable[[], int | None]]:
    """A function that says which signal has asked for an end, if one has, while a block runs.

    After the first, both have their default action again: the second ends the process at once. Outside the main thread,
    and where the process that started this one has signals ignored, they are left alone.
    """
    got: list[int] = []
    before = {}

    def note(number: int, frame: FrameType | None) -> None:
        got.append(number)
        for each in before:
            signal.signal(each, signal.SIG_DFL)
        if sys.stderr.isatty():
            os.write(2, b"\nfinishing the step and saving; once more stops at once\n")

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, note)
    try:
        yield lambda: got[0] if got else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
