"""How fast do PPO and SAC of Stable-Baselines3 learn to swim? The yardstick for the learners of this project.

    python benchmarks/peers_sb3.py --seconds 600 --seeds 0 1

writes benchmarks/results/peers-sb3.csv, a row an evaluation. What makes it fair:

- the same dynamics, initial states and reward, and the same 3n + 2 inputs as this project's learners (angles as cosine
  and sine); swimming speed by the one definition of docs/metrics.md, on MuJoCo through dm_control, of the deterministic
  policy;
- evaluation takes no time: the clock runs while they learn; MuJoCo does the stepping, as it would for their user, and
  torch has one thread, as each learner of this project has one core;
- settings better than the defaults where better ones are known. Stable-Baselines3's defaults, and what its Zoo has for
  Gymnasium's Swimmer (the defaults, with normalised observations for PPO and a discount of 0.9999), suit another
  swimmer, whose episodes are ten times as long. Here: actions held for 0.05 s, discount exp(-0.3 * 0.05) (s_gamma 0.3),
  PPO with 32 environments, networks of 2 x 128 and a batch of 1,024, SAC with 8 environments, learning rate 1e-3 and a
  gradient step for every two actions.

What remains unequal: they learn without the model, and their policies hold each action for five control steps.
"""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
import torch
import tyro
from gymnasium import spaces
from numpy.typing import NDArray
from rich.console import Console
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

import swimmer_mj.gymnasium
from swimmer_mj.learning.evaluation import evaluate_swimming
from swimmer_mj.learning.policy import observed_state
from swimmer_mj.learning.swimming import Swimming
from swimmer_mj.parameters import PAPER

HOLD = 5
"""Control steps of 0.01 s for which an action is held."""

DISCOUNT = math.exp(-0.3 * 0.01 * HOLD)

SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_envs": 32,
        "n_steps": 64,
        "batch_size": 1024,
        "gamma": DISCOUNT,
        "policy_kwargs": {"net_arch": [128, 128]},
    },
    "sac": {
        "n_envs": 8,
        "learning_rate": 1e-3,
        "gamma": DISCOUNT,
        "train_freq": 1,
        "gradient_steps": 4,
    },
}
COLUMNS = ("algorithm", "seed", "seconds", "simulation_steps", "speed", "ci95_low", "ci95_high")

Array = NDArray[np.float64]


def inputs(states: Array) -> NDArray[np.float32]:
    """The inputs of this project's networks: cos and sin of angles, scaled rates, velocity; shape (..., 3n + 2)."""
    return Swimming(PAPER).inputs(torch.from_numpy(np.asarray(states))).numpy().astype(np.float32)


class Inputs(gymnasium.ObservationWrapper):
    """Observations as those inputs."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.observation_space = spaces.Box(-np.inf, np.inf, (Swimming(PAPER).n_inputs,), np.float32)

    def observation(self, observation: Array) -> NDArray[np.float32]:
        """Of one state."""
        return inputs(observation)


class Agent:
    """A learned policy in the dm_control tasks, each action held for five control steps."""

    def __init__(self, model: PPO | SAC) -> None:
        self.model = model
        self.calls = 0
        self.action: Array | None = None

    def __call__(self, observation: Mapping[str, Any]) -> Array:
        """Actions for a batch of observations."""
        if self.action is None or self.calls % HOLD == 0:
            predicted, _ = self.model.predict(inputs(observed_state(observation)), deterministic=True)
            self.action = predicted.astype(np.float64)
        self.calls += 1
        return self.action


class Evaluate(BaseCallback):
    """Evaluate now and then, with the clock stopped; end when the time is over."""

    def __init__(self, algorithm: str, seed: int, seconds: float, every: float, out: Path) -> None:
        super().__init__()
        self.label = (algorithm, seed)
        self.limit, self.every, self.out = seconds, every, out
        self.learned, self.next = 0.0, every
        self.resumed = time.perf_counter()

    def _on_step(self) -> bool:
        now = self.learned + time.perf_counter() - self.resumed
        if now < min(self.next, self.limit):
            return True
        speed = evaluate_swimming(Agent(self.model), PAPER)
        row = (
            *self.label,
            f"{now:.1f}",
            HOLD * self.num_timesteps,
            f"{speed.mean:.4f}",
            *map("{:.4f}".format, speed.ci95),
        )
        with self.out.open("a", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(row)
        Console().print(*row)
        self.learned, self.next = now, now + self.every
        self.resumed = time.perf_counter()
        return now < self.limit


def main(
    algorithms: tuple[Literal["ppo", "sac"], ...] = ("ppo", "sac"),
    seeds: tuple[int, ...] = (0, 1),
    seconds: float = 1200.0,
    every: float = 60.0,
    out: Path = Path("benchmarks/results/peers-sb3.csv"),
) -> None:
    """Train each algorithm with each seed, one after the other.

    Args:
        algorithms: Which.
        seeds: Of networks, exploration and initial states.
        seconds: Learning time of each.
        every: Learning time between evaluations, s.
        out: CSV to append rows to.
    """
    torch.set_num_threads(1)
    out.parent.mkdir(parents=True, exist_ok=True)
    if not out.exists():
        out.write_text(",".join(COLUMNS) + "\n")
    for algorithm in algorithms:
        for seed in seeds:
            settings = dict(SETTINGS[algorithm])
            environments = make_vec_env(
                "swimmer_mj/Swim5-v0",
                n_envs=settings.pop("n_envs"),
                seed=seed,
                env_kwargs={"frame_skip": HOLD, "max_episode_steps": 100},
                wrapper_class=Inputs,
            )
            learner = {"ppo": PPO, "sac": SAC}[algorithm]
            model = learner("MlpPolicy", environments, seed=seed, device="cpu", **settings)
            model.learn(2**62, callback=Evaluate(algorithm, seed, seconds, every, out))
            environments.close()


if __name__ == "__main__":
    assert swimmer_mj.gymnasium.SwimmerEnv  # its import registers the environments
    tyro.cli(main)
