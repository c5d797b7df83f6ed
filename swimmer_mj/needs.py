"""What is said where dm_control is missing, which only its own tasks need."""

from __future__ import annotations

import sys

__all__ = ["MissingDmControlError"]


class MissingDmControlError(ModuleNotFoundError):
    """What was asked for needs dm_control; the message is one line and says what to do.

    Parameters
    ----------
    what : str
        What was asked for.
    instead : str, optional
        What does without dm_control, as an imperative.
    """

    def __init__(self, what: str, instead: str = "") -> None:
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        if sys.version_info >= (3, 13):
            why = f"cannot be installed on Python {version} (labmaze has no wheels from 3.13 on)"
            way = "use Python 3.11 or 3.12"
        else:
            why, way = "is not installed", "pip install dm-control"
        super().__init__(f"{what} needs dm_control, which {why}: {way}{instead and f', or {instead}'}")
