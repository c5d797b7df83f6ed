"""Many runs of one question: each has a directory of its own, all have a row of one table.

The same jobs in the same directory go on where they stopped. Runs that their method can put in a team learn in step,
whatever their settings (:mod:`~swimmer_mj.learning.runs.together`). Where they learn is the business of an engine.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swimmer_mj.files import replacing
from swimmer_mj.learning.method import TeamMethod
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import CONFIG, RunConfig, read_config
from swimmer_mj.learning.runs.engines.local import LocalEngine
from swimmer_mj.learning.runs.jobs import Engine, Job, News, state_of
from swimmer_mj.learning.runs.run import CHECKPOINT

__all__ = ["as_they_began", "grid", "random_search", "rows_of", "run_jobs", "settings_name", "write_rows"]

COUNTED = ("trials", "seconds", "speed", "last_speed", "state")
"""The columns of the table that are no settings."""


def grid(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of ``values``, the last name fastest."""
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


def random_search(laws: Mapping[str, Any], samples: int, seed: int) -> list[dict[str, Any]]:
    """``samples`` draws of each name: from a list, or between ``low`` and ``high``, uniform there or in the logarithm.

    Two integers give integers. More samples begin with the same draws.
    """
    rng = np.random.default_rng(seed)
    return [
        {name: _draw(name, law, float(rng.random())) for name, law in laws.items()} for _ in range(samples)
    ]


def _draw(name: str, law: Any, u: float) -> Any:
    """The value of ``law`` at the quantile ``u``."""
    if isinstance(law, list) and law:
        return law[int(u * len(law))]
    if not (isinstance(law, dict) and {"low", "high"} <= {*law} <= {"low", "high", "scale"}):
        raise ValueError(
            f"[random] {name} must be a list, or like {{low = 0.01, high = 1.0, scale = 'log'}}; got {law!r}"
        )
    low, high, scale = law["low"], law["high"], law.get("scale", "linear")
    numbers = all(type(bound) in (int, float) and np.isfinite(bound) for bound in (low, high))
    if not numbers or low >= high or scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise ValueError(
            f"[random] {name}: low must be less than high, both positive if scale is 'log'; scale must be 'linear' or "
            f"'log'; got {law!r}"
        )
    value = low * (high / low) ** u if scale == "log" else low + u * (high - low)
    return round(value) if type(low) is type(high) is int else float(f"{value:.4g}")


def settings_name(settings: Mapping[str, Any]) -> str:
    """A name of a directory that says what ``settings`` are; "run" of none."""
    words = (f"{name}-{_plain(json.dumps(value))}" for name, value in settings.items())
    return "_".join(words)[:150] or "run"


def _plain(text: str) -> str:
    """``text`` with all but letters, digits and ``.+-_`` as dashes: good in the name of a file on any system."""
    sign = "-" if re.match(r"\W*-[\d.]", text) else ""
    return sign + re.sub(r"[^\w.+-]+", "-", text).strip("-")


def run_jobs(
    jobs: Sequence[Job],
    directory: Path,
    trials: int,
    *,
    engine: Engine | None = None,
    report: Callable[[News], None] = lambda news: None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Have all ``jobs`` learn ``trials`` trials, those left from an earlier call only what is left of them.

    A run that diverges says so in its row; the others go on. They learn on this machine, if no ``engine`` is given.
    """
    jobs = as_they_began(jobs, directory)
    (engine or LocalEngine()).run(jobs, directory, trials, report, stop)


def as_they_began(jobs: Sequence[Job], directory: Path) -> list[Job]:
    """``jobs``, those that are in ``directory`` as they began there, when there may have been fewer of them.

    So many runs at a time may have another engine, where that was left open.

    Raises
    ------
    ValueError
        A run in ``directory`` has other settings.
    """
    return [_as_it_began(job, directory / job.name) for job in jobs]


def _as_it_began(job: Job, path: Path) -> Job:
    if not (path / CONFIG).exists():
        return job
    known = read_config(path)
    if known != job.config and _among_many(known) != _among_many(job.config):
        raise ValueError(f"{path} holds a run with other settings; choose another directory with --out")
    return dataclasses.replace(job, config=known)


def _among_many(config: RunConfig) -> RunConfig:
    """``config`` as it is for many runs at a time."""
    method = config.method
    if isinstance(method, TeamMethod):
        method = method.for_seeds(config.problem, sys.maxsize)
    return dataclasses.replace(config, method=method)


def rows_of(jobs: Sequence[Job], directory: Path, trials: int) -> list[dict[str, Any]]:
    """A row a job: its directory, seed and settings, and at its last evaluation trials, seconds, and speeds.

    ``speed`` is that of the best evaluation, ``last_speed`` that of the last; of a problem that is no swimmer, mean
    rewards.
    """
    rows = []
    for job in jobs:
        path = directory / job.name
        row: dict[str, Any] = {"job": job.name, "seed": job.config.seed, **job.settings}
        row |= {
            "trials": 0,
            "seconds": 0.0,
            "speed": None,
            "last_speed": None,
            "state": state_of(path, trials),
        }
        if (path / CHECKPOINT).exists():
            info = load_checkpoint(path / CHECKPOINT)[1]
            row |= {"trials": info["trial"], "seconds": info["seconds"]}
            last = info["history"][-1][-1]
            row |= {"speed": info["best_speed"], "last_speed": last if np.isfinite(last) else None}
        rows.append(row)
    return rows


def write_rows(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """As CSV; a value that is no number or string as JSON, and None as an empty cell."""
    with replacing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _cell(value) for name, value in row.items()})


def _cell(value: Any) -> Any:
    return value if value is None or isinstance(value, str | int | float) else json.dumps(value)
