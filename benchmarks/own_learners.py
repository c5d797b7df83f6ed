"""How fast do the learners of this project learn to swim? By processor time and by simulation steps.

    python benchmarks/own_learners.py

adds to benchmarks/results/own-learners.csv, a row an evaluation: value gradients (docs/beyond.md), also those of joints
and torques to be held, and the paper's TD(lambda), with the settings that ``swimmer-mj train`` has for them, each
learner on one core. What is there already is not done again; compilation is not counted. ``compare_learners.py`` makes
the table and the plot. Needs the extra ``gymnasium``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from yardstick import Clock, Row, append, finished, row, swimming_speed

from swimmer_mj.learning.networks.actors import BatchActor
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import SwimmingSpeed
from swimmer_mj.learning.td import method as td
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.value_gradient import method as value_gradients
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "own-learners.csv"
SECONDS = {"value-gradient": 60.0, "value-gradient-joints": 60.0, "td": 200.0}
FIRST_LOOK = {"value-gradient": 0.2, "value-gradient-joints": 1.0, "td": 10.0}  # s
GROWTH = {"value-gradient": 1.3, "value-gradient-joints": 1.3, "td": 1.15}  # of the time from look to look
TRIALS = 20  # of TD(lambda) between looks at the clock

Name = Literal["value-gradient", "value-gradient-joints", "td"]
Array = NDArray[np.float64]


class Learner(Protocol):
    """What is timed."""

    def learn(self) -> None:
        """A little more."""
        ...

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s that have been simulated."""
        ...

    def policy(self) -> Callable[[Array], Array]:
        """From states to torques (N m), as learned so far."""
        ...


class ValueGradients:
    """``swimmer-mj train --method value-gradient``."""

    def __init__(self, seed: int, problem: Swimming | None = None) -> None:
        problem = problem or Swimming(s_gamma=0.5)
        settings = ValueGradientSettings(**problem.advice)
        self.learner = value_gradients.ValueGradients(settings).start(problem, seed).learner

    def learn(self) -> None:
        """One round."""
        self.learner.step()

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s that have been simulated."""
        return self.learner.simulation_steps

    def policy(self) -> Callable[[Array], Array]:
        """By the averaged weights."""
        return self.learner.control


class WithJoints(ValueGradients):
    """``swimmer-mj train --method value-gradient --coordinates joints --held``."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, Swimming(s_gamma=0.5, coordinates="joints", held=True))


class TemporalDifferences:
    """``swimmer-mj train``: the paper's algorithm with a larger learning rate."""

    def __init__(self, seed: int) -> None:
        method = td.TemporalDifferences()
        self.problem = Swimming()
        self.fused = FusedTD(self.problem, method.network(self.problem, seed), method.settings)
        self.rng = np.random.default_rng(seed)
        self.simulation_steps = 0
        self.steps = TRIALS * method.settings.steps_per_trial

    def learn(self) -> None:
        """Some trials."""
        self.fused.train(self.problem.initial_states(self.rng, TRIALS))
        self.simulation_steps += self.steps

    def policy(self) -> Callable[[Array], Array]:
        """By the weights as they are, compiled for batches."""
        actor, weights = BatchActor(self.problem, self.fused.network), self.fused.weight.flatten().clone()
        return lambda states: actor.control(weights, states)


LEARNERS: dict[str, type[ValueGradients | TemporalDifferences]] = {
    "value-gradient": ValueGradients,
    "value-gradient-joints": WithJoints,
    "td": TemporalDifferences,
}


def speed_of(policy: Callable[[Array], Array]) -> SwimmingSpeed:
    """On MuJoCo, of a policy in N m."""
    return swimming_speed(lambda states: policy(states) / PAPER.torque_limits)


def run(name: str, seed: int, seconds: float) -> list[Row]:
    """Learn for so much processor time, with looks in between that do not count."""
    learner: Learner = LEARNERS[name](seed)
    rows: list[Row] = []
    clock, look = Clock(), FIRST_LOOK[name]
    while clock.read()[0] < seconds:
        learner.learn()
        if clock.read()[0] >= min(look, seconds):
            clock.stop()
            speed = speed_of(learner.policy())
            rows.append(row(name, seed, clock, learner.simulation_steps, speed))
            Console().print(*rows[-1])
            look *= GROWTH[name]
            clock.start()
    return rows


def main(
    algorithms: Sequence[Name] = ("value-gradient", "value-gradient-joints", "td"),
    seeds: Sequence[int] = tuple(range(10)),
    seconds: float | None = None,
    out: Path = OUT,
) -> None:
    """Train each algorithm with each seed, one after the other.

    Args:
        algorithms: Which.
        seeds: Of networks and initial states.
        seconds: Processor time of each; by default 60 for value gradients, 200 for TD(lambda).
        out: CSV to append rows to, those of a learner when it is done.
    """
    torch.set_num_threads(1)
    for name in algorithms:
        left = [seed for seed in seeds if (name, str(seed)) not in finished(out)]
        if left:
            compiled: Learner = LEARNERS[name](0)
            compiled.learn()
        for seed in left:
            append(out, run(name, seed, SECONDS[name] if seconds is None else seconds))


if __name__ == "__main__":
    tyro.cli(main)
