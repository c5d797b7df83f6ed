"""A swimmer that is moved, turned, mirrored, or described from its other end."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation.agreement import scales
from swimmer_mj.validation.cases import (
    ARBITER,
    random_parameters,
    random_states,
    random_torques,
    statements,
)
from swimmer_mj.validation.records import Section, Worst

__all__ = ["symmetries", "symmetry_errors"]

Array = NDArray[np.float64]


def _turn(x: Array, n: int, angle: float) -> Array:
    """A state, or its derivative (angle rates do not turn), turned by ``angle`` about the origin."""
    s = st.split(x, n)
    return st.join(st.rotate(s.position, angle), s.angles, st.rotate(s.velocity, angle), s.angular_velocities)


def _from_the_other_end(parameters: SwimmerParameters, x: Array, dx: Array) -> tuple[Array, Array]:
    """The state and its derivative with the links counted from A_n."""
    s, rate = st.split(x, parameters.n_links), st.split(dx, parameters.n_links)
    l = parameters.lengths[:, None]
    t, normal = st.link_directions(s.angles), st.link_normals(s.angles)
    w, dw = s.angular_velocities[..., None], rate.angular_velocities[..., None]
    end = s.position + (l * t).sum(-2)
    end_velocity = s.velocity + (l * w * normal).sum(-2)
    end_acceleration = rate.velocity + (l * dw * normal - l * w**2 * t).sum(-2)
    state = st.join(end, s.angles[..., ::-1] + np.pi, end_velocity, s.angular_velocities[..., ::-1])
    return state, st.join(
        end_velocity, rate.angles[..., ::-1], end_acceleration, rate.angular_velocities[..., ::-1]
    )


def symmetry_errors(
    parameters: SwimmerParameters, x: Array, u: Array, shift: Array, angle: float
) -> tuple[dict[str, dict[str, Array]], Array]:
    """f of the moved swimmer against f moved, by symmetry and statement, relative; and the tolerance, shape (b,).

    Symmetries: translation by ``shift`` (2,), rotation by ``angle``, reflection in the x axis, and counting
    the links from the other end. The tolerance is that of :func:`disagreement`, where the swimmer is farthest.
    """
    n = parameters.n_links
    swimmers = statements(parameters)
    moved = x.copy()
    st.split(moved, n).position[:] += shift
    turned = _turn(x, n, angle)
    st.split(turned, n).angles[:] += angle
    mirror = st.join([1, -1], np.full(n, -1), [1, -1], np.full(n, -1))
    backward = SwimmerParameters(
        n,
        parameters.masses[::-1].tolist(),
        parameters.lengths[::-1].tolist(),
        parameters.viscous_friction,
        parameters.torque_limits[::-1].tolist(),
    )
    backward_swimmers = statements(backward)
    scale, rounding = scales(swimmers[ARBITER], x, u)
    _, moved_rounding = scales(swimmers[ARBITER], moved, u)
    errors: dict[str, dict[str, Array]] = {}
    for name, swimmer in swimmers.items():
        f = swimmer.derivative(x, u)
        end, end_f = _from_the_other_end(parameters, x, f)
        for symmetry, found, expected in (
            ("translation", swimmer.derivative(moved, u), f),
            ("rotation", swimmer.derivative(turned, u), _turn(f, n, angle)),
            ("reflection", swimmer.derivative(mirror * x, -u), mirror * f),
            ("counting from the other end", backward_swimmers[name].derivative(end, -u[:, ::-1]), end_f),
        ):
            errors.setdefault(symmetry, {})[name] = np.linalg.norm(found - expected, axis=-1) / scale
    return errors, 2 * np.maximum(rounding, moved_rounding)


def symmetries(rng: np.random.Generator, links: Iterable[int] = (1, 2, 3, 5), n_states: int = 10) -> Section:
    """Check that a moved, turned, mirrored swimmer, or one described from its other end, moves as it did."""
    worst: dict[str, Worst] = {}
    for n in links:
        parameters = random_parameters(rng, n)
        x, u = random_states(rng, n, n_states), random_torques(rng, parameters, n_states)
        errors, tolerance = symmetry_errors(parameters, x, u, rng.uniform(-5, 5, 2), rng.uniform(-3, 3))
        for symmetry, by_name in errors.items():
            check = worst.setdefault(
                symmetry, Worst(symmetry, "2 N eps c (1 + s): two solutions of the equations of motion")
            )
            for name, error in by_name.items():
                for e, t in zip(error, tolerance, strict=True):
                    check.add(e, t, f"{name}, {n} links")
    return Section("Symmetries", [w.check() for w in worst.values()])
