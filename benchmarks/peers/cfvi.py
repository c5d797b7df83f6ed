"""Fitted value iteration in continuous time, in the manner of cFVI: Lutter et al. 2021, arXiv:2105.04682.

The greedy control is closed-form, as here; targets are exponentially weighted n-step returns along trajectories of the
greedy policy, by a value that stays as it is while another is fitted to them in many passes. Slopes are not fitted:
that, and the frozen value, is what sets it apart from value gradients, whose compiled engine it uses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.engines import engine_for
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CfviSettings:
    """Of the algorithm."""

    trajectories: int = 512
    """N."""
    steps: int = 50
    """T, of 0.01 s, of each in an iteration."""
    s_gamma: float = 0.5
    """1/s."""
    s_lambda: float = 1.0
    """Decay of what is looked ahead, 1/s."""
    passes: int = 4
    """Over the states of an iteration, with targets that stay."""
    minibatch: int = 512
    rate: float = 1e-3
    """Of Adam, which starts anew in each iteration."""
    decay: float = 0.0
    """The rate falls as 1 / (1 + decay k) with the iteration k."""
    flips: float = 0.05
    """Probability that a torque has its sign flipped for a step: exploration."""
    hidden: int = 64
    """Units in each of two layers."""
    trial_duration: float = 10.0
    """s."""


class Cfvi:
    """One learner."""

    hold = 1

    def __init__(self, problem: Swimming, settings: CfviSettings, seed: int) -> None:
        self.problem, self.settings = problem, settings
        self.rng = np.random.default_rng(seed)
        self.generator = torch.Generator().manual_seed(seed)
        network = Multilayer(problem.n_inputs, (settings.hidden,) * 2, generator=self.generator)
        self.weights = torch.nn.utils.parameters_to_vector(network.parameters()).detach().clone()
        only_values = ValueGradientSettings(
            trajectories=settings.trajectories,
            steps=settings.steps,
            minibatch=settings.minibatch,
            s_lambda=settings.s_lambda,
            slope_weight=0.0,
        )
        self.engine = engine_for(problem, network, only_values, "compiled")
        self.windows = max(1, round(settings.trial_duration / (0.01 * settings.steps)))
        self.states = problem.initial_states(self.rng, settings.trajectories)
        self.age = self.rng.integers(0, self.windows, settings.trajectories)
        self.iterations = 0

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s."""
        return self.iterations * self.settings.trajectories * self.settings.steps

    @property
    def gradient_evaluations(self) -> int:
        """None is asked for, though the engine makes them beside the targets."""
        return 0

    def policy(self) -> Callable[[Array], Array]:
        """Greedy: torques (N, q) at states (N, p)."""
        weights = self.weights.clone()
        return lambda states: self.engine.control(weights, np.asarray(states, dtype=np.float64))

    def learn(self) -> None:
        """One iteration."""
        settings = self.settings
        old = self.age >= self.windows
        if old.any():
            self.states[old] = self.problem.initial_states(self.rng, int(old.sum()))
            self.age[old] = 0
        self.age += 1
        shape = (settings.steps, settings.trajectories, len(self.problem.control_limits))
        flips = np.where(self.rng.random(shape, dtype=np.float32) < settings.flips, -1.0, 1.0)
        batch, self.states = self.engine.collect(self.weights, self.states, flips)
        fitted = self.weights.clone().requires_grad_(True)
        fitted.grad = torch.zeros_like(fitted)
        adam = torch.optim.Adam([fitted], settings.rate / (1 + settings.decay * self.iterations))
        count = settings.steps * settings.trajectories
        for _ in range(settings.passes):
            shuffled = self.engine.shuffle(batch, torch.randperm(count, generator=self.generator))
            for start in range(0, count - settings.minibatch + 1, settings.minibatch):
                self.engine.loss_gradient(fitted.detach(), shuffled, start, fitted.grad)
                adam.step()
        self.weights = fitted.detach()
        self.iterations += 1
