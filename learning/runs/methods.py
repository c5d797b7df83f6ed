"""The two ways to learn, as a training run sees them: so much more experience, a judgement, what to save."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.environments import suite
from swimmer_mj.learning.td.continuous_td import ContinuousTD, Learner, Moment
from swimmer_mj.learning.runs.evaluation import EPISODE_DURATION, SETTLING_TIME
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.networks.networks import Cascade, ValueNetwork
from swimmer_mj.learning.networks.policy import observed_state
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner

if TYPE_CHECKING:
    from swimmer_mj.learning.runs.trainer import TrainConfig

__all__ = ["TemporalDifferences", "ValueGradients", "learn_in_environment", "make_learning"]

Array = NDArray[np.float64]


class TemporalDifferences:
    """Learning by continuous TD(lambda), with one of its engines."""

    def __init__(self, config: TrainConfig, problem: ControlProblem, network: Cascade) -> None:
        self.config = config
        self.problem = problem
        self.fused = FusedTD(problem, network, config.td)
        self.torch = ContinuousTD(problem, network, config.td) if config.engine == "torch" else None
        self.step_size = f"eta {config.td.eta}"

    def learn(self, count: int, done: int, rng: np.random.Generator) -> tuple[float, float]:
        """``count`` trials from random states; mean V and mean H^2 along them."""
        states = self.problem.initial_states(rng, count)
        if self.config.engine != "torch" and self.config.physics == "analytic":
            trials = self.fused.train(states)
            return float(trials.value.mean()), float(trials.squared_hamiltonian.mean())
        learner: Learner = self.fused if self.torch is None else self.torch
        if self.config.physics == "mujoco":
            moments = learn_in_environment(learner, self.config, states)
        else:
            assert self.torch is not None
            moments = [moment for x in states for moment in self.torch.run_trial(x)]
        values = np.array([moment.value for moment in moments])
        hamiltonians = np.array([moment.hamiltonian for moment in moments])
        return float(values.mean()), float((hamiltonians**2).mean())

    def judge(self, states: Array) -> tuple[Array, Array]:
        """V and H at ``states``."""
        sample = self.fused.sample(states)
        return sample.value, sample.hamiltonian

    def rewards(self, states: Array) -> Array:
        """Mean reward over the last 10 of 20 s from each of ``states``, on the compiled model."""
        return self.fused.rollout(states, EPISODE_DURATION, skip=SETTLING_TIME).reward

    def result(self) -> Cascade:
        """The network that acts."""
        return self.fused.network

    def tensors(self) -> dict[str, torch.Tensor]:
        """What is saved."""
        variance, rate = (
            (self.fused.variance, self.fused.rate)
            if self.torch is None
            else (self.torch.variances[0], self.torch.rates[0])
        )
        return {"weight": self.fused.weight, "variance": variance, "rate": rate}

    def info(self) -> dict[str, Any]:
        """What else is saved."""
        return {}

    def restore(self, tensors: dict[str, torch.Tensor], info: dict[str, Any]) -> None:
        """Go on from what was saved."""
        for name, tensor in self.tensors().items():
            tensor.copy_(tensors[name])


class ValueGradients:
    """Learning of value gradients; see :mod:`swimmer_mj.learning.value_gradient.equations`."""

    def __init__(self, config: TrainConfig, problem: ControlProblem, network: ValueNetwork) -> None:
        self.config = config
        self.problem = problem
        engine = "torch" if config.engine == "torch" else "auto"
        self.learner = ValueGradientLearner(
            problem, network, config.value_gradient, seed=config.seed, engine=engine
        )
        self.step_size = f"learning_rate {config.value_gradient.learning_rate}"

    def learn(self, count: int, done: int, rng: np.random.Generator) -> tuple[float, float]:
        """Rounds until ``done + count`` trials' worth of time is simulated; mean V along the last one."""
        value = math.nan
        config = self.config
        # A trial is so many seconds, whatever the method's step is.
        steps_of_td = config.value_gradient.dt / config.td.dt
        while self.learner.simulation_steps * steps_of_td < (done + count) * config.steps_per_trial:
            value = self.learner.step().value
        return value, math.nan

    def judge(self, states: Array) -> tuple[Array, Array]:
        """V and H at ``states``, by the averaged weights."""
        judged = self.learner.policy().judge(states)
        return judged.value, judged.hamiltonian

    def rewards(self, states: Array) -> Array:
        """Mean reward over the last 10 of 20 s from each of ``states``, by the averaged weights."""
        return self.learner.rollout(states, EPISODE_DURATION, skip=SETTLING_TIME)

    def result(self) -> ValueNetwork:
        """The network that acts: that of the averaged weights."""
        return self.learner.averaged_network()

    def tensors(self) -> dict[str, torch.Tensor]:
        """What is saved: the acting network under its own names, and the learner's tensors."""
        return {**self.result().state_dict(), **self._learners_tensors()}

    def _learners_tensors(self) -> dict[str, torch.Tensor]:
        return {f"learner.{name}": tensor for name, tensor in self.learner.state_dict()["tensors"].items()}

    def info(self) -> dict[str, Any]:
        """What else is saved."""
        return {"learner": self.learner.state_dict()["info"]}

    def restore(self, tensors: dict[str, torch.Tensor], info: dict[str, Any]) -> None:
        """Go on from what was saved."""
        own = {name: tensors[f"learner.{name}"] for name in self.learner.state_dict()["tensors"]}
        self.learner.load_state_dict({"tensors": own, "info": info["learner"]})


def make_learning(
    config: TrainConfig, problem: ControlProblem, network: ValueNetwork
) -> TemporalDifferences | ValueGradients:
    """The method that ``config`` names."""
    if config.method == "value-gradient":
        return ValueGradients(config, problem, network)
    assert isinstance(network, Cascade)  # a TrainConfig allows nothing else
    return TemporalDifferences(config, problem, network)


def learn_in_environment(learner: Learner, config: TrainConfig, states: Array) -> list[Moment]:
    """One trial from each of ``states`` in the dm_control environment itself, learning from its observations."""
    remaining = iter(states)
    environment = suite.swim(
        config.parameters,
        time_limit=config.td.trial_duration,
        initial_states=lambda _: next(remaining),
        environment_kwargs={"control_timestep": config.td.dt},
    )
    moments = []
    for _ in range(len(states)):
        step = environment.reset()
        learner.start_trial()
        while not step.last():
            moments.append(learner.learn_at(observed_state(step.observation)))
            step = environment.step(moments[-1].control / config.parameters.torque_limits)
        learner.end_trial()
    environment.physics.free()
    return moments
