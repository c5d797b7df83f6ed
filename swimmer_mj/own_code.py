"""Modules of somebody's own: problems, methods and rewards that do not come with the package."""

from __future__ import annotations

import importlib
from types import ModuleType

__all__ = ["import_own"]


def import_own(module: str, what: str) -> ModuleType:
    """The module ``module``, for which ``what`` asks.

    Raises
    ------
    ValueError
        In one line, whatever it is that it does when it is imported.
    """
    try:
        return importlib.import_module(module)
    except (ImportError, ValueError) as error:
        raise ValueError(f"{what}: {error}; is its folder on Python's path?") from error
    except (Exception, SystemExit) as error:  # a script may end the process
        said = " ".join(str(error).split())
        raise ValueError(
            f"{what}: {module} fails when it is imported: {type(error).__name__}: {said}"
        ) from error
