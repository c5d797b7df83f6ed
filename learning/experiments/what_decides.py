"""What decides whether the swimmer learns: one choice changed at a time, eight seeds each.

The baseline is 5 links, 60 neurons, eta 0.04 and the choices of docs/deviations.md. Every variant learns for the same
simulated time, as many trials of its length as make up :data:`DURATION`; speed is the project's swimming speed, on the
compiled equations (docs/metrics.md). A seed whose weights overflow is kept: it swims at the speed of a limp swimmer.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swimmer_mj.learning.experiments.tables import LOGS, read_table, write_table
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.runs.run import evaluation_sample
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.td.population import LANES, PopulationTD

__all__ = ["BASELINE", "LOG", "VARIANTS", "Variant", "merge", "run"]

LOG = "what-decides.csv"
COLUMNS = (
    "factor",
    "setting",
    "seed",
    "simulated_seconds",
    "mean_value",
    "mean_squared_hamiltonian",
    "speed",
)
SEEDS = range(8)
DURATION = 150_000.0
"""Simulated time, s: 30,000 trials of 5 s."""

EVALUATIONS = 5

BASELINE = Swimming(), TemporalDifferences(TDSettings(eta=0.04), engine="population")


class Variant(NamedTuple):
    """One choice made differently."""

    factor: str
    setting: str
    problem: Swimming
    method: TemporalDifferences


def _variant(factor: str, setting: str, **changes: Any) -> Variant:
    problem, method = BASELINE
    of_learner, of_problem = (
        {name: changes.pop(name) for name in list(changes) if hasattr(thing, name)}
        for thing in (method.settings, problem)
    )
    method = dataclasses.replace(
        method, settings=dataclasses.replace(method.settings, **of_learner), **changes
    )
    return Variant(factor, setting, dataclasses.replace(problem, **of_problem), method)


VARIANTS = (
    _variant("baseline", "as chosen"),
    *(_variant("eta", f"{eta:g}", eta=eta) for eta in (0.01, 0.02, 0.08, 0.16, 0.32, 0.64)),
    *(_variant("s_lambda", f"{s:g}", s_lambda=s) for s in (0.0, 3.0, 10.0)),
    *(_variant("s_gamma", f"{s:g}", s_gamma=s) for s in (0.3, 0.5, 2.0)),
    *(_variant("trial length", f"{t:g} s", trial_duration=t) for t in (1.0, 2.5, 10.0)),
    *(_variant("initial states", law, initial_law=law) for law in ("rest", "fast", "straight")),
    _variant("angles", "raw", encoding="angle"),
    _variant("sigmoid", "logistic", sigmoid="logistic"),
    _variant("output rate", "not scaled", output_scaling=False),
)


def _packs(variants: Sequence[Variant]) -> list[list[tuple[Variant, int]]]:
    """Learners (variant, seed) that can share a population, up to 16 a pack."""
    alike: dict[Any, list[tuple[Variant, int]]] = {}
    for variant in variants:
        key = variant.method.team_key(variant.problem)
        alike.setdefault(key, []).extend((variant, seed) for seed in SEEDS)
    return [group[i : i + LANES] for group in alike.values() for i in range(0, len(group), LANES)]


def _learn(pack: Sequence[tuple[Variant, int]], duration: float) -> list[tuple[str | float, ...]]:
    """Rows of the log for one pack."""
    problem = pack[0][0].problem
    learners = [
        FusedTD(problem, variant.method.network(problem, seed), variant.method.settings)
        for variant, seed in pack
    ]
    population = PopulationTD(learners)
    rngs = [np.random.default_rng(seed) for _, seed in pack]
    states, sample = evaluation_states(problem.parameters.n_links), evaluation_sample(BASELINE[0])
    trial_duration = pack[0][0].method.settings.trial_duration
    rows: list[tuple[str | float, ...]] = []
    done = 0
    for k in range(1, EVALUATIONS + 1):
        total = round(k * duration / EVALUATIONS / trial_duration)
        while done < total:
            count = min(200, total - done)
            population.train(np.stack([problem.initial_states(rng, count) for rng in rngs], axis=1))
            done += count
        for (variant, seed), learner in zip(pack, learners, strict=True):
            judged = learner.sample(sample)
            speed = learner.rollout(states, EPISODE_DURATION, skip=SETTLING_TIME).reward.mean()
            rows.append(
                (
                    variant.factor,
                    variant.setting,
                    seed,
                    done * trial_duration,
                    float(judged.value.mean()),
                    float((judged.hamiltonian**2).mean()),
                    float(speed),
                )
            )
    return rows


def _require_part(part: Path, pack: Sequence[tuple[Variant, int]], duration: float) -> None:
    """Refuse a part of the log that is not that of the learners of ``pack``, all of them and to their end."""
    end = {row[:3]: float(row[3]) for row in _rows(part)}
    trial_duration = pack[0][0].method.settings.trial_duration
    expected_end = round(duration / trial_duration) * trial_duration
    if set(end) != {(one.factor, one.setting, seed) for one, seed in pack} or not np.allclose(
        list(end.values()), expected_end, rtol=1e-5
    ):
        raise ValueError(
            f"{part} is not of the learners that belong there, after {expected_end:g} s: finish the run that wrote it, "
            "or move it away"
        )


def run(
    directory: str | os.PathLike[str] = LOGS,
    report: Callable[[str], None] = print,
    *,
    variants: Sequence[Variant] = VARIANTS,
    duration: float = DURATION,
) -> None:
    """Learn with every variant and seed. A finished pack is kept in a part of the log until all are done."""
    directory, packs = Path(directory), _packs(variants)
    parts = [directory / f"{Path(LOG).stem}-part-{i}.csv" for i in range(len(packs))]
    for pack, part in zip(packs, parts, strict=True):
        if part.exists():
            _require_part(part, pack, duration)
    for pack, part in zip(packs, parts, strict=True):
        if not part.exists():
            write_table(part, COLUMNS, _learn(pack, duration))
        named = dict.fromkeys(f"{variant.factor} {variant.setting}" for variant, _ in pack)
        report(f"{part.name}: {', '.join(named)}")
    merge(parts, directory / LOG, variants)
    for part in parts:
        part.unlink()


def merge(parts: Sequence[Path], log: Path, variants: Sequence[Variant] = VARIANTS) -> None:
    """Write the rows of ``parts`` to one log, in the order of ``variants``."""
    order = {(one.factor, one.setting): i for i, one in enumerate(variants)}
    rows = [row for part in parts for row in _rows(part)]
    write_table(log, COLUMNS, sorted(rows, key=lambda row: order[str(row[0]), str(row[1])]))


def _rows(part: Path) -> list[tuple[str | float, ...]]:
    """The rows of a part, settings as they were written: tables read numbers where all cells are numbers."""
    table = read_table(part)
    rows = zip(*(table[name].tolist() for name in COLUMNS), strict=True)
    return [
        (factor, setting if isinstance(setting, str) else f"{setting:g}", *rest)
        for factor, setting, *rest in rows
    ]
