"""How fast do PPO, SAC and TD3 of Stable-Baselines3 learn to swim? The yardstick for the learners of this project.

    python benchmarks/peers_sb3.py

adds to benchmarks/results/peers-sb3.csv, a row an evaluation; what is there already is not done again. Needs the extra
``peers``. What makes it fair:

- the same dynamics, initial states and reward, and the same 3n + 2 inputs as this project's learners (angles as cosine
  and sine); swimming speed by the one definition of docs/metrics.md, on MuJoCo through dm_control, of the deterministic
  policy;
- all environments of a learner are one vector environment on ``mujoco.batch``, five times as fast as single ones;
- evaluation takes no time, and torch has one thread, as each learner of this project has one core. The clock is the
  processor time of the learner's process, so that whatever else the machine does is not held against it; wall-clock
  time is beside it;
- settings better than the defaults where better ones are known. Stable-Baselines3's defaults, and what its Zoo has for
  Gymnasium's Swimmer (the defaults, with normalised observations for PPO and a discount of 0.9999), suit another
  swimmer, whose episodes are ten times as long. Here: actions held for 0.05 s, discount exp(-0.3 * 0.05) (s_gamma 0.3),
  PPO with 32 environments, networks of 2 x 128 and a batch of 1,024; SAC and TD3 with 8 environments, learning rate
  1e-3 and a gradient step for every two actions, TD3 with the Zoo's action noise of 0.1.

What remains unequal: they learn without the model, and their policies hold each action for five control steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from peers.sb3 import HOLD, Swimmers, inputs
from rich.console import Console
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise
from yardstick import Clock, Row, append, finished, row, swimming_speed

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "peers-sb3.csv"

DISCOUNT = math.exp(-0.3 * 0.01 * HOLD)
OFF_POLICY = {"n_envs": 8, "learning_rate": 1e-3, "gamma": DISCOUNT, "train_freq": 1, "gradient_steps": 4}
SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_envs": 32,
        "n_steps": 64,
        "batch_size": 1024,
        "gamma": DISCOUNT,
        "policy_kwargs": {"net_arch": [128, 128]},
    },
    "sac": OFF_POLICY,
    "td3": OFF_POLICY | {"action_noise": NormalActionNoise(np.zeros(4), np.full(4, 0.1))},
}
LEARNERS = {"ppo": PPO, "sac": SAC, "td3": TD3}
SECONDS = {"ppo": 180.0, "sac": 540.0, "td3": 300.0}
Algorithm = Literal["ppo", "sac", "td3"]
Array = NDArray[np.float64]


class Evaluate(BaseCallback):
    """Evaluate now and then, with the clock stopped; end when the time is over."""

    def __init__(self, algorithm: str, seed: int, seconds: float, every: float) -> None:
        super().__init__()
        self.label = (algorithm, seed)
        self.limit, self.every = seconds, every
        self.clock, self.next = Clock(), every
        self.rows: list[Row] = []

    def _on_step(self) -> bool:
        processor, _ = self.clock.read()
        if processor < min(self.next, self.limit):
            return True
        self.clock.stop()
        speed = swimming_speed(self._act, hold=HOLD)
        self.rows.append(row(*self.label, self.clock, HOLD * self.num_timesteps, speed))
        Console().print(*self.rows[-1])
        self.next = processor + self.every
        self.clock.start()
        return processor < self.limit

    def _act(self, states: Array) -> Array:
        actions, _ = self.model.predict(inputs(states), deterministic=True)
        return actions


def main(
    algorithms: Sequence[Algorithm] = ("ppo", "sac", "td3"),
    seeds: Sequence[int] = tuple(range(10)),
    seconds: float | None = None,
    every: float = 30.0,
    out: Path = OUT,
) -> None:
    """Train each algorithm with each seed, one after the other.

    Args:
        algorithms: Which.
        seeds: Of networks, exploration and initial states.
        seconds: Processor time of each; by default 180 for PPO, 540 for SAC, 300 for TD3. Some of the committed ones
            had more: docs/beyond.md.
        every: Processor time between evaluations, s.
        out: CSV to append rows to, those of a learner when it is done.
    """
    torch.set_num_threads(1)
    for seed in seeds:
        for algorithm in algorithms:
            if (algorithm, str(seed)) in finished(out):
                continue
            settings = dict(SETTINGS[algorithm])
            environments = Swimmers(settings.pop("n_envs"), 1000 * seed)
            model = LEARNERS[algorithm]("MlpPolicy", environments, seed=seed, device="cpu", **settings)
            evaluate = Evaluate(algorithm, seed, SECONDS[algorithm] if seconds is None else seconds, every)
            model.learn(2**62, callback=evaluate)
            environments.close()
            append(out, evaluate.rows)


if __name__ == "__main__":
    tyro.cli(main)
