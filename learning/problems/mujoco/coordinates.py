"""Which numbers are the state: MuJoCo's positions, velocities and activations, and a goal.

    x = [kept positions (a quaternion is four of them), kept velocities, activations, goal]

A position is left out when nothing depends on it: where a swimmer is, for one. Its velocity is kept. Slopes and
costates have a number for each number of x; those of a unit quaternion q are taken to the tangent space, in which
MuJoCo differentiates, and back: with dq/dt = T(q) w, T^T T = 1/4, a slope g of q is T^T g there, and what is h there is
4 T h here.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["Coordinates", "Layout", "layout"]

Indices = NDArray[np.int64]


class Coordinates(NamedTuple):
    """Where the numbers of x stand in MuJoCo's arrays. Compiled code reads it."""

    scalar_row: Indices
    """Rows of x that are positions of hinges and slides, and of the origins of free joints."""
    scalar_qpos: Indices
    scalar_dof: Indices
    quaternion_row: Indices
    """First of four rows, of ball joints and free joints."""
    quaternion_qpos: Indices
    quaternion_dof: Indices
    """First of three degrees of freedom."""
    velocity_row: Indices
    velocity_dof: Indices
    activation_row: Indices
    """As many as there are activations, in their order."""
    goal_row: Indices


class Layout(NamedTuple):
    """The state of a model."""

    coordinates: Coordinates
    names: tuple[str, ...]
    """Of each number of x."""
    angle: Indices
    """Rows that are angles of hinges that turn without limit."""


def _joint_name(model: Any, joint: int) -> str:
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f"joint {joint}"


def layout(model: Any, without: Sequence[str] = (), goal_size: int = 0) -> Layout:
    """The state of ``model``, without the positions of the joints named in ``without``."""
    known = [_joint_name(model, j) for j in range(model.njnt)]
    for name in without:
        if name not in known:
            raise ValueError(f"without names joint {name!r}; the model has {', '.join(known)}")
    names: list[str] = []
    angle: list[int] = []
    scalars: list[tuple[int, int, int]] = []
    quaternions: list[tuple[int, int, int]] = []
    for j, joint in enumerate(known):
        qpos, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        kind = mujoco.mjtJoint(int(model.jnt_type[j]))
        if kind == mujoco.mjtJoint.mjJNT_FREE and joint not in without:
            for k in range(3):
                scalars.append((len(names), qpos + k, dof + k))
                names.append(f"{joint}.{'xyz'[k]}")
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            shift = 3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0
            if shift or joint not in without:
                quaternions.append((len(names), qpos + shift, dof + shift))
                names += [f"{joint}.q{c}" for c in "wxyz"]
        elif joint not in without:
            if kind == mujoco.mjtJoint.mjJNT_HINGE and not model.jnt_limited[j]:
                angle.append(len(names))
            scalars.append((len(names), qpos, dof))
            names.append(joint)
    velocities = [(len(names) + k, k) for k in range(model.nv)]
    names += [f"{_joint_name(model, model.dof_jntid[k])}'" for k in range(model.nv)]
    activations = [len(names) + k for k in range(model.na)]
    names += [f"activation {k}" for k in range(model.na)]
    goals = [len(names) + k for k in range(goal_size)]
    names += [f"goal {k}" for k in range(goal_size)]

    def column(rows: Sequence[tuple[int, ...]], k: int) -> Indices:
        return np.array([row[k] for row in rows], dtype=np.int64)

    return Layout(
        Coordinates(
            column(scalars, 0),
            column(scalars, 1),
            column(scalars, 2),
            column(quaternions, 0),
            column(quaternions, 1),
            column(quaternions, 2),
            column(velocities, 0),
            column(velocities, 1),
            np.array(activations, dtype=np.int64),
            np.array(goals, dtype=np.int64),
        ),
        tuple(names),
        np.array(angle, dtype=np.int64),
    )
