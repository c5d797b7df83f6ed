"""How the state of a model enters the network, and what of it does not matter."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import Encoding
from swimmer_mj.learning.problems.mujoco.coordinates import Layout

__all__ = ["How", "encode", "encoding", "rows_asked_for", "turning", "unused"]

Array = NDArray[np.float64]
How = float | Literal["angle"]
"""A factor, or "angle" for cos and sin; 0 leaves a coordinate out."""


def rows_asked_for(layout: Layout, asked: Mapping[str, How]) -> dict[int, How]:
    """How each row of the state that is named in ``asked`` is encoded."""
    names, rows = layout.names, {}
    for name, how in asked.items():
        found = [i for i, known in enumerate(names) if known == name]
        if not found:
            raise ValueError(f"inputs names {name!r}; the state has {', '.join(dict.fromkeys(names))}")
        if how != "angle" and not (isinstance(how, float | int) and math.isfinite(how)):
            raise ValueError(f"inputs[{name!r}] must be a finite factor or 'angle', got {how!r}")
        rows |= dict.fromkeys(found, how)
    return rows


def encoding(layout: Layout, rows: Mapping[int, How], idle: Collection[int], seen: Array) -> Encoding:
    """Angles that turn freely by cos and sin, the rest scaled to order one.

    Parameters
    ----------
    layout : Layout
        The state, of p numbers.
    rows : mapping
        Those of the state that are encoded in another way.
    idle : collection of int
        Further ones that are left out, unless they are among ``rows``.
    seen : array, shape (N, p)
        States that show what size their numbers are of.
    """
    asked = [i for i, how in rows.items() if how == "angle"]
    unheard = [i for i, how in rows.items() if how == 0] + [i for i in idle if i not in rows]
    angle = np.setdiff1d(np.union1d(np.setdiff1d(layout.angle, list(rows)), asked), unheard).astype(np.int64)
    linear = np.setdiff1d(np.arange(len(layout.names)), np.union1d(angle, unheard)).astype(np.int64)
    size = np.sqrt((seen[:, linear] ** 2).mean(axis=0))
    scale = 1 / np.where(size > 1e-6, size, 1.0)
    for row in layout.coordinates.quaternion_row:
        scale[np.isin(linear, np.arange(row, row + 4))] = 1.0
    for i, how in rows.items():
        if how != "angle":
            scale[linear == i] = how
    n = len(angle)
    k = np.arange(n)
    return Encoding(angle, k, n + k, linear, 2 * n + np.arange(len(linear)), scale)


def encode(encoding: Encoding, x: Tensor) -> Tensor:
    """The network's inputs (..., m) at x (..., p)."""
    angles = x[..., encoding.angle]
    linear = x[..., encoding.linear] * torch.as_tensor(encoding.scale).to(x)
    return torch.cat([torch.cos(angles), torch.sin(angles), linear], dim=-1)


def unused(
    model: Any, layout: Layout, same: Callable[[Array, Array], bool], x: Array, rng: np.random.Generator
) -> tuple[str, ...]:
    """Hinges and slides without limits whose positions make no difference.

    ``same`` tells whether all is the same at the states y (N, p) as at x (N, p), from which one position differs.
    """
    co, found = layout.coordinates, []
    for j in range(model.njnt):
        kind = mujoco.mjtJoint(int(model.jnt_type[j]))
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        if model.jnt_limited[j]:
            continue
        (k,) = np.flatnonzero(co.scalar_qpos == model.jnt_qposadr[j])
        moved = x.copy()
        moved[:, co.scalar_row[k]] += rng.uniform(-3, 3, len(x))
        if same(x, moved):
            found.append(layout.names[co.scalar_row[k]])
    return tuple(found)


def turning(layout: Layout, same: Callable[[Array, Array], bool], x: Array) -> NDArray[np.int64]:
    """The hinges without limits for which a whole turn makes no difference: with a spring it does."""
    found = []
    for row in layout.angle:
        turned = x.copy()
        turned[:, row] += 2 * math.pi
        if same(x, turned):
            found.append(row)
    return np.array(found, dtype=np.int64)
