"""MPPI: planning by samples, without learning. Williams et al. 2017, doi:10.1109/ICRA.2017.7989202, algorithm 2.

From where the swimmer is, a plan of torques is varied many times; the new plan is the mean of the variations, weighted
by the exponential of how far each swims. The first action is done, and the rest is where the next plan starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from peers.engine import SwimEngine
from swimmer_mj.learning.problems.swim import Swimming

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MppiSettings:
    """Of the algorithm."""

    samples: int = 256
    """Variations of a plan; a multiple of 16."""
    horizon: int = 30
    """Actions in a plan."""
    hold: int = 4
    """Steps of 0.01 s for which an action is held."""
    iterations: int = 1
    """Times that a plan is improved before its first action is done."""
    spread: float = 0.5
    """Of the noise, in units of the largest torque."""
    keep: float = 0.8
    """Of an action's noise in the next action's."""
    temperature: float = 0.02
    """m/s: a sample that swims slower by so much counts 1/e."""


class Mppi:
    """Plans of N swimmers, each for itself."""

    def __init__(self, problem: Swimming, settings: MppiSettings, seed: int) -> None:
        self.settings, self.rng = settings, np.random.default_rng(seed)
        self.engine = SwimEngine(problem, hold=settings.hold)
        self.limits = problem.control_limits
        self.plans: Array | None = None
        """In units of the largest torques, (T, q, N)."""

    def act(self, states: Array) -> Array:
        """Torques (N, q), N m, at states (N, p), which follow on those of the last call."""
        T, q, N = self.settings.horizon, self.engine.q, len(states)
        if self.plans is None:
            self.plans = np.zeros((T, q, N))
        for _ in range(self.settings.iterations):
            self._improve(states, self.plans)
        first = self.plans[0].T * self.limits
        self.plans = np.concatenate([self.plans[1:], self.plans[-1:]])
        return first

    def _improve(self, states: Array, plans: Array) -> None:
        settings, (T, q, N), K = self.settings, plans.shape, self.settings.samples
        noise = self.rng.standard_normal((T, q, N, K))
        for t in range(1, T):  # of unit variance, like its neighbour's
            noise[t] = settings.keep * noise[t - 1] + np.sqrt(1 - settings.keep**2) * noise[t]
        tried = np.clip(plans[..., None] + settings.spread * noise, -1.0, 1.0)
        tried[..., 0] = plans  # one is the plan itself
        x, total = np.repeat(states.T, K, axis=1), np.zeros(N * K)
        for t in range(T):
            u = tried[t].reshape(q, -1) * self.limits[:, None]
            reached, velocity = self.engine.forward(x, u)
            x, total = reached[-1], total + velocity / T
        weights = softmax(total.reshape(N, K) / settings.temperature)
        plans[:] = np.einsum("tqnk,nk->tqn", tried, weights)


def softmax(score: Array) -> Array:
    """Weights along the last axis, whose sum is 1."""
    weights = np.exp(score - score.max(axis=-1, keepdims=True))
    return weights / weights.sum(axis=-1, keepdims=True)
