"""Are models learned that no suite has: an arm of seven joints that reaches, and a quadrotor that hovers?

    python benchmarks/own_models.py [--names arm7 ...] [--seeds 0 1 ...] [--seconds 300]

adds to benchmarks/results/own-models.csv, a row a look: value gradients on the MJCF files in benchmarks/models with the
rewards below, one learner on one core. Judged in MuJoCo from 64 fresh starts: the share of episodes of which the whole
last second is spent at the goal, and the mean distance in it. A seed that is there already is not learned again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor
from yardstick import Row, fill, looks

from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.mujoco import MujocoProblem
from swimmer_mj.learning.problems.mujoco.readings import Scene
from swimmer_mj.learning.problems.mujoco.starts import Starts
from swimmer_mj.learning.problems.mujoco.task import ADVICE
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

HERE = Path(__file__).parent
OUT = HERE / "results" / "own-models.csv"
COLUMNS = ("model", "seed", "cpu_seconds", "at_the_goal_share", "distance_mean", "distance_max")
EPISODES = 64
EPISODE = 4.0  # s
LOOKS = (5.0, 7.5, 11.0, 17.0, 25.0, 40.0, 60.0, 90.0, 130.0, 200.0)  # s

Array = NDArray[np.float64]


class OwnModel(NamedTuple):
    """A model, what is wanted of it, and from where."""

    reward: Callable[[Scene], Tensor]
    draw: Callable[[Any, np.random.Generator, int], Starts]
    distance: Callable[[Any, Array], float]
    """Of the data from the goal (size,), m."""
    near: float
    """What counts as there, m."""
    settings: dict[str, Any]


# The arm -----------------------------------------------------------------------------------------------------------


def reach(scene: Scene) -> Tensor:
    """The hand at the goal, and at rest there."""
    away = (scene.site("hand") - scene.goal).square().sum(dim=1)
    return torch.exp(-away / 0.05**2) + torch.exp(-away / 0.4**2) - 0.01 * scene.qvel.square().sum(dim=1)


def arm_starts(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """Joints within a radian of upright, goals in the half of a shell in front: 0.35 to 0.7 m from the shoulder."""
    radius, turn = rng.uniform(0.35, 0.7, count), rng.uniform(-math.pi, math.pi, count)
    height = rng.uniform(0.0, 0.9, count)
    flat = radius * np.sqrt(1 - height**2)
    goal = np.stack([flat * np.cos(turn), flat * np.sin(turn), 0.35 + radius * height], axis=1)
    return Starts(rng.uniform(-1, 1, (count, 7)), rng.uniform(-0.5, 0.5, (count, 7)), goal)


def hand_distance(data: Any, goal: Array) -> float:
    """m."""
    return float(np.linalg.norm(data.site("hand").xpos - goal))


# The quadrotor -----------------------------------------------------------------------------------------------------


def hover(scene: Scene) -> Tensor:
    """At the origin, upright, and slow."""
    away = scene.body("body").square().sum(dim=1)
    upright = scene.body_frame("body")[:, 2, 2]
    speed = scene.qvel[:, :3].square().sum(dim=1)
    spin = scene.qvel[:, 3:].square().sum(dim=1)
    return (
        0.5 * upright
        + torch.exp(-away / 0.15**2)
        - (away + 0.01).sqrt()
        - 0.1 * (speed + 0.1).sqrt()
        - 0.05 * (spin + 0.1).sqrt()
    )


def quadrotor_starts(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """Within a metre of the origin, turned by up to a radian about any axis, moving."""
    axis, angle = rng.normal(size=(count, 3)), rng.uniform(0, 1, (count, 1))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    turned = np.concatenate([np.cos(angle / 2), axis * np.sin(angle / 2)], axis=1)
    qpos = np.concatenate([rng.uniform(-1, 1, (count, 3)), turned], axis=1)
    return Starts(qpos, rng.uniform(-1, 1, (count, 6)))


def body_distance(data: Any, goal: Array) -> float:
    """m."""
    return float(np.linalg.norm(data.body("body").xpos))


MODELS = {
    "arm7": OwnModel(reach, arm_starts, hand_distance, 0.05, {"dt": 0.02, "trial_duration": 4.0}),
    "quadrotor": OwnModel(
        hover, quadrotor_starts, body_distance, 0.1, {"dt": 0.02, "trial_duration": 3.0, "steps": 20}
    ),
}


def judge(problem: MujocoProblem, own: OwnModel, act: Callable[[Array], Array]) -> Array:
    """Distances in the last second of each episode, (EPISODES, steps), in MuJoCo as it is."""
    x = problem.initial_states(np.random.default_rng(10**6), EPISODES)
    goals = x[:, problem.layout.coordinates.goal_row]
    episodes = []
    for state in x:
        data = mujoco.MjData(problem.model)
        problem.place(data, state)
        mujoco.mj_forward(problem.model, data)
        episodes.append(data)
    dt = problem.control_timestep
    steps, substeps = round(EPISODE / dt), round(dt / problem.model.opt.timestep)
    seen = []
    for k in range(steps):
        states = Starts(
            np.stack([data.qpos for data in episodes]), np.stack([data.qvel for data in episodes]), goals
        )
        for data, ctrl in zip(episodes, problem.ctrl(act(problem.states(states))), strict=True):
            data.ctrl[:] = ctrl
            mujoco.mj_step(problem.model, data, substeps)
        if (k + 1) * dt > EPISODE - 1:
            seen.append([own.distance(data, goal) for data, goal in zip(episodes, goals, strict=True)])
    return np.array(seen).T


def learn(name: str, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at one learner."""
    own = MODELS[name]
    model = mujoco.MjModel.from_xml_path(str(HERE / "models" / f"{name}.xml"))
    problem = MujocoProblem(
        model,
        own.reward,
        name=name,
        draw=lambda rng, count: own.draw(model, rng, count),
        control_timestep=0.02,
        threads=1,
    )
    network = Multilayer(
        problem.n_inputs, (64, 64), generator=torch.Generator().manual_seed(seed), dtype=torch.float32
    )
    learner = ValueGradientLearner(
        problem, network, ValueGradientSettings(**{**ADVICE, **own.settings}), seed=seed
    )
    learner.step()  # compiles
    rows: list[Row] = []
    for clock in looks(learner.step, LOOKS, seconds):
        away, at = judge(problem, own, learner.policy().acting()), clock.before[0]
        there = (away < own.near).all(axis=1).mean()
        rows.append((name, seed, f"{at:.1f}", *(f"{y:.4f}" for y in (there, away.mean(), away.max()))))
        console.print(*rows[-1])
    return rows


def main(
    names: tuple[str, ...] = tuple(MODELS),
    seeds: Sequence[int] = tuple(range(10)),
    seconds: float = 300.0,
    out: Path = OUT,
) -> None:
    """Learn each model with each seed.

    Args:
        names: Which.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((name, seed) for seed in seeds for name in names)
    fill(out, COLUMNS, keys, lambda name, seed: learn(name, seed, seconds, console))


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
