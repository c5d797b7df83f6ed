"""Coulom's (2002) swimmer: its physics, a dm_control task of it, and the learner that made it swim.

    env = swimmer_mj.load("swim5")                # a dm_control Environment
    swimmer_mj.register()                         # then dm_control.suite.load("coulom_swimmer", "swim5")
    p = swimmer_mj.SwimmerParameters(n_links=4)   # SI units; swimmer_mj.PAPER has the paper's values

Importing this package imports neither MuJoCo nor torch and changes nothing; each part is imported when it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swimmer_mj.environments.suite import SUITE, load, register, unregister
    from swimmer_mj.parameters import PAPER, SwimmerParameters

    __version__: str

__all__ = ["PAPER", "SUITE", "SwimmerParameters", "__version__", "load", "register", "unregister"]

_HOME = {
    "PAPER": "parameters",
    "SUITE": "environments.suite",
    "SwimmerParameters": "parameters",
    "load": "environments.suite",
    "register": "environments.suite",
    "unregister": "environments.suite",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        from importlib import import_module

        return getattr(import_module(f"swimmer_mj.{_HOME[name]}"), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("swimmer-mj")
    raise AttributeError(f"module 'swimmer_mj' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
