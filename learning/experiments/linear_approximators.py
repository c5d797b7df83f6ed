"""Linear approximators, the paper's foil: they learn the pendulum well, and cannot grow to the swimmer.

Learning: normalised radial basis functions (15 x 15, as many as Doya 2000 had for the pendulum), tile coding (32
tilings of 12 x 13) and a cascade of 20 neurons learn the swing-up. Reward: mean of cos(theta) over the last 10 of
20 s from hanging and 15 random states; a seed succeeds where it is above 0.95 from every one of them. s_gamma and
s_lambda 1 1/s, trials of 5 s. Chosen on seeds 100 and 101: eta 10 among 1, 3, 10, 30 (radial basis: all learn); eta
30 with 32 tilings among some fifteen combinations of 3 to 300 with 8 to 64 tilings (most of which hold it for a
while and lose it again). Cascade: eta 0.04 with output scaling.

Cost: the swimmer of n links has 2n + 2 state variables. Radial basis functions with 5 centres a variable have 5^(2n+2)
features; 8 tilings of 5 tiles a variable (6 along a line, for the displaced grids to cover it) have more.
Measured where they fit into memory: time of V and dV/dx at a random state, once the grid is there, median of
several. Beside them a cascade of 12 n neurons, the paper's 60 at 5 links, whose number of weights is quadratic in
n. Larger ones are extrapolated by the figure: from the largest one measured, in proportion to the number of features
times that of the state variables, along each of which V is differentiated.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence

import numpy as np
import torch

from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.features import Axis, RadialBasis, TileCoding
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.linear import LinearTD
from swimmer_mj.parameters import SwimmerParameters

__all__ = [
    "APPROXIMATORS",
    "COST_LOG",
    "ETAS",
    "LEARNING_LOG",
    "make_learner",
    "n_features",
    "radial_basis",
    "run",
    "swimmer_axes",
    "tile_coding",
]

LEARNING_LOG = "linear.csv"
COST_LOG = "linear-cost.csv"

APPROXIMATORS = ("cascade", "radial basis", "tile coding")
ETAS = {"cascade": 0.04, "radial basis": 10.0, "tile coding": 30.0}
"""Learning rates on the pendulum."""
MOMENTS = (0, 50, 100, 200, 300, 500, 750, 1000, 1500, 2000)
PER_VARIABLE = 5
NEURONS_PER_LINK = 12
LARGEST = 2**24
"""Features beyond this are not built: 128 MiB for each of weights, traces and scratch."""


def radial_basis() -> RadialBasis:
    """The pendulum's: 15 angles x 15 angular velocities in [-8, 8] rad/s, which the swing-up stays within."""
    return RadialBasis((Axis(-math.pi, math.pi, 15, periodic=True), Axis(-8.0, 8.0, 15)))


def tile_coding() -> TileCoding:
    """The pendulum's: 32 tilings of 12 angles x 12 (+ 1) angular velocities."""
    return TileCoding((Axis(-math.pi, math.pi, 12, periodic=True), Axis(-8.0, 8.0, 12)), n_tilings=32)


def make_learner(approximator: str, seed: int) -> FusedTD | LinearTD:
    """A learner of the pendulum; the seed is that of the cascade's initial weights."""
    problem = Pendulum()
    match approximator:
        case "cascade":
            network = Cascade(problem.n_inputs, 20, generator=torch.Generator().manual_seed(seed))
            return FusedTD(problem, network, TDSettings(eta=ETAS["cascade"]))
        case "radial basis":
            return LinearTD(problem, radial_basis(), TDSettings(eta=ETAS["radial basis"]))
        case "tile coding":
            return LinearTD(problem, tile_coding(), TDSettings(eta=ETAS["tile coding"]))
    raise ValueError(f"approximator must be one of {', '.join(APPROXIMATORS)}, got {approximator!r}")


