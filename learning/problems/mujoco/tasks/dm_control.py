"""Tasks of the DeepMind Control Suite (Tassa et al. 2018, arXiv:1801.00690): their rewards, restated in torch.

Held equal to the suite's own at random states and controls by a test. Where a reward is 1 in a small set and 0
elsewhere, what is learned is a smooth reward with the same optimum.
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
from swimmer_mj.learning.problems.mujoco.tasks.tolerance import tolerance

__all__ = ["TASKS"]

Array = NDArray[np.float64]


# pendulum ----------------------------------------------------------------------------------------------------------


def _upright(scene: Scene) -> Tensor:
    """cos of the pole's angle from the vertical."""
    return scene.body_frame("pole")[:, 2, 2]


def _pendulum(scene: Scene) -> Tensor:
    return tolerance(_upright(scene), (math.cos(math.radians(8)), 1.0))


# cartpole ----------------------------------------------------------------------------------------------------------


def _cartpole(scene: Scene) -> Tensor:
    """The product of upright, centred and slow; 4/5 of it is paid whatever the control, see :func:`_cartpole_cost`."""
    poles = scene.qvel.shape[1] - 1
    upright = torch.stack(
        [(scene.body_frame(f"pole_{k + 1}")[:, 2, 2] + 1) / 2 for k in range(poles)], dim=1
    ).mean(dim=1)
    centred = (1 + tolerance(scene.joint("slider"), margin=2.0)) / 2
    slow = (1 + tolerance(scene.qvel[:, 1:], margin=5.0).min(dim=1).values) / 2
    return upright * slow * centred


def _cartpole_cost(scene: Scene) -> Tensor:
    """(4 + 1 - u^2) / 5 of the reward: u^2 costs a fifth of it."""
    return _cartpole(scene)[:, None] / 5


def _cart_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """Poles at any angle, the cart on its track but for its ends."""
    qpos = rng.uniform(-math.pi, math.pi, (count, model.nq))
    qpos[:, 0] = rng.uniform(-1.2, 1.2, count)
    return Starts(qpos, rng.uniform(-2.0, 2.0, (count, model.nv)))


def _cart_upright(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """Poles within a quarter of a radian of the vertical."""
    qpos = rng.uniform(-0.25, 0.25, (count, model.nq))
    qpos[:, 0] = rng.uniform(-0.8, 0.8, count)
    return Starts(qpos, rng.uniform(-0.5, 0.5, (count, model.nv)))


# point_mass --------------------------------------------------------------------------------------------------------

_POINT_MASS_TARGET = 0.015
"""Radius of the target, m."""


def _distance(scene: Scene, one: str, other: str, axes: int = 3) -> Tensor:
    return (scene.geom(one) - scene.geom(other))[:, :axes].norm(dim=1)


def _point_mass(scene: Scene) -> Tensor:
    size = _POINT_MASS_TARGET
    return tolerance(_distance(scene, "pointmass", "target"), (0.0, size), size)


def _point_mass_cost(scene: Scene) -> Tensor:
    """Of two controls, each costs a tenth of the reward."""
    return (_point_mass(scene)[:, None] / 10).expand(-1, 2)


def _point_mass_learned(scene: Scene) -> Tensor:
    size = _POINT_MASS_TARGET
    distance = _distance(scene, "pointmass", "target")
    return (_point_mass(scene) + tolerance(distance, (0.0, size), 0.3, "long_tail")) / 2


# reacher -----------------------------------------------------------------------------------------------------------


def _finger_distance(scene: Scene) -> Tensor:
    return (scene.geom("finger")[:, :2] - scene.goal).square().sum(dim=1).clamp(min=1e-18).sqrt()


def _reacher(radius: float) -> Any:
    def reward(scene: Scene) -> Tensor:
        return tolerance(_finger_distance(scene), (0.0, radius + 0.01))

    return reward


def _reacher_learned(radius: float) -> Any:
    def reward(scene: Scene) -> Tensor:
        near = tolerance(_finger_distance(scene), margin=radius + 0.01, value_at_margin=0.5)
        far = tolerance(_finger_distance(scene), margin=0.15, sigmoid="long_tail")
        return (near + far) / 2

    return reward


def _target(model: Any, data: Any) -> Array:
    """x and y of the target, m."""
    return np.array(model.geom("target").pos[:2])


def _reach_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """The suite's law, with some velocity."""
    qpos = rng.uniform(-math.pi, math.pi, (count, 2))
    low, high = model.jnt_range[1]
    qpos[:, 1] = rng.uniform(low, high, count)
    angle, radius = rng.uniform(0, 2 * math.pi, count), rng.uniform(0.05, 0.20, count)
    goal = np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=1)
    return Starts(qpos, rng.uniform(-3.0, 3.0, (count, 2)), goal)


