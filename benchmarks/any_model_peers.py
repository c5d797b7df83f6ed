"""How well do PPO and SAC of Stable-Baselines3 learn the tasks of any_model.py, in the same time on the same machine?

    python benchmarks/any_model_peers.py [--tasks dm_control/cartpole/swingup ...] [--seeds 0 1 2] [--seconds 300]

adds to benchmarks/results/any-model-peers.csv, a row a look, as any_model.py does. Settings are those of RL Zoo
(hyperparams/ppo.yml and sac.yml of DLR-RM/rl-baselines3-zoo): a task's own where it has some, on an older version of
the task; for all others what it has for MuJoCo tasks in general. The clock is the processor time of one core, looks not
counted. Judged by the episodes of any_model.py's looks. What is there already is not learned again. Needs the extra
``peers``, and shimmy for tasks of dm_control. ``any_model_curves.py`` draws both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
import torch
import tyro
from any_model import TASKS, looked_at
from numpy.typing import NDArray
from rich.console import Console
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from yardstick import Row, fill, looks

OUT = Path(__file__).parent / "results" / "any-model-peers.csv"
COLUMNS = (
    "task", "algorithm", "seed", "cpu_seconds", "actions", "return_mean", "return_min", "return_max",
)  # fmt: skip
Algorithm = Literal["ppo", "sac"]
LOOKS = (5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 220.0, 300.0, 450.0)  # s
SAC_ACTIONS = 200
"""Between two looks at the clock; of PPO, a rollout."""

ZOO: dict[Algorithm, dict[str, dict[str, Any]]] = {
    "ppo": {
        "gymnasium/Swimmer-v5": {"gamma": 0.9999},
        "gymnasium/InvertedPendulum-v5": {
            "n_steps": 32, "batch_size": 64, "gamma": 0.999, "learning_rate": 2.22425e-4, "ent_coef": 1.37976e-7,
            "clip_range": 0.4, "n_epochs": 5, "gae_lambda": 0.9, "max_grad_norm": 0.3, "vf_coef": 0.19816,
        },
        "gymnasium/InvertedDoublePendulum-v5": {
            "n_steps": 128, "batch_size": 512, "gamma": 0.98, "learning_rate": 1.55454e-4, "ent_coef": 1.05057e-6,
            "clip_range": 0.4, "n_epochs": 10, "gae_lambda": 0.8, "max_grad_norm": 0.5, "vf_coef": 0.695929,
        },
        "gymnasium/Reacher-v5": {
            "n_steps": 512, "batch_size": 32, "gamma": 0.9, "learning_rate": 1.04019e-4, "ent_coef": 7.52585e-8,
            "clip_range": 0.3, "n_epochs": 5, "gae_lambda": 1.0, "max_grad_norm": 0.9, "vf_coef": 0.950368,
        },
    },
    "sac": {"gymnasium/Swimmer-v5": {"gamma": 0.9999}},
}  # fmt: skip
"""By task; Stable-Baselines3's defaults elsewhere. PPO has observations and rewards normalised, as everywhere in the
Zoo's tasks of MuJoCo; SAC begins to learn after 10,000 actions."""

Array = NDArray[np.float64]


def environment(task: str) -> gymnasium.Env[Any, Any]:
    """A task as its authors ship it, observations in a row."""
    suite, _, name = task.partition("/")
    if suite == "gymnasium":
        return gymnasium.make(name)
    import shimmy  # registers dm_control's

    gymnasium.register_envs(shimmy)
    made = gymnasium.make(f"dm_control/{name.replace('/', '-')}-v0")
    return gymnasium.wrappers.FlattenObservation(made)


class Learner:
    """PPO or SAC on one task, with the Zoo's settings."""

    def __init__(self, algorithm: Algorithm, task: str, seed: int) -> None:
        settings = ZOO[algorithm].get(task, {})
        made = DummyVecEnv([lambda: Monitor(environment(task))])
        self.normalize: VecNormalize | None = None
        if algorithm == "ppo":
            self.normalize = made = VecNormalize(made, gamma=settings.get("gamma", 0.99))
            self.model: PPO | SAC = PPO("MlpPolicy", made, seed=seed, device="cpu", **settings)
            self.chunk = self.model.n_steps
        else:
            self.model = SAC("MlpPolicy", made, seed=seed, device="cpu", learning_starts=10_000, **settings)
            self.chunk = SAC_ACTIONS

    def learn(self) -> None:
        """A little more."""
        self.model.learn(self.chunk, reset_num_timesteps=False)

    def act(self, seen: Array) -> Array:
        """The action without noise."""
        if self.normalize is not None:
            seen = self.normalize.normalize_obs(seen)
        return self.model.predict(seen, deterministic=True)[0]


def returns(task: str, act: Callable[[Array], Array], seeds: Sequence[int]) -> Array:
    """Of an episode from each seed."""
    made, found = environment(task), []
    for seed in seeds:
        seen, _ = made.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            seen, reward, fell, late, _ = made.step(act(seen))
            total, over = total + float(reward), fell or late
        found.append(total)
    made.close()
    return np.array(found)


def learn(task: str, algorithm: Algorithm, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at one learner."""
    learner, rows = Learner(algorithm, task, seed), []
    for clock in looks(learner.learn, LOOKS, seconds):
        found = returns(task, learner.act, looked_at(task))
        numbers = (f"{value:.4f}" for value in (found.mean(), found.min(), found.max()))
        rows.append((task, algorithm, seed, f"{clock.before[0]:.1f}", learner.model.num_timesteps, *numbers))
        console.print(*rows[-1])
    return rows


def main(
    tasks: tuple[str, ...] = TASKS,
    algorithms: tuple[Algorithm, ...] = ("ppo", "sac"),
    seeds: Sequence[int] = (0, 1, 2),
    seconds: float = 300.0,
    out: Path = OUT,
) -> None:
    """Learn each task by each algorithm with each seed.

    Args:
        tasks: Which, by name.
        algorithms: By which.
        seeds: Of networks, exploration and initial states.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((task, algorithm, seed) for seed, task, algorithm in product(seeds, tasks, algorithms))
    fill(out, COLUMNS, keys, lambda task, algorithm, seed: learn(task, algorithm, seed, seconds, console))


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
