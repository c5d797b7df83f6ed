"""SHAC: short-horizon actor-critic. Xu et al. 2022, arXiv:2204.07137, section 4 and algorithm 1.

The actor's loss is minus the discounted reward of h steps, and of a critic's value at their end, followed back through
the model; the critic is fitted to TD(lambda) targets of those steps by a critic that follows it slowly. Rewards are
velocities times 1 - gamma, so that values are velocities too. Episodes end by time alone: the value goes on.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from peers.engine import SwimEngine
from peers.networks import TanhPolicy, Unit, Value
from peers.trajectories import Trajectories
from swimmer_mj.learning.problems.swim import Swimming

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShacSettings:
    """Of the algorithm. The paper's are 64 trajectories, 32 actions and 16 passes, which learn more slowly here."""

    trajectories: int = 256
    """N."""
    horizon: int = 16
    """h, actions."""
    hold: int = 4
    """Steps of 0.01 s for which an action is held."""
    s_gamma: float = 0.5
    """1/s: gamma = exp(-s_gamma 0.01 hold)."""
    lam: float = 0.95
    """lambda."""
    actor_rate: float = 2e-3
    critic_rate: float = 2e-3
    decay: float = 0.0
    """The rates fall as 1 / (1 + decay k) with the iteration k: the time that is left is not known."""
    critic_passes: int = 4
    """Over the states of a window."""
    critic_batches: int = 4
    """Minibatches in a pass."""
    target_keep: float = 0.2
    """alpha: how much of the target critic stays in an iteration."""
    log_spread: float = -1.0
    """Of the noise, at first; it is learned."""
    hidden: int = 64
    """Units in each of two layers."""
    unit: Unit = "elu"
    clip: float = 1.0
    """Largest norm of a gradient."""
    trial_duration: float = 10.0
    """s."""


class Shac:
    """One learner."""

    def __init__(self, problem: Swimming, settings: ShacSettings, seed: int) -> None:
        self.problem, self.settings = problem, settings
        torch.manual_seed(seed)  # of the layers' initial weights
        self.generator = torch.Generator().manual_seed(seed)
        hidden = (settings.hidden,) * 2
        self.actor = TanhPolicy(problem, hidden, settings.unit, settings.log_spread)
        self.critic = Value(problem, hidden, settings.unit)
        self.target = copy.deepcopy(self.critic)
        self.engine = SwimEngine(problem, hold=settings.hold)
        window = settings.horizon * settings.hold * self.engine.dt
        self.trajectories = Trajectories(
            problem, settings.trajectories, round(settings.trial_duration / window), seed
        )
        self.gamma = math.exp(-settings.s_gamma * self.engine.dt * settings.hold)
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), settings.actor_rate, betas=(0.7, 0.95))
        self.critic_adam = torch.optim.Adam(self.critic.parameters(), settings.critic_rate, betas=(0.7, 0.95))
        self.iterations = 0

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s."""
        return self.engine.simulation_steps

    @property
    def gradient_evaluations(self) -> int:
        """Steps of 0.01 s through which gradients were followed."""
        return self.engine.gradient_evaluations

    def policy(self) -> Callable[[Array], Array]:
        """Without noise: torques (N, q) at states (N, p)."""
        return mean_policy(self.actor)

    @property
    def hold(self) -> int:
        """Control steps for which the policy holds its torques."""
        return self.settings.hold

    def learn(self) -> None:
        """One iteration."""
        settings, gamma = self.settings, self.gamma
        for adam, rate in ((self.actor_adam, settings.actor_rate), (self.critic_adam, settings.critic_rate)):
            adam.param_groups[0]["lr"] = rate / (1 + settings.decay * self.iterations)
        x = self.trajectories.begin_window()
        states, rewards, total = [x], [], torch.zeros(x.shape[1], dtype=torch.float64)
        for t in range(settings.horizon):
            x, velocity = self.engine.step(x, self.actor(x, self.generator))
            rewards.append((1 - gamma) * velocity)
            total = total + gamma**t * rewards[-1]
            states.append(x.detach())
        total = total + gamma**settings.horizon * self.target(x)
        self._descend(self.actor_adam, self.actor, -total.mean())
        self.trajectories.end_window(x)
        self._fit(torch.stack(states), torch.stack(rewards).detach().float())
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.critic.parameters(), strict=True):
                slow.lerp_(fast, 1 - settings.target_keep)
        self.iterations += 1

    def _fit(self, states: Tensor, rewards: Tensor) -> None:
        """The critic to TD(lambda) targets along the window, states (h + 1, p, N), rewards (h, N)."""
        settings, gamma = self.settings, self.gamma
        h, N = rewards.shape
        flat = states.transpose(1, 2).reshape(-1, self.engine.p)
        with torch.no_grad():
            V = self.target(flat.T).view(h + 1, N)
            goals = td_lambda_targets(rewards, V, gamma, settings.lam).flatten()
            z = self.problem.inputs(flat[: h * N]).float()
        for _ in range(settings.critic_passes):
            for some in torch.randperm(h * N, generator=self.generator).chunk(settings.critic_batches):
                loss = (self.critic.of_inputs(z[some])[:, 0] - goals[some]).square().mean()
                self._descend(self.critic_adam, self.critic, loss)

    def _descend(self, adam: torch.optim.Adam, network: torch.nn.Module, loss: Tensor) -> None:
        adam.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), self.settings.clip)
        adam.step()


def td_lambda_targets(rewards: Tensor, V: Tensor, gamma: float, lam: float) -> Tensor:
    """What V is to be at the states 0 .. h - 1 of N windows, (h, N), from rewards (h, N) and V (h + 1, N) there.

    Backwards from V at the end: G_t = r_t + gamma ((1 - lam) V_{t+1} + lam G_{t+1}).
    """
    goal, goals = V[-1], torch.empty_like(rewards)
    for t in range(len(rewards) - 1, -1, -1):
        goal = rewards[t] + gamma * ((1 - lam) * V[t + 1] + lam * goal)
        goals[t] = goal
    return goals


def mean_policy(actor: TanhPolicy) -> Callable[[Array], Array]:
    """The actor without noise, as an evaluation calls it."""

    @torch.no_grad()
    def act(states: Array) -> Array:
        return actor(torch.from_numpy(np.ascontiguousarray(states.T, dtype=np.float64))).numpy().T

    return act
