"""The viscous friction of A.2 as a passive force of MuJoCo, compiled.

    with viscous_friction():
        mujoco.mj_step(model, data)

Inside the scope, every model that declares the friction (:mod:`swimmer_mj.mjcf`) feels it in each
evaluation of its forces: ``mj_step``, ``mj_forward``, ``mj_inverse``, ``mujoco.rollout``, ``mujoco.batch``,
from any number of threads and without the GIL. No other model feels anything. After the last scope,
MuJoCo's callback is what it was before. :mod:`swimmer_mj.passive` has all that; the friction is one of its laws.

A rod of length l with unit vector t along it, velocity v of its centre and angular velocity w feels, as the
integral of A.2's dF = -k (v . n) n dlambda over its length,

    F = -k l (v - (v . t) t)                at its centre
    M = -k l^3 / 12 (w - (w . t) t)

which in the plane is F_i = -k l_i (G'_i . n_i) n_i and M_i = -k theta'_i l_i^3 / 12. MuJoCo calls no passive
callback on a model that disables both its springs and its dampers.
"""

from __future__ import annotations

import weakref
from contextlib import AbstractContextManager

from swimmer_mj.mjcf import FRICTION_TUPLE
from swimmer_mj.passive import Site, Vector, law

__all__ = ["acquire", "friction", "hold", "release", "viscous_friction"]


@law(FRICTION_TUPLE, shape="capsule")
def friction(site: Site, k: float) -> tuple[Vector, Vector]:
    """F (N) and M (N·m) of a rod along a capsule site; k in N·s/m²."""
    l = 2 * site.size[1]
    tx, ty, tz = site.axes[2]
    vx, vy, vz = site.velocity
    wx, wy, wz = site.angular_velocity
    along = vx * tx + vy * ty + vz * tz
    about = wx * tx + wy * ty + wz * tz
    drag = -k * l
    spin = -k * l**3 / 12
    F = drag * (vx - along * tx), drag * (vy - along * ty), drag * (vz - along * tz)
    M = spin * (wx - about * tx), spin * (wy - about * ty), spin * (wz - about * tz)
    return F, M


def acquire() -> None:
    """Put the friction in force until :func:`release`; see :meth:`swimmer_mj.passive.Law.acquire`."""
    friction.acquire()


def release() -> None:
    """Undo one :func:`acquire`; the last one restores the callback that was found at the first."""
    friction.release()


def viscous_friction() -> AbstractContextManager[None]:
    """The friction in force inside a ``with`` block, also when it is left by an exception."""
    return friction.in_force()


def hold(owner: object) -> weakref.finalize:
    """Keep the friction in force while ``owner`` lives.

    Returns
    -------
    weakref.finalize
        Call it to release sooner; further calls do nothing.
    """
    return friction.hold(owner)