def swimmer_axes(n_links: int, count: int = PER_VARIABLE) -> tuple[Axis, ...]:
    """Axes of the reduced state: n angles, n angular velocities (rad/s), two velocities (m/s)."""
    angle, rate, velocity = Axis(-math.pi, math.pi, count, periodic=True), (-5.0, 5.0), (-1.5, 1.5)
    return (*[angle] * n_links, *[Axis(*rate, count)] * n_links, *[Axis(*velocity, count)] * 2)


def n_features(approximator: str, n_links: int) -> int:
    """Weights of V for the swimmer of ``n_links``."""
    match approximator:
        case "cascade":
            n, m = NEURONS_PER_LINK * n_links, 3 * n_links + 2
            return n * (m + 1) + n * (n - 1) // 2
        case "radial basis":
            return RadialBasis(swimmer_axes(n_links)).size
        case "tile coding":
            return TileCoding(swimmer_axes(n_links)).size
    raise ValueError(f"approximator must be one of {', '.join(APPROXIMATORS)}, got {approximator!r}")


def evaluation_time(approximator: str, n_links: int, repetitions: int = 7) -> float:
    """Seconds for V, dV/dx and the greedy control at one state of the swimmer: median of ``repetitions``."""
    problem = Swimming(SwimmerParameters(n_links))
    if approximator == "cascade":
        network = Cascade(
            problem.n_inputs, NEURONS_PER_LINK * n_links, generator=torch.Generator().manual_seed(0)
        )
        learner: FusedTD | LinearTD = FusedTD(problem, network)
    else:
        family = RadialBasis if approximator == "radial basis" else TileCoding
        learner = LinearTD(problem, family(swimmer_axes(n_links)))
    size = n_features(approximator, n_links)
    cheap = approximator != "radial basis" or size < 1e5
    states = problem.initial_states(np.random.default_rng(0), 2000 if cheap else 3)
    learner.sample(states[:1])
    times = []
    for _ in range(repetitions if cheap or size < 1e6 else 1):
        before = time.perf_counter()
        learner.sample(states)
        times.append((time.perf_counter() - before) / len(states))
    return float(np.median(times))


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    seeds: Sequence[int] = range(8),
    moments: Sequence[int] = MOMENTS,
    links: Sequence[int] = (2, 3, 4, 5, 6, 7, 8, 9, 10),
    largest: int = LARGEST,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Learn, measure the cost, and write both logs. About 10 minutes on one core; times differ from run to run."""
    problem = Pendulum()
    starts = np.concatenate([[[np.pi, 0.0]], problem.initial_states(np.random.default_rng(100), 15)])
    rows: list[tuple[str | float, ...]] = []
    for approximator in APPROXIMATORS:
        for seed in seeds:
            learner = make_learner(approximator, seed)
            rng = np.random.default_rng(seed)
            done = 0
            for trial in moments:
                if trial > done:
                    learner.train(problem.initial_states(rng, trial - done))
                    done = trial
                reward = learner.rollout(starts, 20.0, skip=10.0).reward
                rows.append((approximator, seed, trial, float(reward.mean()), float(reward.min())))
            report(f"{approximator}, seed {seed}: reward {rows[-1][3]:.3f}, lowest {rows[-1][4]:.3f}")
    header = ("approximator", "seed", "trial", "reward", "lowest")
    write_table(Path(directory) / LEARNING_LOG, header, rows, digits=4)

    costs: list[tuple[str | float, ...]] = []
    for approximator in APPROXIMATORS:
        for n_links in links:
            size = n_features(approximator, n_links)
            seconds = evaluation_time(approximator, n_links) if size <= largest else math.nan
            costs.append((approximator, n_links, size, seconds))
            report(f"{approximator}, {n_links} links: {size:.3g} weights, {seconds:.3g} s an evaluation")
    write_table(Path(directory) / COST_LOG, ("approximator", "links", "weights", "seconds"), costs, digits=4)
