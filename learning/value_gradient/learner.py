"""A learner of value gradients: rounds of trajectories, targets and a fit by Adam, and an average of its weights.

The equations are in :mod:`swimmer_mj.learning.value_gradient.equations`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.networks.networks import ValueNetwork
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.caution import warn_of
from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_shares, require_euler
from swimmer_mj.learning.value_gradient.engines import engine_for
from swimmer_mj.learning.value_gradient.equations import weight_of_round
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

__all__ = ["RoundStatistics", "ValueGradientLearner"]

Array = NDArray[np.float64]
Network = TypeVar("Network", bound=ValueNetwork)


class RoundStatistics(NamedTuple):
    """Means over a round."""

    reward: float
    """Reward rate along the trajectories."""
    value: float
    """V along them."""
    value_error: float
    """(V - G)^2."""
    slope_error: float
    """w sum_i S_i^2 (dV/dx_i - g_i)^2."""


class ValueGradientLearner(Generic[Network]):
    """Learns V and dV/dx along trajectories of the greedy policy. It changes the network's weights in place.

    Parameters
    ----------
    problem : ControlProblem
        What to learn: it must have a TorchForm or a BatchForm (:mod:`swimmer_mj.learning.problems.forms`).
    network : ValueNetwork
        V_w, in float32 or float64. On a CUDA device, everything but the random draws happens there.
    settings : ValueGradientSettings
        The algorithm's constants.
    seed : int
        Of the initial states, the flips and the minibatches. The network's initial weights are the caller's.
    engine : "auto", "compiled" or "torch"
        "auto" compiles what can be: Cascade and Multilayer networks on a CPU, of problems with a BatchForm, as the
        swimmer, with a number of trajectories and a minibatch that are multiples of 32.
    """

    def __init__(
        self,
        problem: ControlProblem,
        network: Network,
        settings: ValueGradientSettings | None = None,
        *,
        seed: int = 0,
        engine: Literal["auto", "compiled", "torch"] = "auto",
    ) -> None:
        self.problem = problem
        self.network = network
        self.settings = settings = ValueGradientSettings() if settings is None else settings
        if network.n_inputs != problem.n_inputs:
            raise ValueError(f"{problem.name} has {problem.n_inputs} inputs, the network {network.n_inputs}")
        require_euler(problem)
        warn_of(problem)
        self._engine = engine_for(problem, network, settings, engine)
        self.engine = self._engine.name

        parameters = list(network.parameters())
        self._weights = torch.cat([w.detach().flatten() for w in parameters])
        at = 0
        for w in parameters:  # the module's tensors become views, so that they are up to date at all times
            w.data = self._weights[at : at + w.numel()].view(w.shape)
            at += w.numel()
        self._average = self._weights.clone()
        self._moment = torch.zeros_like(self._weights)
        self._second_moment = torch.zeros_like(self._weights)
        self._gradient = torch.zeros_like(self._weights)
        self._rounds_per_trial = max(1, round(settings.trial_duration / (settings.steps * settings.dt)))
        self.reseed(seed)
        self._updates = 0
        self.rounds = 0

    def reseed(self, seed: int) -> None:
        """Begin the random draws, and with them all trajectories, anew with ``seed``; the weights stay."""
        count = self.settings.trajectories
        self._rng = np.random.default_rng(seed)
        self._generator = torch.Generator().manual_seed(seed)
        self._states = self.problem.initial_states(self._rng, count)
        # How old each trajectory is, in rounds: out of step with the others.
        self._age = self._rng.integers(0, self._rounds_per_trial, count)

    @property
    def simulation_steps(self) -> int:
        """Steps of dt that have been simulated."""
        return self.rounds * self.settings.steps_per_round

    @torch.no_grad()
    def step(self) -> RoundStatistics:
        """One round: trajectories, targets, a fit."""
        settings = self.settings
        old = (self._age >= self._rounds_per_trial) | np.isnan(self._states).any(axis=1)
        if old.any():
            self._states[old] = self.problem.initial_states(self._rng, int(old.sum()))
            self._age[old] = 0
        self._age += 1
        shape = (settings.steps, settings.trajectories, len(self.problem.control_limits))
        flips = np.where(self._rng.random(shape, dtype=np.float32) < settings.flips, -1.0, 1.0)
        batch, self._states = self._engine.collect(self._weights, self._states, flips)

        count = settings.steps_per_round
        rate = settings.rate(self.rounds)
        errors = []
        for _ in range(settings.passes):
            shuffled = self._engine.shuffle(batch, torch.randperm(count, generator=self._generator))
            for start in range(0, count - settings.minibatch + 1, settings.minibatch):
                errors.append(self._engine.loss_gradient(self._weights, shuffled, start, self._gradient))
                self._adam(rate)
        self._average.lerp_(self._weights, weight_of_round(self.rounds, settings.averaged_share))
        self.rounds += 1
        value_error, slope_error = np.mean(errors, axis=0)
        return RoundStatistics(batch.reward, batch.value, float(value_error), float(slope_error))

    def _adam(self, rate: float, beta1: float = 0.9, beta2: float = 0.999, epsilon: float = 1e-8) -> None:
        """One step of Adam (Kingma and Ba 2015, algorithm 1) with the gradient clipped by its norm."""
        gradient = self._gradient
        norm = float(gradient.norm())
        if not math.isfinite(norm):
            if self._updates == 0:
                raise FloatingPointError(
                    f"the loss is not finite with the initial weights: dt {self.settings.dt} is too large for the "
                    "problem's drift, or a derivative of its drift, control matrix, reward rate or inputs is not finite"
                )
            farthest = int(
                np.nan_to_num(np.abs(self._states), nan=np.inf, posinf=np.inf).max(axis=1).argmax()
            )
            x = np.array2string(self._states[farthest], precision=3, separator=", ", max_line_width=10**6)
            raise FloatingPointError(
                f"the loss is no longer finite in round {self.rounds}, whose farthest trajectory is at x = {x}: "
                f"learning_rate {self.settings.learning_rate} or dt {self.settings.dt} is too large"
            )
        if norm > self.settings.clip:
            gradient *= self.settings.clip / norm
        self._updates += 1
        self._moment.lerp_(gradient, 1 - beta1)
        self._second_moment.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        spread = (self._second_moment / (1 - beta2**self._updates)).sqrt_().add_(epsilon)
        self._weights.addcdiv_(self._moment, spread, value=-rate / (1 - beta1**self._updates))

    @torch.no_grad()
    def averaged_network(self) -> Network:
        """A copy of the network with the averaged weights, which act better than the last ones."""
        network = copy.deepcopy(self.network)
        torch.nn.utils.vector_to_parameters(self._average.clone(), network.parameters())
        return network

    def policy(self) -> GreedyPolicy[Network]:
        """The greedy policy of the averaged weights."""
        return GreedyPolicy(self.problem, self.averaged_network().cpu())

    @torch.no_grad()
    def control(self, states: Array) -> Array:
        """Greedy control, shape (N, q), by the averaged weights at states (N, p): the policy, without V and H."""
        return self._engine.control(self._average, as_states(states, self.problem.state_size))

    @torch.no_grad()
    def rollout(
        self,
        initial_states: Array,
        duration: float,
        skip: float = 0.0,
        dt: float = 0.01,
        averaged: bool = True,
    ) -> Array:
        """Mean reward rate of greedy episodes by RK4, control held for ``dt``, after the first ``skip`` seconds.

        Parameters
        ----------
        initial_states : ndarray, shape (N, p)
            Where they start.
        duration, skip, dt : float
            s.
        averaged : bool
            By the averaged weights; otherwise by the last ones.

        Returns
        -------
        ndarray, shape (N,)
        """
        weights = self._average if averaged else self._weights
        states = as_states(initial_states, self.problem.state_size)
        return self._engine.episodes(weights, states, episode_shares(duration, skip, dt), dt)

    def state_dict(self) -> dict[str, Any]:
        """All that resuming exactly needs: ``tensors`` (name -> Tensor) and ``info`` (JSON values)."""
        return {
            "tensors": {
                "weights": self._weights.clone(),
                "average": self._average.clone(),
                "moment": self._moment.clone(),
                "second_moment": self._second_moment.clone(),
                "states": torch.from_numpy(self._states.copy()),
                "age": torch.from_numpy(self._age.copy()),
                "generator": self._generator.get_state(),
            },
            "info": {"rounds": self.rounds, "updates": self._updates, "rng": self._rng.bit_generator.state},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state_dict` gave, bit by bit."""
        tensors, info = state["tensors"], state["info"]
        for name in ("weights", "average", "moment", "second_moment"):
            getattr(self, f"_{name}").copy_(tensors[name])
        self._states = tensors["states"].numpy().copy()
        self._age = tensors["age"].numpy().copy()
        self._generator.set_state(tensors["generator"])
        self.rounds, self._updates = info["rounds"], info["updates"]
        self._rng.bit_generator.state = info["rng"]
