"""What defines a run: a problem, a method, a seed. config.json has all of it.

The file has a schema number. Files of version 0.1, which had none, are converted when they are read.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from swimmer_mj.learning.method import Method
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs import registry
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

__all__ = ["CONFIG", "SCHEMA", "RunConfig", "convert", "read_config", "value_gradient_config"]

CONFIG = "config.json"
SCHEMA = 2
"""Of config.json."""


@dataclass(frozen=True)
class RunConfig:
    """A run is a problem and a method."""

    problem: ControlProblem = field(default_factory=Swimming)
    method: Method = field(default_factory=TemporalDifferences)
    seed: int = 0
    evaluate_every: int = 2000
    """Trials between evaluations."""

    def __post_init__(self) -> None:
        if not (type(self.seed) is int and self.seed < 2**63):
            raise ValueError(f"seed must be an integer less than 2**63, got {self.seed!r}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if not (type(self.evaluate_every) is int and self.evaluate_every >= 1):
            raise ValueError(f"evaluate_every must be at least 1 trial, got {self.evaluate_every!r}")

    def to_json(self) -> dict[str, Any]:
        """The configuration as JSON values, with the version that wrote it."""
        return {
            "schema": SCHEMA,
            "version": version("swimmer-mj"),
            "seed": self.seed,
            "evaluate_every": self.evaluate_every,
            "problem": registry.to_json(self.problem, registry.PROBLEMS),
            "method": registry.to_json(self.method, registry.METHODS),
        }

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> RunConfig:
        """The configuration that :meth:`to_json` wrote, or version 0.1."""
        if not isinstance(values, dict):
            raise ValueError(f"it must be a JSON object, got {str(values)[:40]!r}")
        if "schema" not in values:
            values = convert(values)
        if values["schema"] != SCHEMA:
            raise ValueError(f"schema must be {SCHEMA}, got {values['schema']!r}: written by a newer version")
        if unknown := values.keys() - {"schema", "version", "seed", "evaluate_every", "problem", "method"}:
            raise ValueError(f"there is no {min(unknown)!r}")
        return cls(
            registry.from_json(values["problem"], registry.PROBLEMS, "problem"),
            registry.from_json(values["method"], registry.METHODS, "method"),
            values["seed"],
            values["evaluate_every"],
        )


def value_gradient_config(seed: int = 0) -> RunConfig:
    """The configuration of value gradients that was found to learn fastest; docs/beyond.md."""
    problem = Swimming(s_gamma=ValueGradients.s_gamma)
    method = ValueGradients(ValueGradientSettings(**problem.advice))
    return RunConfig(problem, method, seed, method.evaluate_every)


def convert(old: dict[str, Any]) -> dict[str, Any]:
    """A config.json of version 0.1, which held the settings of both methods side by side, in the present schema."""
    problem: dict[str, Any] = {"name": old["problem"], "s_gamma": old["s_gamma"]}
    if old["problem"] == "swim":
        keys = ("parameters", "physics", "encoding", "initial_law")
        problem |= {key: old[key] for key in keys}
    method: dict[str, Any] = {key: old[key] for key in ("neurons", "dtype", "sigmoid")}
    if old.get("method", "td") == "td":
        method |= {"name": "td", "settings": old["td"], "engine": old["engine"]}
    else:
        engine = "torch" if old["engine"] == "torch" else "auto"
        method |= {"name": "value-gradient", "settings": old["value_gradient"], "engine": engine}
        method |= {"layers": old["layers"], "device": old["device"]}
    return {
        "schema": SCHEMA,
        "version": old["version"],
        "seed": old["seed"],
        "evaluate_every": old["evaluate_every"],
        "problem": problem,
        "method": method,
    }


def read_config(directory: str | os.PathLike[str]) -> RunConfig:
    """The configuration of the run in ``directory``."""
    path = Path(directory) / CONFIG
    if not path.is_file():
        raise FileNotFoundError(f"{os.fspath(directory)} is not a run directory: it has no {CONFIG}")
    try:
        return RunConfig.from_json(json.loads(path.read_text(encoding="utf-8")))
    except KeyError as error:
        raise ValueError(f"{path} is not the configuration of a run: it lacks {error}") from error
    except (TypeError, AttributeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path} is not the configuration of a run: {error}") from error
