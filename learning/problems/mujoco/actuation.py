"""What controls do in a MuJoCo model, as far as the forces are affine in them."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from swimmer_mj.learning.problems.mujoco.kernel import Actuation

__all__ = ["actuation", "actuator_name"]


def actuator_name(model: Any, k: int) -> str:
    """Its name, or its number."""
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k) or f"actuator {k}"


def actuation(model: Any, control_limits: Sequence[float] | None = None) -> Actuation:
    """The controls of ``model``; ValueError names an actuator whose force is not affine in its control.

    ``control_limits`` are for actuators without a ctrlrange, or to be narrower than it; one for each control.
    """
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        raise ValueError('the model has <flag actuation="disable"/>: there is nothing to control')
    controls = [k for k in range(model.nu) if np.any(model.actuator_gainprm[k]) and not _disabled(model, k)]
    q = len(controls)
    if q == 0:
        raise ValueError("the model has no actuator with a gain: there is nothing to control")
    if control_limits is not None and (np.ndim(control_limits) != 1 or len(control_limits) != q):
        count = len(control_limits) if np.ndim(control_limits) == 1 else repr(control_limits)
        raise ValueError(f"control_limits must be one for each of {q} controls, got {count}")
    for k in range(model.nu):
        if not _disabled(model, k) and (obstacle := _obstacle(model, k)):
            raise ValueError(
                f"{actuator_name(model, k)!r} {obstacle}: its force is not affine in ctrl; leave that out, or take a "
                "motor, position, velocity or general actuator without it"
            )
    for j in range(model.njnt):
        if model.jnt_actfrclimited[j]:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j)
            raise ValueError(f"joint {name!r} has an actuatorfrcrange: the force on it is not affine in ctrl")
    for k in range(model.ntendon):
        if model.tendon_actfrclimited[k]:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, k)
            raise ValueError(
                f"tendon {name!r} has an actuatorfrcrange: the force on it is not affine in ctrl"
            )
    bounds = [None] * q if control_limits is None else control_limits
    ranges = np.array([_range(model, k, bound) for k, bound in zip(controls, bounds, strict=True)])
    affine = model.actuator_gaintype[controls] == int(mujoco.mjtGain.mjGAIN_AFFINE)
    gain = model.actuator_gainprm[controls, :3] * np.where(affine[:, None], 1.0, [[1.0, 0.0, 0.0]])
    kind = model.actuator_dyntype[controls]
    tau = np.maximum(model.actuator_dynprm[controls, 0], 1e-15)
    return Actuation(
        np.array(controls, dtype=np.int64),
        ranges.mean(axis=1),
        np.diff(ranges, axis=1)[:, 0] / 2,
        np.ascontiguousarray(gain),
        np.where(kind == int(mujoco.mjtDyn.mjDYN_NONE), -1, model.actuator_actadr[controls]).astype(np.int64),
        np.where(kind == int(mujoco.mjtDyn.mjDYN_INTEGRATOR), 1.0, 1 / tau),
    )


def _disabled(model: Any, k: int) -> bool:
    """Whether actuator ``k`` is of a group that the model's options turn off."""
    return bool(model.opt.disableactuator >> int(model.actuator_group[k]) & 1)


def _obstacle(model: Any, k: int) -> str | None:
    """Why the force of actuator ``k`` is not affine in its control; None if it is."""
    dyn, gain, bias = mujoco.mjtDyn, mujoco.mjtGain, mujoco.mjtBias
    of_dyn, of_gain, of_bias = (
        kind(int(values[k]))
        for kind, values in (
            (dyn, model.actuator_dyntype),
            (gain, model.actuator_gaintype),
            (bias, model.actuator_biastype),
        )
    )
    if of_gain not in (gain.mjGAIN_FIXED, gain.mjGAIN_AFFINE):
        return f"has a gain of type {of_gain.name}"
    if of_bias not in (bias.mjBIAS_NONE, bias.mjBIAS_AFFINE):
        return f"has a bias of type {of_bias.name}"
    if of_dyn not in (dyn.mjDYN_NONE, dyn.mjDYN_INTEGRATOR, dyn.mjDYN_FILTER, dyn.mjDYN_FILTEREXACT):
        return f"has an activation of type {of_dyn.name}"
    if model.actuator_actlimited[k]:  # an activation at its end does not follow ctrl
        return "has an actrange"
    if model.actuator_forcelimited[k]:
        return "has a forcerange"
    if model.actuator_delay[k] > 0 or np.any(model.actuator_history[k]):
        return "acts late (delay)"
    return "acts early (actearly)" if model.actuator_actearly[k] else None


def _range(model: Any, k: int, bound: float | None) -> tuple[float, float]:
    """The range of ctrl of actuator ``k``."""
    limited = bool(model.actuator_ctrllimited[k])
    low, high = model.actuator_ctrlrange[k] if limited else (-np.inf, np.inf)
    if bound is not None:
        if not (np.isfinite(bound) and bound > 0):
            raise ValueError(f"control_limits must be positive and finite, got {bound!r}")
        if limited and not max(low, -bound) < min(high, bound):
            raise ValueError(
                f"control_limits {bound:g} leaves nothing of the ctrlrange of {actuator_name(model, k)!r}, "
                f"{low:g} to {high:g}: leave it out"
            )
        low, high = max(low, -bound), min(high, bound)
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ValueError(f"{actuator_name(model, k)!r} has no ctrlrange: give control_limits, one a control")
    return float(low), float(high)
