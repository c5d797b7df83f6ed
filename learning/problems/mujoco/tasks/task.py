"""What is known of an environment besides its model: its reward in torch, and how it is best learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.mujoco.readings import Scene
from swimmer_mj.learning.problems.mujoco.starts import Starts

__all__ = ["Task"]

Array = NDArray[np.float64]


def _no_goal(model: Any, data: Any) -> Array:
    return np.zeros(0)


def _as_it_is(qpos: Array, goal: Array) -> Array:
    return qpos


class Task(NamedTuple):
    """An environment's reward, and what differs in learning it."""

    reward: Callable[[Scene], Tensor]
    """The environment's reward at a state, without what the control costs; (N,)."""
    cost: Callable[[Scene], Tensor] | tuple[float, ...] | None = None
    """Coefficients of ctrl^2 in it, (N, q) or one for each control."""
    learned: Callable[[Scene], Tensor] | None = None
    """The reward that is learned, where the environment's has no slope; None: the environment's."""
    draw: Callable[[Any, np.random.Generator, int], Starts] | None = None
    """Initial states to learn from: (model, generator, count); None: the default law."""
    goal: Callable[[Any, Any], Array] = _no_goal
    """What the reward knows of (model, data) that is no part of MuJoCo's state."""
    relative: Callable[[Array, Array], Array] = _as_it_is
    """qpos in coordinates in which there is no goal, from qpos and goal; the goal is then no part of the state."""
    s_gamma: float = 1.0
    """Shortness factor that learns it well, 1/s."""
    advice: Mapping[str, Any] = {}
    """Settings of value gradients that learn it well."""
