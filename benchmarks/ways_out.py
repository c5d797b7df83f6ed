"""What leads value gradients from the gait that they find, folded, to the faster ones along a stretched chain?

    python benchmarks/ways_out.py [--names "held flips" ...] [--seeds 330 331 ...] [--seconds 20]

adds to benchmarks/results/ways-out.csv, a row a learner: value gradients with V of the state, as ``swimmer-mj train
--method value-gradient`` has them, and with one thing changed: torques flipped for a third of a second, about half a
stroke, now and then; a horizon that grows while it learns; and trajectories that begin on the best known gait of 2 m/s
(docs/gaits.md). Beside these V of joints with held torques, which needs none of it. Judged on MuJoCo over seconds 30 to
60 from 64 initial states, and by the share of that time in which the chain is folded. One learner on one core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from gait_shares import best_gaits, swim
from numpy.typing import NDArray
from rich.console import Console
from yardstick import Row, fill, looks, swimming_and_steady_speed

from swimmer_mj.cli.training import configured
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.method import ValueGradients

OUT = Path(__file__).parent / "results" / "ways-out.csv"
COLUMNS = ("name", "seed", "cpu_seconds", "simulation_steps", "speed", "steady_speed", "folded")
FLIPPED, HOLD = 0.05, 35
"""Share of the time in which a torque is flipped, and for how many steps of 0.01 s it is at once."""
FROM, UNTIL, DURING = 1.5, 0.3, 4_000_000
"""s_gamma at the beginning, 1/s, and after so many steps of simulation, half of what 20 s allow; it falls by equal
factors in between."""
ON_A_GAIT, NOISE = 0.5, 0.1
"""Share of the trajectories that begin on the gait, and the deviation of each state variable there."""
SECOND = 1
"""Of the stream of random numbers that belongs to a variant alone."""

Array = NDArray[np.float64]
Learner = ValueGradientLearner[Any]


def as_train(learner: Learner, problem: Swimming, seed: int) -> Callable[[int], None]:
    """Nothing is changed."""
    return lambda steps: None


def held_flips(learner: Learner, problem: Swimming, seed: int) -> Callable[[int], None]:
    """Each torque of each trajectory is flipped for :data:`HOLD` steps at a time, across rounds."""
    engine, rng = learner._engine, np.random.default_rng([seed, SECOND])
    collect, left = (
        engine.collect,
        np.zeros((learner.settings.trajectories, len(problem.control_limits)), int),
    )
    start = FLIPPED / HOLD / (1 - FLIPPED)

    def explore(weights: torch.Tensor, x: Array, flips: Array) -> Any:
        flips = flips.copy()
        for flip in flips:
            left[(left == 0) & (rng.random(left.shape) < start)] = HOLD
            flip[left > 0] *= -1
            left[left > 0] -= 1
        return collect(weights, x, flips)

    engine.collect = explore
    return lambda steps: None


def longer_horizon(learner: Learner, problem: Swimming, seed: int) -> Callable[[int], None]:
    """s_gamma falls as time goes on."""
    engine: Any = learner._engine

    def set_horizon(steps: int) -> None:
        engine.s_gamma = FROM * (UNTIL / FROM) ** min(steps / DURING, 1.0)

    set_horizon(0)
    return set_horizon


def gait_starts(learner: Learner, problem: Swimming, seed: int) -> Callable[[int], None]:
    """Some trajectories begin near a state of the best known gait."""
    states, rng = best_gaits(problem.parameters.n_links)[2.0].states, np.random.default_rng([seed, SECOND])

    class Mixed(Swimming):
        def initial_states(self, rng_of_learner: np.random.Generator, count: int) -> Array:
            z = problem.initial_states(rng_of_learner, count)
            on = rng.random(count) < ON_A_GAIT
            of_gait = states[rng.integers(len(states), size=count)]
            return np.where(on[:, None], of_gait + NOISE * rng.normal(size=z.shape), z)

    learner.problem = Mixed(problem.parameters, problem.s_gamma)
    return lambda steps: None


VARIANTS: dict[str, tuple[dict[str, Any], Callable[[Learner, Swimming, int], Callable[[int], None]]]] = {
    "as train": ({}, as_train),
    "held flips": ({}, held_flips),
    "longer and longer horizon": ({}, longer_horizon),
    "starts on the best gait": ({}, gait_starts),
    "joints, held": ({"coordinates": "joints", "held": True}, as_train),
}
"""Options of the problem, and what is changed: a function that is told after each round how many steps there were."""


def learn(name: str, seed: int, seconds: float, console: Console) -> list[Row]:
    """The row of one learner."""
    options, change = VARIANTS[name]
    config = configured("swim", "value-gradient", options, 1)
    problem, method = config.problem, config.method
    assert isinstance(problem, Swimming)
    assert isinstance(method, ValueGradients)
    learner = method.start(problem, seed).learner
    heed = change(learner, problem, seed)
    learner.step()  # compiles

    def one_round() -> None:
        learner.step()
        heed(learner.simulation_steps)

    (clock,) = looks(one_round, (), seconds)
    policy = learner.policy()
    judged = *swimming_and_steady_speed(policy, problem.parameters), swim(policy, np.zeros(1)).folded.mean()
    numbers = (f"{number:.4f}" for number in judged)
    row = (name, seed, f"{clock.before[0]:.1f}", learner.simulation_steps, *numbers)
    console.print(*row)
    return [row]


def main(
    names: tuple[str, ...] = tuple(VARIANTS),
    seeds: Sequence[int] = tuple(range(330, 340)),
    seconds: float = 20.0,
    out: Path = OUT,
) -> None:
    """Learn each variant with each seed.

    Args:
        names: Which.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((name, seed) for seed in seeds for name in names)
    fill(out, COLUMNS, keys, lambda name, seed: learn(name, seed, seconds, console))


if __name__ == "__main__":
    tyro.cli(main)
