"""Models, and where their episodes begin."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates

__all__ = ["Draw", "Starts", "anywhere", "load_model", "states"]

Array = NDArray[np.float64]


class Starts(NamedTuple):
    """Initial states in MuJoCo's own coordinates."""

    qpos: Array
    """(count, nq)."""
    qvel: Array
    """(count, nv)."""
    goal: Array | None = None
    """(count, size): what the reward and the policy know besides, and what does not move."""
    act: Array | None = None
    """(count, na)."""


Draw = Callable[[np.random.Generator, int], Starts]
"""The law of initial states: (generator, count) -> :class:`Starts`."""


def load_model(source: Any) -> Any:
    """The model of an MjModel, an XML string, or the path of an XML file."""
    if isinstance(source, mujoco.MjModel):
        return source
    text = os.fspath(source)
    try:
        if text.lstrip().startswith("<"):
            return mujoco.MjModel.from_xml_string(text)
        if not Path(text).is_file():
            raise FileNotFoundError(f"there is no model {text}")
        return mujoco.MjModel.from_xml_path(text)
    except ValueError as error:
        raise ValueError(f"MuJoCo cannot compile the model: {str(error).splitlines()[0]}") from error


def anywhere(model: Any, rng: np.random.Generator, count: int) -> Starts:
    """The law of initial states where no other is given: :class:`MujocoProblem` says which."""
    qpos = np.tile(model.qpos0, (count, 1))
    for j in range(model.njnt):
        at, kind = model.jnt_qposadr[j], mujoco.mjtJoint(int(model.jnt_type[j]))
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            qpos[:, at : at + 3] += rng.uniform(-1, 1, (count, 3))
            at += 3
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            q = rng.normal(size=(count, 4))
            qpos[:, at : at + 4] = q / np.linalg.norm(q, axis=1, keepdims=True)
        elif model.jnt_limited[j]:
            low, high = model.jnt_range[j]
            qpos[:, at] = rng.uniform(low, high, count)
        elif kind == mujoco.mjtJoint.mjJNT_HINGE:
            qpos[:, at] = rng.uniform(-np.pi, np.pi, count)
        else:
            qpos[:, at] += rng.uniform(-1, 1, count)
    return Starts(qpos, rng.uniform(-1, 1, (count, model.nv)))


def states(co: Coordinates, size: int, starts: Starts) -> Array:
    """x (count, size) of MuJoCo's coordinates."""
    x = np.zeros((len(starts.qpos), size))
    x[:, co.scalar_row] = starts.qpos[:, co.scalar_qpos]
    for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
        q = starts.qpos[:, start : start + 4]
        x[:, row : row + 4] = np.where(q[:, :1] < 0, -q, q) / np.linalg.norm(q, axis=1, keepdims=True)
    x[:, co.velocity_row] = starts.qvel[:, co.velocity_dof]
    if starts.act is not None:
        x[:, co.activation_row] = starts.act
    if starts.goal is not None:
        x[:, co.goal_row] = starts.goal
    return x
