"""Analytic policy gradients: back-propagation through time, without a critic.

The loss is minus the discounted velocity over a horizon, followed back through all of it: Werbos 1990,
doi:10.1109/5.58337; by the name in Freeman et al. 2021, arXiv:2106.13281.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from peers.engine import SwimEngine
from peers.networks import TanhPolicy, Unit
from peers.shac import mean_policy
from peers.trajectories import Trajectories
from swimmer_mj.learning.problems.swim import Swimming

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ApgSettings:
    """Of the algorithm."""

    trajectories: int = 64
    """N."""
    horizon: int = 60
    """Actions through which gradients are followed."""
    hold: int = 4
    """Steps of 0.01 s for which an action is held."""
    s_gamma: float = 0.5
    """1/s: later velocities count less."""
    rate: float = 2e-3
    """Of Adam."""
    decay: float = 0.0
    """The rate falls as 1 / (1 + decay k) with the iteration k."""
    log_spread: float = -2.0
    """Of the noise."""
    hidden: int = 64
    """Units in each of two layers."""
    unit: Unit = "elu"
    clip: float = 1.0
    """Largest norm of the gradient."""
    trial_duration: float = 10.0
    """s."""


class Apg:
    """One learner."""

    def __init__(self, problem: Swimming, settings: ApgSettings, seed: int) -> None:
        self.settings = settings
        torch.manual_seed(seed)  # of the layers' initial weights
        self.generator = torch.Generator().manual_seed(seed)
        self.actor = TanhPolicy(problem, (settings.hidden,) * 2, settings.unit, settings.log_spread)
        self.actor.log_spread.requires_grad_(False)  # without a critic, noise is only a loss
        self.engine = SwimEngine(problem, hold=settings.hold)
        window = settings.horizon * settings.hold * self.engine.dt
        self.trajectories = Trajectories(
            problem, settings.trajectories, round(settings.trial_duration / window), seed
        )
        self.gamma = math.exp(-settings.s_gamma * self.engine.dt * settings.hold)
        self.adam = torch.optim.Adam(self.actor.mean.parameters(), settings.rate, betas=(0.7, 0.95))
        self.iterations = 0

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s."""
        return self.engine.simulation_steps

    @property
    def gradient_evaluations(self) -> int:
        """Steps of 0.01 s through which gradients were followed."""
        return self.engine.gradient_evaluations

    @property
    def hold(self) -> int:
        """Control steps for which the policy holds its torques."""
        return self.settings.hold

    def policy(self) -> Callable[[Array], Array]:
        """Without noise: torques (N, q) at states (N, p)."""
        return mean_policy(self.actor)

    def learn(self) -> None:
        """One iteration."""
        settings = self.settings
        self.adam.param_groups[0]["lr"] = settings.rate / (1 + settings.decay * self.iterations)
        x = self.trajectories.begin_window()
        total = torch.zeros(x.shape[1], dtype=torch.float64)
        for t in range(settings.horizon):
            x, velocity = self.engine.step(x, self.actor(x, self.generator))
            total = total + (1 - self.gamma) * self.gamma**t * velocity
        self.adam.zero_grad()
        (-total.mean()).backward()
        torch.nn.utils.clip_grad_norm_(self.actor.mean.parameters(), settings.clip)
        self.adam.step()
        self.trajectories.end_window(x)
        self.iterations += 1
