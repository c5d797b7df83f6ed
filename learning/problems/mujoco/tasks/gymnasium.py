"""Gymnasium's MuJoCo tasks (version 5): their rewards, restated in torch; held equal to Gymnasium's own by a test.

An environment that ends when something falls pays for not falling; what is learned is then a smooth reward of standing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.mujoco.readings import Scene
from swimmer_mj.learning.problems.mujoco.starts import Starts
from swimmer_mj.learning.problems.mujoco.tasks.task import Task

__all__ = ["TASKS"]

Array = NDArray[np.float64]


def _inverted_pendulum(scene: Scene) -> Tensor:
    """1 while the pole is within 0.2 rad of the vertical."""
    return (scene.joint("hinge").abs() <= 0.2).to(scene.qpos.dtype)


def _inverted_pendulum_learned(scene: Scene) -> Tensor:
    """Upright, and in the middle of the track; bounded, so that a pole that has fallen does not count for much."""
    return torch.exp(-((scene.joint("hinge") / 0.3) ** 2)) - 0.3 * scene.joint("slider") ** 2


def _near_upright(model: Any, rng: np.random.Generator, count: int) -> Starts:
    qpos = rng.uniform(-0.2, 0.2, (count, model.nq))
    qpos[:, 0] = rng.uniform(-0.7, 0.7, count)
    return Starts(qpos, rng.uniform(-0.5, 0.5, (count, model.nv)))


def _tip(scene: Scene) -> tuple[Tensor, Tensor]:
    """Across and up, m."""
    tip = scene.site("tip")
    return tip[:, 0], tip[:, 2]


def _penalty(scene: Scene) -> Tensor:
    x, y = _tip(scene)
    v1, v2 = scene.qvel[:, 1], scene.qvel[:, 2]
    return 0.01 * x**2 + (y - 2) ** 2 + 1e-3 * v1**2 + 5e-3 * v2**2


def _double_pendulum(scene: Scene) -> Tensor:
    """10 while the tip is higher than 1 m, less what distance and speed cost."""
    return 10 * (_tip(scene)[1] > 1).to(scene.qpos.dtype) - _penalty(scene)


def _double_pendulum_learned(scene: Scene) -> Tensor:
    """Distance and speed, and the cart in the middle of its track."""
    return -_penalty(scene) - (scene.joint("slider") / 0.9) ** 2


def _from_target(scene: Scene) -> Tensor:
    """Distance of the fingertip from the target, m."""
    away = scene.centre_of_mass("fingertip") - scene.centre_of_mass("target")
    return away.square().sum(dim=1).clamp(min=1e-18).sqrt()


def _reacher(scene: Scene) -> Tensor:
    away = scene.body("fingertip") - scene.body("target")
    return -away.square().sum(dim=1).clamp(min=1e-18).sqrt()


def _reach_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """Arms anywhere, targets within 0.2 m."""
    qpos = rng.uniform(-math.pi, math.pi, (count, 4))
    qpos[:, 1] = rng.uniform(-2.8, 2.8, count)
    angle, radius = rng.uniform(0, 2 * math.pi, count), 0.2 * np.sqrt(rng.random(count))
    qpos[:, 2:] = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    qvel = rng.uniform(-3.0, 3.0, (count, 4))
    qvel[:, 2:] = 0.0
    return Starts(qpos, qvel)


def _swimmer(scene: Scene) -> Tensor:
    """Velocity along x of the origin of the first body, m/s, at the instant.

    The environment pays its mean over a control step: how far the body came, per time.
    """
    return scene.qvel[:, 0]


def _swim_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    qpos = np.zeros((count, 5))
    qpos[:, 2] = rng.uniform(-math.pi, math.pi, count)
    qpos[:, 3:] = rng.uniform(-1.7, 1.7, (count, 2))
    return Starts(qpos, rng.uniform(-1.0, 1.0, (count, 5)))


TASKS: dict[str, Task] = {
    "InvertedPendulum-v5": Task(
        _inverted_pendulum,
        learned=_inverted_pendulum_learned,
        draw=_near_upright,
        advice={"dt": 0.02, "trial_duration": 1.0, "s_lambda": 10.0},
    ),
    "InvertedDoublePendulum-v5": Task(
        _double_pendulum,
        learned=_double_pendulum_learned,
        draw=_near_upright,
        s_gamma=2.0,
        advice={"dt": 0.02, "trial_duration": 1.0, "s_lambda": 20.0, "half_life": 20.0},
    ),
    "Reacher-v5": Task(
        _reacher, (1.0, 1.0), draw=_reach_anywhere, s_gamma=2.0, advice={"trial_duration": 1.0}
    ),
    "Swimmer-v5": Task(
        _swimmer,
        (1e-4, 1e-4),
        draw=_swim_anywhere,
        s_gamma=0.05,
        advice={"s_lambda": 1.0, "value_weight": 1.0, "half_life": 150.0, "layers": [128, 128]},
    ),
}
"""By the identifier that ``gymnasium.make`` knows."""
