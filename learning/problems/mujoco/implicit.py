"""What an implicit step in a fluid solves, without the fluid's derivative being assembled and factored anew.

MuJoCo's ``implicitfast`` solves A (v' - v) = h f with A = M - h D, where D = d f / dv holds dampers and drag. A
derivative of that step by finite differences would assemble D and factor A for each coordinate that is moved, which
with many links is most of its cost. One factor is enough: with a = (v' - v) / h and mu = A^-T w,

    w . dv' = w . dv + h mu . (df - dA a),

where df is what A^-1 of the state that is not moved makes of the forces of the one that is, and mu . A a, of which only
the change matters, takes the velocities of the bodies under mu and a as if these were joint velocities.

Drag is that of MuJoCo's equivalent inertia boxes (https://mujoco.readthedocs.io/en/stable/computation/fluid.html).
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.learning.problems.mujoco.library import OPTIONS

__all__ = ["Implicit", "bilinear", "implicit", "once", "solve"]

Array = NDArray[np.float64]
Integers = NDArray[np.int32]


class Implicit(NamedTuple):
    """Views of one mjData and its model; empty where :func:`once` is false."""

    mass: Array
    """M, lower triangle by sparse rows."""
    factor: Array
    """A = L^T diag(d) L, after MuJoCo's step: L below its diagonal of ones, in the rows of M."""
    inverse_diagonal: Array
    """1 / d."""
    row_size: Integers
    row_start: Integers
    column: Integers
    parent: Integers
    """Of each body."""
    root: Integers
    first_dof: Integers
    dofs: Integers
    """Of each body, how many."""
    motion: Array
    """Of each degree of freedom: what its velocity adds to a body's, about the tree's centre of mass, (nv, 6)."""
    velocity: Array
    """Of each body, about the same point, (nbody, 6)."""
    centre: Array
    """Of mass, of each tree, (nbody, 3)."""
    position: Array
    """Of each body's own centre of mass, (nbody, 3)."""
    frame: Array
    """Of its inertia, (nbody, 9)."""
    viscous: Array
    """Drag per velocity, turning and then moving along the axes of that frame, (nbody, 6)."""
    quadratic: Array
    """d drag / d velocity, per size of the velocity, (nbody, 6)."""
    wind: Array
    """(3,)."""
    of_mu: Array
    """Room for the bodies' velocities under mu, (nbody, 6)."""
    of_a: Array
    """Under a."""


def once(model: Any) -> bool:
    """Whether one factor does for the derivative of a step.

    True for ``implicitfast`` in a fluid where the rest of D does not change with the state: hinges and slides, linear
    dampers, no ellipsoids, no actuator whose force depends on a velocity.
    """
    kinds, joints, option = mujoco.mjtIntegrator, mujoco.mjtJoint, model.opt
    passive = int(mujoco.mjtDisableBit.mjDSBL_SPRING) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
    gains_and_biases = (model.actuator_gainprm[:, 2], model.actuator_biasprm[:, 2])
    return (
        option.integrator == int(kinds.mjINT_IMPLICITFAST)
        and (option.density > 0 or option.viscosity > 0)
        and not option.disableflags & passive
        and bool(np.isin(model.jnt_type, (int(joints.mjJNT_HINGE), int(joints.mjJNT_SLIDE))).all())
        and not model.geom_fluid[:, 0].any()
        and not any(values.any() for values in gains_and_biases)
        and not any(
            getattr(model, name).any()
            for name in (
                "tendon_damping",
                "actuator_damping",
                *(f"{of}_dampingpoly" for of in ("dof", "tendon", "actuator")),
            )
        )
    )


def implicit(model: Any, data: Any) -> Implicit:
    """The views, of a model or, where :func:`once` is false, of none."""
    if not once(model):
        numbers, table = np.empty(0), np.empty((0, 0))
        whole = np.empty(0, dtype=np.int32)
        return Implicit(
            numbers, numbers, numbers, whole, whole, whole, whole, whole, whole, whole,
            table, table, table, table, table, table, table, numbers, table, table,
        )  # fmt: skip
    viscous, quadratic = _drag(model)
    return Implicit(
        data.M, data.qH, data.qHDiagInv, model.M_rownnz, model.M_rowadr, model.M_colind,
        model.body_parentid, model.body_rootid, model.body_dofadr, model.body_dofnum,
        data.cdof, data.cvel, data.subtree_com, data.xipos, data.ximat, viscous, quadratic,
        np.array(model.opt.wind), np.zeros((model.nbody, 6)), np.zeros((model.nbody, 6)),
    )  # fmt: skip


