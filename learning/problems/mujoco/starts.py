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

__all__ = ["Draw", "Starts", "anywhere", "drawn", "held_for", "is_file", "load_model", "states"]

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


def is_file(name: str) -> bool:
    """Whether it is that of a file of MJCF."""
    return name.lower().endswith(".xml")


def _model_in(source: Any) -> Any:
    """The MjModel in what dm_control and Gymnasium make, by what it is called there; else ``source`` itself."""
    inner = getattr(source, "unwrapped", source)
    for name in ("physics", "model", "ptr"):
        inner = getattr(inner, name, inner)
    return inner if isinstance(inner, mujoco.MjModel) else source


def held_for(source: Any, model: Any) -> float:
    """For how long the environment ``source`` holds a control, s; of anything else, the time step of its ``model``."""
    environment: Any = getattr(source, "unwrapped", source)
    if hasattr(environment, "control_timestep"):
        return float(environment.control_timestep())
    return float(getattr(environment, "dt", model.opt.timestep * getattr(environment, "frame_skip", 1)))


def load_model(source: Any) -> Any:
    """The model of an MjModel, an MjSpec, an XML string, or the path of an XML file; or in an environment or a Physics.

    An environment is dm_control's or one of Gymnasium's on MuJoCo, also wrapped; dm_control's own MjModel is taken too.
    """
    source = _model_in(source)
    if isinstance(source, mujoco.MjModel):
        return source
    if not isinstance(source, str | os.PathLike | mujoco.MjSpec):
        raise ValueError(
            "the model must be an MjModel, an MjSpec, XML, a path, an environment or a Physics of dm_control, or a "
            f"MuJoCo environment of Gymnasium, got {type(getattr(source, 'unwrapped', source)).__name__}"
        )
    try:
        if isinstance(source, mujoco.MjSpec):
            return source.compile()
        text = os.fspath(source)
        if text.lstrip().startswith("<"):
            return mujoco.MjModel.from_xml_string(text)
        if not Path(text).is_file():
            raise FileNotFoundError(f"there is no model {text}")
        return mujoco.MjModel.from_xml_path(text)
    except ValueError as error:
        raise ValueError(f"MuJoCo cannot compile the model: {' '.join(str(error).split())}") from error


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
            q /= np.linalg.norm(q, axis=1, keepdims=True)
            if model.jnt_limited[j]:
                q = _turned_by(rng.uniform(0, model.jnt_range[j, 1], count), q[:, 1:])
            qpos[:, at : at + 4] = q
        elif model.jnt_limited[j]:
            low, high = model.jnt_range[j]
            qpos[:, at] = rng.uniform(low, high, count)
        elif kind == mujoco.mjtJoint.mjJNT_HINGE:
            qpos[:, at] = rng.uniform(-np.pi, np.pi, count)
        else:
            qpos[:, at] += rng.uniform(-1, 1, count)
    return Starts(qpos, rng.uniform(-1, 1, (count, model.nv)))


def _turned_by(angle: Array, axis: Array) -> Array:
    """Unit quaternions (N, 4) of turns by ``angle`` (N,) about ``axis`` (N, 3)."""
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return np.concatenate([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * axis], axis=1)


def drawn(model: Any, draw: Draw, rng: np.random.Generator, count: int) -> Starts:
    """``count`` initial states by ``draw``; an error if they are not as many, or not of the model's size."""
    found = draw(rng, count)
    if not isinstance(found, Starts):
        raise ValueError(f"draw must return Starts(qpos, qvel), got {type(found).__name__}")
    goal, act = (
        None if part is None else np.asarray(part, dtype=np.float64) for part in (found.goal, found.act)
    )
    starts = Starts(
        np.asarray(found.qpos, dtype=np.float64), np.asarray(found.qvel, dtype=np.float64), goal, act
    )
    for name, size in (("qpos", model.nq), ("qvel", model.nv), ("act", model.na)):
        value = getattr(starts, name)
        if value is not None and value.shape != (count, size):
            raise ValueError(
                f"{name} of {count} initial states must have shape {(count, size)}, got {value.shape}"
            )
    return starts


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