# acrobot -----------------------------------------------------------------------------------------------------------

_ACROBOT_TARGET = 0.2
"""Radius of the target, m."""


def _acrobot(scene: Scene) -> Tensor:
    distance = (scene.site("tip") - scene.site("target")).square().sum(dim=1).clamp(min=1e-18).sqrt()
    return tolerance(distance, (0.0, _ACROBOT_TARGET), 1.0)


def _acrobot_learned(scene: Scene) -> Tensor:
    distance = (scene.site("tip") - scene.site("target")).square().sum(dim=1).clamp(min=1e-18).sqrt()
    return (_acrobot(scene) + tolerance(distance, margin=2.0)) / 2


def _acrobot_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    return Starts(rng.uniform(-math.pi, math.pi, (count, 2)), rng.uniform(-3.0, 3.0, (count, 2)))


# swimmer -----------------------------------------------------------------------------------------------------------

_SWIMMER_TARGET = 0.1
"""Radius of the target, m."""


def _swimmer(scene: Scene) -> Tensor:
    """Nearness of the nose to the target, which stands at the origin (see :func:`_from_target`)."""
    return tolerance(_nose_distance(scene), (0.0, _SWIMMER_TARGET), 5 * _SWIMMER_TARGET, "long_tail")


def _nose_distance(scene: Scene) -> Tensor:
    return scene.geom("nose")[:, :2].square().sum(dim=1).clamp(min=1e-18).sqrt()


def _swimmer_learned(scene: Scene) -> Tensor:
    """Half of it for being nearer from afar: at 2 m the environment's reward has hardly a slope."""
    afar = tolerance(_nose_distance(scene), (0.0, _SWIMMER_TARGET), 3.0, "long_tail")
    return (_swimmer(scene) + afar) / 2


def _from_target(qpos: Array, goal: Array) -> Array:
    """Where the swimmer is, seen from the target."""
    qpos = qpos.copy()
    qpos[..., :2] -= goal
    return qpos


def _swim_anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """The suite's law: joints anywhere in their ranges, the target in a box of 4 m or, one time in five, 0.6 m."""
    box = np.where(rng.random(count) < 0.2, 0.3, 2.0)[:, None]
    qpos = np.empty((count, model.nq))
    qpos[:, :2] = rng.uniform(-1, 1, (count, 2)) * box
    qpos[:, 2] = rng.uniform(-math.pi, math.pi, count)
    low, high = model.jnt_range[3:].T
    qpos[:, 3:] = rng.uniform(low, high, (count, model.nq - 3))
    qvel = rng.uniform(-1, 1, (count, model.nv)) * np.where(np.arange(model.nv) < 2, 0.3, 1.0)
    return Starts(qpos, qvel)


_SWIMMER = Task(
    _swimmer,
    learned=_swimmer_learned,
    draw=_swim_anywhere,
    goal=_target,
    relative=_from_target,
    s_gamma=0.15,
    advice={"s_lambda": 1.0, "value_weight": 1.0, "half_life": 250.0},
)

_SEVERAL_POLES = Task(
    _cartpole,
    _cartpole_cost,
    draw=_cart_anywhere,
    s_gamma=0.3,
    advice={"dt": 0.005, "steps": 60, "trajectories": 128},  # they whirl
)

TASKS: dict[str, Task] = {
    "pendulum/swingup": Task(_pendulum, learned=_upright, s_gamma=0.2),
    "cartpole/balance": Task(_cartpole, _cartpole_cost, draw=_cart_upright),
    "cartpole/swingup": Task(_cartpole, _cartpole_cost, draw=_cart_anywhere, s_gamma=0.3),
    "cartpole/two_poles": _SEVERAL_POLES,
    "cartpole/three_poles": _SEVERAL_POLES,
    "point_mass/easy": Task(_point_mass, _point_mass_cost, _point_mass_learned),
    "reacher/easy": Task(_reacher(0.05), learned=_reacher_learned(0.05), draw=_reach_anywhere, goal=_target),
    "reacher/hard": Task(
        _reacher(0.015),
        learned=_reacher_learned(0.015),
        draw=_reach_anywhere,
        goal=_target,
        advice={"huber": None},  # with it rare positions of the arm are learned late
    ),
    "acrobot/swingup": Task(
        _acrobot,
        learned=_acrobot_learned,
        draw=_acrobot_anywhere,
        s_gamma=0.2,
        advice={"dt": 0.002, "steps": 250, "trajectories": 128, "s_lambda": 2.0, "trial_duration": 8.0},
    ),
    "swimmer/swimmer6": _SWIMMER,
    "swimmer/swimmer15": _SWIMMER._replace(
        advice={**_SWIMMER.advice, "passes": 4},  # MuJoCo takes most of the time
    ),
}
"""By "domain/task"."""