def _drag(model: Any) -> tuple[Array, Array]:
    """``viscous`` and ``quadratic`` of bodies as boxes of equal inertia."""
    viscous, quadratic = np.zeros((model.nbody, 6)), np.zeros((model.nbody, 6))
    density, viscosity = model.opt.density, model.opt.viscosity
    for body in range(1, model.nbody):
        mass, inertia = model.body_mass[body], model.body_inertia[body]
        if mass < mujoco.mjMINVAL:
            continue
        box = np.sqrt(np.maximum(mujoco.mjMINVAL, inertia.sum() - 2 * inertia) / mass * 6)
        diameter = box.mean()
        viscous[body] = math.pi * viscosity * diameter * np.repeat([diameter**2, 3.0], 3)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            quadratic[body, i] = density * box[i] * (box[j] ** 4 + box[k] ** 4) / 32
            quadratic[body, 3 + i] = density * box[j] * box[k]
    return viscous, quadratic


@njit(**OPTIONS)
def solve(im: Implicit, x: Array) -> None:
    """x (nv,) := A^-1 x, of the step that MuJoCo has taken last."""
    for i in range(x.size - 1, -1, -1):
        for j in range(im.row_start[i], im.row_start[i] + im.row_size[i] - 1):
            x[im.column[j]] -= im.factor[j] * x[i]
    for i in range(x.size):
        x[i] *= im.inverse_diagonal[i]
        for j in range(im.row_start[i], im.row_start[i] + im.row_size[i] - 1):
            x[i] -= im.factor[j] * x[im.column[j]]


@njit(**OPTIONS)
def _local(im: Implicit, body: int, spatial: Array, axis: int) -> float:
    """Component ``axis`` of a body's velocity (turning, then moving) in its own frame, from that about the centre."""
    i = axis % 3
    x, y, z = im.frame[body, i], im.frame[body, 3 + i], im.frame[body, 6 + i]
    if axis < 3:
        return x * spatial[body, 0] + y * spatial[body, 1] + z * spatial[body, 2]
    root = im.root[body]
    dx = im.position[body, 0] - im.centre[root, 0]
    dy = im.position[body, 1] - im.centre[root, 1]
    dz = im.position[body, 2] - im.centre[root, 2]
    wx, wy, wz = spatial[body, 0], spatial[body, 1], spatial[body, 2]
    return (
        x * (spatial[body, 3] + wy * dz - wz * dy)
        + y * (spatial[body, 4] + wz * dx - wx * dz)
        + z * (spatial[body, 5] + wx * dy - wy * dx)
    )


@njit(**OPTIONS)
def bilinear(im: Implicit, h: float, mu: Array, a: Array) -> float:
    """mu . A a at the state of mjData, but for the part of A that is the same at all states."""
    total = 0.0
    for i in range(mu.size):
        last = im.row_start[i] + im.row_size[i] - 1
        for j in range(im.row_start[i], last):
            k = im.column[j]
            total += im.mass[j] * (mu[i] * a[k] + mu[k] * a[i])
        total += im.mass[last] * mu[i] * a[i]
    for body in range(1, im.parent.size):
        up = im.parent[body]
        for c in range(6):
            im.of_mu[body, c], im.of_a[body, c] = im.of_mu[up, c], im.of_a[up, c]
        for i in range(im.first_dof[body], im.first_dof[body] + im.dofs[body]):
            for c in range(6):
                im.of_mu[body, c] += im.motion[i, c] * mu[i]
                im.of_a[body, c] += im.motion[i, c] * a[i]
        for axis in range(6):
            viscous, quadratic = im.viscous[body, axis], im.quadratic[body, axis]
            if viscous == 0 and quadratic == 0:
                continue
            speed = _local(im, body, im.velocity, axis)
            if axis >= 3:
                for c in range(3):
                    speed -= im.frame[body, 3 * c + axis - 3] * im.wind[c]
            drag = viscous + quadratic * abs(speed)
            total += h * drag * _local(im, body, im.of_mu, axis) * _local(im, body, im.of_a, axis)
    return total
