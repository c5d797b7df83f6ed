"""Coordinates that turn with a body in a plane, which sees the world as it does from there.

The body stands on two slides, q_1 and q_2, and a hinge turns it by theta about their normal. V is learned in

    y = R(-theta) (q + o),    R(-theta) q'

with o the place of the hinge at q = 0, and all else as it is. If a turn of everything about the origin changes neither
how the model moves nor the reward, V does not depend on theta in these coordinates, and the network does not hear it.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import BatchCoordinates
from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates

__all__ = ["Heading", "batch_coordinates", "enter", "headings", "leave", "turned", "turns_along"]

Array = NDArray[np.float64]


class Heading(NamedTuple):
    """Rows of the state."""

    hinge: int
    """theta."""
    sign: float
    """1 if the hinge turns from the first slide to the second, else -1."""
    position: tuple[int, int] | None
    """Of the slides; None if they are left out of the state."""
    velocity: tuple[int, int]
    """Of the slides."""
    offset: tuple[float, float]
    """o, m."""

    def pairs(self) -> Iterator[tuple[int, int, float, float]]:
        """What is turned: rows, and what is added before."""
        if self.position is not None:
            yield (*self.position, *self.offset)
        yield (*self.velocity, 0.0, 0.0)


def headings(model: Any, co: Coordinates) -> Iterator[Heading]:
    """Those of all bodies that stand on two slides and a hinge, in this order, on what does not move."""
    kinds = mujoco.mjtJoint
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body in range(model.nbody):
        first_joint = model.body_jntadr[body]
        joints = range(first_joint, first_joint + model.body_jntnum[body])
        if [model.jnt_type[j] for j in joints] != [kinds.mjJNT_SLIDE, kinds.mjJNT_SLIDE, kinds.mjJNT_HINGE]:
            continue
        one, other, normal = (data.xaxis[j] for j in joints)
        sign = float(normal @ np.cross(one, other))
        if model.body_weldid[model.body_parentid[body]] != 0 or abs(abs(sign) - 1) > 1e-9:
            continue
        x, y, theta = (np.flatnonzero(co.scalar_qpos == model.jnt_qposadr[j]) for j in joints)
        if theta.size == 0 or x.size != y.size:
            continue
        position = (int(co.scalar_row[x[0]]), int(co.scalar_row[y[0]])) if x.size else None
        first, second, _ = (int(co.velocity_row[co.velocity_dof == model.jnt_dofadr[j]][0]) for j in joints)
        place = data.xanchor[joints[2]]  # at qpos0
        slides = model.qpos0[model.jnt_qposadr[first_joint : first_joint + 2]]
        offset = (float(place @ one - slides[0]), float(place @ other - slides[1]))
        yield Heading(int(co.scalar_row[theta[0]]), sign, position, (first, second), offset)


def turned(heading: Heading, x: Array, angle: Array, rates: bool = False) -> Array:
    """The states x (N, p), turned by ``angle`` (N,) about the origin; with ``rates`` x is what a state changes by."""
    y, c, s = x.copy(), np.cos(angle), np.sin(heading.sign * angle)
    for i, j, a, b in heading.pairs():
        one, other = (x[:, i], x[:, j]) if rates else (x[:, i] + a, x[:, j] + b)
        y[:, i], y[:, j] = c * one - s * other, s * one + c * other
        if not rates:
            y[:, i] -= a
            y[:, j] -= b
    if not rates:
        y[:, heading.hinge] += angle
    return y


def turns_along(heading: Heading, changes: Callable[[Array], Array], x: Array, angle: Array) -> bool:
    """Whether what the states x (N, p) change by, (N, k, p), turns with them by ``angle`` (N,)."""
    expected = changes(x)
    for k in range(expected.shape[1]):
        expected[:, k] = turned(heading, expected[:, k], angle, rates=True)
    scale = 1 + np.abs(expected).max(axis=(1, 2), keepdims=True)
    return bool((np.abs(changes(turned(heading, x, angle)) - expected) < 1e-7 * scale).all())


def enter(heading: Heading, x: Tensor) -> Tensor:
    """y of x, (..., p)."""
    return _turn(heading, x, -1.0)


def leave(heading: Heading, y: Tensor) -> Tensor:
    """Its inverse."""
    return _turn(heading, y, 1.0)


def _turn(heading: Heading, x: Tensor, way: float) -> Tensor:
    columns = list(x.unbind(dim=-1))
    theta = heading.sign * columns[heading.hinge]
    c, s = torch.cos(theta), way * torch.sin(theta)
    for i, j, a, b in heading.pairs():
        one, other = (columns[i] + a, columns[j] + b) if way < 0 else (columns[i], columns[j])
        columns[i], columns[j] = c * one - s * other, s * one + c * other
        if way > 0:
            columns[i], columns[j] = columns[i] - a, columns[j] - b
    return torch.stack(columns, dim=-1)


def batch_coordinates(heading: Heading) -> BatchCoordinates:
    """The coordinates of many states at once."""
    return BatchCoordinates(
        partial(_enter, heading), partial(_to_state, heading), partial(_from_state, heading)
    )


def _enter(heading: Heading, x: Array, y: Array) -> None:
    """Fill y (p, N) at x (p, N)."""
    y[:] = x
    theta = heading.sign * x[heading.hinge]
    c, s = np.cos(theta), np.sin(theta)
    for i, j, a, b in heading.pairs():
        y[i], y[j] = c * (x[i] + a) + s * (x[j] + b), c * (x[j] + b) - s * (x[i] + a)


def _to_state(heading: Heading, x: Array, slope: Array) -> None:
    """Replace dV/dy (p, N) by dV/dx at x (p, N)."""
    theta = heading.sign * x[heading.hinge]
    c, s = np.cos(theta), np.sin(theta)
    for i, j, a, b in heading.pairs():
        one, other = c * slope[i] - s * slope[j], s * slope[i] + c * slope[j]
        slope[heading.hinge] += heading.sign * (one * (x[j] + b) - other * (x[i] + a))
        slope[i], slope[j] = one, other


def _from_state(heading: Heading, x: Array, slope: NDArray[Any]) -> None:
    """Replace dV/dx (T, p, N) by dV/dy at x (T, p, N)."""
    theta = heading.sign * x[:, heading.hinge]
    c, s = np.cos(theta), np.sin(theta)
    for i, j, a, b in heading.pairs():
        one, other = slope[:, i].astype(np.float64), slope[:, j].astype(np.float64)
        slope[:, heading.hinge] -= heading.sign * (one * (x[:, j] + b) - other * (x[:, i] + a))
        slope[:, i], slope[:, j] = c * one + s * other, c * other - s * one
