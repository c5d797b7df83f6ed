"""The linear foil for real: tile coding learns to swim with 3 links, beside the cascade.

5 tiles a variable in 8 tilings are 7.8 million weights for its 8 state variables; 4 links would need 233 million.
Sixteen settings of tile coding, the first one of our own making and the others drawn at random, learn for 10,000 trials
with one seed; the four that swim fastest over the second half of that go on to two other seeds and 20,000 trials, and
the best of these to eight seeds and 60,000, beside a cascade of 30 neurons with the rate that ``swimmer-mj train``
has. Everything else is alike: s_gamma 1 1/s, trials of 5 s, initial states and evaluation.
Speeds are those of the compiled equations (docs/metrics.md). A learner whose weights overflow stands still.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.experiments.linear_approximators import swimmer_axes
from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.runs.sweep import random_search
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.features import TileCoding
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.linear import LinearTD
from swimmer_mj.learning.td.method import ETA
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["BEST_KNOWN", "HEADER", "LAWS", "LOG", "best", "learn", "make_cascade", "make_tiles", "run"]

LOG = "linear-swimmer.csv"
LINKS = 3
NEURONS = 30
"""Of the cascade, the output counted."""
BEST_KNOWN: dict[str, Any] = {"eta": 3.0, "tilings": 32, "tiles": 4, "slope_width": 1.0, "s_lambda": 1.0}
LAWS: dict[str, Any] = {
    "eta": {"low": 0.3, "high": 10.0, "scale": "log"},
    "tilings": [8, 16, 32],
    "tiles": [3, 4, 5],
    "slope_width": [1.0, 2.0],
    "s_lambda": [0.0, 1.0, 3.0],
}
"""Learning rate, tilings, tiles a variable, the width over which V is averaged for its slope (tiles), and 1/s."""
HEADER = (
    "stage", "approximator", *LAWS, "weights", "seed", "trial", "seconds", "value", "squared_hamiltonian", "speed",
    "used",
)  # fmt: skip
"""``value`` and ``squared_hamiltonian`` are means along the last 100 trials, ``used`` the share of weights not 0."""
SAMPLES = 16
LOOKS = 10
Row = tuple[str | float, ...]


def problem() -> Swimming:
    """The swimmer of 3 links."""
    return Swimming(SwimmerParameters(LINKS))


def make_tiles(settings: Mapping[str, Any]) -> LinearTD:
    """Tile coding by settings of :data:`LAWS`."""
    axes = swimmer_axes(LINKS, settings["tiles"])
    features = TileCoding(axes, n_tilings=settings["tilings"], slope_width=settings["slope_width"])
    return LinearTD(problem(), features, TDSettings(eta=settings["eta"], s_lambda=settings["s_lambda"]))


def make_cascade(seed: int) -> FusedTD:
    """The paper's network."""
    swimmer = problem()
    network = Cascade(swimmer.n_inputs, NEURONS, generator=torch.Generator().manual_seed(seed))
    return FusedTD(swimmer, network, TDSettings(eta=ETA))


def weights_of(learner: FusedTD | LinearTD) -> NDArray[Any]:
    """Those that there are."""
    if isinstance(learner, LinearTD):
        return learner.weight
    return learner.weight.numpy()[learner.network.connected.numpy()]


def learn(
    learner: FusedTD | LinearTD, seed: int, trials: int, looks: int = LOOKS
) -> Iterator[tuple[float, ...]]:
    """Columns of :data:`HEADER` from "trial" on, ``looks`` times; seconds are of the processor, without the looks."""
    starts, rng, seconds = evaluation_states(LINKS), np.random.default_rng(seed), 0.0
    for look in range(1, looks + 1):
        states = learner.problem.initial_states(rng, trials // looks)
        before = time.process_time()
        statistics = learner.train(states)
        seconds += time.process_time() - before
        weight = weights_of(learner)
        speed = 0.0
        if np.isfinite(weight).all():
            speed = float(learner.rollout(starts, EPISODE_DURATION, skip=SETTLING_TIME).reward.mean())
        means = statistics.value[-100:].mean(), statistics.squared_hamiltonian[-100:].mean()
        used = np.count_nonzero(weight) / weight.size
        yield (look * (trials // looks), seconds, *map(float, means), speed, used)


def best(rows: Sequence[Row], stage: str, count: int) -> list[dict[str, Any]]:
    """The settings that swam fastest over the second half of a stage, mean over seeds; the fastest first."""
    tried: dict[tuple[str | float, ...], list[Row]] = {}
    for row in rows:
        if row[0] == stage:
            tried.setdefault(row[2 : 2 + len(LAWS)], []).append(row)

    def late(settings: tuple[str | float, ...]) -> float:
        end = max(float(row[HEADER.index("trial")]) for row in tried[settings])
        of = [row for row in tried[settings] if float(row[HEADER.index("trial")]) > end / 2]
        return float(np.mean([float(row[HEADER.index("speed")]) for row in of]))

    return [dict(zip(LAWS, one, strict=True)) for one in sorted(tried, key=late, reverse=True)[:count]]


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    samples: int = SAMPLES,
    trials: Sequence[int] = (10_000, 20_000, 60_000),
    seeds: Sequence[Sequence[int]] = ((100,), (101, 102), tuple(range(8))),
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Choose, learn, and write :data:`LOG` in ``directory``. Less than an hour on one core."""
    rows: list[Row] = []

    def add(
        stage: str, name: str, learner: FusedTD | LinearTD, settings: Mapping[str, Any], k: int, seed: int
    ) -> None:
        own = (
            stage,
            name,
            *(settings.get(key, float("nan")) for key in LAWS),
            weights_of(learner).size,
            seed,
        )
        rows.extend((*own, *look) for look in learn(learner, seed, trials[k]))
        report(f"{stage}, {name}, {dict(settings)}, seed {seed}: {rows[-1][HEADER.index('speed')]:.3f} m/s")
        write_table(Path(directory) / LOG, HEADER, rows, digits=4)

    for learner in (make_tiles(BEST_KNOWN), make_cascade(0)):  # what is compiled, is compiled now
        learner.train(learner.problem.initial_states(np.random.default_rng(0), 1))
    chosen = [BEST_KNOWN, *(BEST_KNOWN | one for one in random_search(LAWS, samples - 1, seed=0))]
    for k, (stage, after) in enumerate((("first", 4), ("second", 1), ("final", 0))):
        for settings in chosen:
            for seed in seeds[k]:
                add(stage, "tile coding", make_tiles(settings), settings, k, seed)
        if after:
            chosen = best(rows, stage, after)
    for seed in seeds[2]:
        add("final", "cascade", make_cascade(seed), {"eta": ETA, "s_lambda": 1.0}, 2, seed)
