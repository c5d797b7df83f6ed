"""PPO, SAC and TD3 of Stable-Baselines3, which are not given the model, with the hooks that the other peers have."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecEnv
from yardstick import CONTROL_TIMESTEP

from swimmer_mj.environments.vector import SwimmerVectorEnv
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.parameters import PAPER

Array = NDArray[np.float64]

HOLD = 5
"""Control steps of 0.01 s for which an action is held."""

EPISODE = 5.0
"""s, of training, as the paper's trials."""

ACTIONS = 25
"""Of each environment between two looks at the clock."""

UNITS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


@dataclass(frozen=True)
class Settings:
    """Those that all three have.

    The defaults of all are the best that were found by hand: Stable-Baselines3's own, and those of its Zoo for
    Gymnasium's Swimmer, suit another swimmer, whose episodes are ten times as long.
    """

    s_gamma: float = 0.3
    """1/s: the discount is exp(-s_gamma 0.01 hold)."""
    hold: int = HOLD
    """Control steps of 0.01 s for which an action is held."""
    hidden: int = 128
    """Units in each of two layers."""

    @property
    def gamma(self) -> float:
        """The discount of an action's time."""
        return math.exp(-self.s_gamma * CONTROL_TIMESTEP * self.hold)


@dataclass(frozen=True)
class PpoSettings(Settings):
    """Of PPO."""

    n_envs: int = 32
    n_steps: int = 64
    batch_size: int = 1024
    n_epochs: int = 10
    learning_rate: float = 3e-4
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    unit: Literal["tanh", "relu"] = "tanh"


@dataclass(frozen=True)
class OffPolicySettings(Settings):
    """Of SAC and TD3."""

    hidden: int = 256
    n_envs: int = 8
    gradient_steps: int = 4
    """For each action of all environments."""
    batch_size: int = 256
    learning_rate: float = 1e-3
    tau: float = 0.005
    """How much of the networks goes into their targets in a step."""


@dataclass(frozen=True)
class Td3Settings(OffPolicySettings):
    """Of TD3 alone."""

    noise: float = 0.1
    """Standard deviation of what is added to its actions."""


def inputs(states: Array) -> NDArray[np.float32]:
    """The inputs of this project's networks: cos and sin of angles, scaled rates, velocity; shape (..., 3n + 2)."""
    return Swimming(PAPER).inputs(torch.from_numpy(np.asarray(states))).numpy().astype(np.float32)


class Swimmers(VecEnv):
    """The vector environment as Stable-Baselines3 wants one."""

    def __init__(self, n_envs: int, seed: int, hold: int = HOLD) -> None:
        self.swimmers = SwimmerVectorEnv(
            "swim5",
            n_envs,
            max_episode_steps=round(EPISODE / (CONTROL_TIMESTEP * hold)),
            autoreset_mode=AutoresetMode.SAME_STEP,
            nthread=1,
            frame_skip=hold,
        )
        box = spaces.Box(-np.inf, np.inf, (Swimming(PAPER).n_inputs,), np.float32)
        super().__init__(n_envs, box, self.swimmers.single_action_space)
        self.first_seed: int | None = seed

    def reset(self) -> NDArray[np.float32]:
        """Start an episode in each."""
        states, _ = self.swimmers.reset(seed=self.first_seed)
        self.first_seed = None
        return inputs(states)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take note of what to do."""
        self.actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Do it."""
        states, rewards, _, truncations, more = self.swimmers.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(truncations):
            infos[i] = {"terminal_observation": inputs(more["final_obs"][i]), "TimeLimit.truncated": True}
        return inputs(states), rewards.astype(np.float32), truncations, infos

    def close(self) -> None:
        """Free the simulations."""
        self.swimmers.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of each."""
        return [getattr(self.swimmers, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not needed."""
        raise NotImplementedError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not needed."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Any = None) -> list[bool]:
        """None is."""
        return [False] * len(list(self._get_indices(indices)))


class ModelFree:
    """One learner of Stable-Baselines3."""

    gradient_evaluations = 0
    """The model's gradients are not used."""

    def __init__(self, algorithm: type[PPO | SAC | TD3], settings: Any, seed: int, **more: Any) -> None:
        self.hold, self.n_envs = settings.hold, settings.n_envs
        self.model = algorithm(
            "MlpPolicy",
            Swimmers(settings.n_envs, 1000 * seed, settings.hold),
            seed=seed,
            device="cpu",
            gamma=settings.gamma,
            learning_rate=settings.learning_rate,
            batch_size=settings.batch_size,
            **more,
        )

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s."""
        return self.hold * self.model.num_timesteps

    def policy(self) -> Callable[[Array], Array]:
        """Without noise: torques (N, q) at states (N, p)."""

        def act(states: Array) -> Array:
            actions, _ = self.model.predict(inputs(states), deterministic=True)
            return actions * PAPER.torque_limits

        return act

    def learn(self) -> None:
        """A rollout of PPO; of the others some actions."""
        self.model.learn(self.n_envs * ACTIONS, reset_num_timesteps=False)


def ppo(_: Swimming, settings: PpoSettings, seed: int) -> ModelFree:
    """PPO."""
    return ModelFree(
        PPO,
        settings,
        seed,
        n_steps=settings.n_steps,
        n_epochs=settings.n_epochs,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        policy_kwargs={"net_arch": [settings.hidden] * 2, "activation_fn": UNITS[settings.unit]},
    )


def sac(_: Swimming, settings: OffPolicySettings, seed: int) -> ModelFree:
    """SAC."""
    return ModelFree(SAC, settings, seed, **_off_policy(settings))


def td3(_: Swimming, settings: Td3Settings, seed: int) -> ModelFree:
    """TD3, with noise on its actions."""
    q = len(PAPER.torque_limits)
    noise = NormalActionNoise(np.zeros(q), np.full(q, settings.noise))
    return ModelFree(TD3, settings, seed, action_noise=noise, **_off_policy(settings))


def _off_policy(settings: OffPolicySettings) -> dict[str, Any]:
    return {
        "train_freq": 1,
        "gradient_steps": settings.gradient_steps,
        "tau": settings.tau,
        "policy_kwargs": {"net_arch": [settings.hidden] * 2},
    }
