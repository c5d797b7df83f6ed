"""The state of a chain, what its numbers mean, and the points and velocities that follow from them.

The full state is that of A.1, shape (..., 2n + 4)::

    x = [A0x, A0y, theta_1 .. theta_n, dA0x, dA0y, dtheta_1 .. dtheta_n]

with A0 the free end of the first link (m) and theta_i the angle of link i from the x axis (rad). Where the
swimmer is does not matter to how it swims, so learners use the reduced state, shape (..., 2n + 2)::

    z = [theta_1 .. theta_n, dtheta_1 .. dtheta_n, dGx, dGy]

with dG the velocity of the centre of mass (m/s): 12 numbers for 5 links, the paper's "12 state variables".
Everything here is kinematics; no force appears.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj.parameters import SwimmerParameters

__all__ = [
    "FullState",
    "ReducedState",
    "center_of_mass",
    "center_of_mass_levers",
    "expand",
    "full_size",
    "join",
    "join_reduced",
    "joint_positions",
    "link_centers",
    "link_directions",
    "link_normals",
    "reduce",
    "reduce_derivative",
    "reduced_size",
    "rotate",
    "split",
    "split_reduced",
    "torques",
]

Array = NDArray[np.float64]


class FullState(NamedTuple):
    """The parts of a full state (or of its time derivative)."""

    position: Array
    """A0, shape (..., 2), m."""
    angles: Array
    """theta, shape (..., n), rad, from the x axis."""
    velocity: Array
    """dA0/dt, shape (..., 2), m/s."""
    angular_velocities: Array
    """dtheta/dt, shape (..., n), rad/s."""


class ReducedState(NamedTuple):
    """The parts of a reduced state (or of its time derivative)."""

    angles: Array
    """theta, shape (..., n), rad, from the x axis."""
    angular_velocities: Array
    """dtheta/dt, shape (..., n), rad/s."""
    velocity: Array
    """dG/dt, velocity of the centre of mass, shape (..., 2), m/s."""


def full_size(n_links: int) -> int:
    """Number of full state variables, 2n + 4."""
    return 2 * n_links + 4


def reduced_size(n_links: int) -> int:
    """Number of reduced state variables, 2n + 2."""
    return 2 * n_links + 2


def _checked(x: ArrayLike, size: int, what: str) -> Array:
    x = np.asarray(x, dtype=np.float64)
    if x.ndim == 0 or x.shape[-1] != size:
        raise ValueError(f"{what} must have {size} values on the last axis, got shape {x.shape}")
    return x


def split(x: ArrayLike, n_links: int) -> FullState:
    """The parts of the full state ``x``, as views."""
    x = _checked(x, full_size(n_links), f"the state of {n_links} links")
    n = n_links
    return FullState(x[..., :2], x[..., 2 : n + 2], x[..., n + 2 : n + 4], x[..., n + 4 :])


def join(position: ArrayLike, angles: ArrayLike, velocity: ArrayLike, angular_velocities: ArrayLike) -> Array:
    """A full state from its parts."""
    return np.concatenate([position, angles, velocity, angular_velocities], axis=-1, dtype=np.float64)


def split_reduced(z: ArrayLike, n_links: int) -> ReducedState:
    """The parts of the reduced state ``z``, as views."""
    z = _checked(z, reduced_size(n_links), f"the reduced state of {n_links} links")
    n = n_links
    return ReducedState(z[..., :n], z[..., n : 2 * n], z[..., 2 * n :])


def join_reduced(angles: ArrayLike, angular_velocities: ArrayLike, velocity: ArrayLike) -> Array:
    """A reduced state from its parts."""
    return np.concatenate([angles, angular_velocities, velocity], axis=-1, dtype=np.float64)


def torques(u: ArrayLike, n_links: int) -> Array:
    """``u`` as an array of torques, one per joint, shape (..., n - 1)."""
    return _checked(u, n_links - 1, f"the torques u of {n_links} links")


def link_directions(angles: Array) -> Array:
    """Unit vectors t_i along the links, from A_{i-1} to A_i, shape (..., n, 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def link_normals(angles: Array) -> Array:
    """Unit vectors n_i across the links, t_i turned by +90 degrees, shape (..., n, 2)."""
    return np.stack([-np.sin(angles), np.cos(angles)], axis=-1)


def joint_positions(parameters: SwimmerParameters, x: ArrayLike) -> Array:
    """A_0 .. A_n, the ends of the links, shape (..., n + 1, 2), m."""
    state = split(x, parameters.n_links)
    links = parameters.lengths[:, None] * link_directions(state.angles)
    ends = state.position[..., None, :] + np.cumsum(links, axis=-2)
    return np.concatenate([state.position[..., None, :], ends], axis=-2)


def link_centers(parameters: SwimmerParameters, x: ArrayLike) -> Array:
    """G_i = (A_{i-1} + A_i) / 2, shape (..., n, 2), m."""
    ends = joint_positions(parameters, x)
    return (ends[..., :-1, :] + ends[..., 1:, :]) / 2


def center_of_mass(parameters: SwimmerParameters, x: ArrayLike) -> Array:
    """G, shape (..., 2), m."""
    masses = parameters.masses
    return np.einsum("i,...ix->...x", masses, link_centers(parameters, x)) / masses.sum()


def center_of_mass_levers(parameters: SwimmerParameters) -> Array:
    """a_j with G = A0 + sum_j a_j t_j, shape (n,), m: the mass beyond the middle of link j, times l_j / M."""
    masses = parameters.masses
    beyond = masses.sum() - np.cumsum(masses) + masses / 2
    return parameters.lengths * beyond / masses.sum()


def reduce(parameters: SwimmerParameters, x: ArrayLike) -> Array:
    """The reduced state of the full state ``x``, shape (..., 2n + 2)."""
    state = split(x, parameters.n_links)
    levers = center_of_mass_levers(parameters)
    rates = (levers * state.angular_velocities)[..., None] * link_normals(state.angles)
    return join_reduced(state.angles, state.angular_velocities, state.velocity + rates.sum(axis=-2))


def expand(parameters: SwimmerParameters, z: ArrayLike) -> Array:
    """The full state with reduced state ``z`` and the centre of mass at the origin, shape (..., 2n + 4)."""
    state = split_reduced(z, parameters.n_links)
    levers = center_of_mass_levers(parameters)
    offset = (levers[:, None] * link_directions(state.angles)).sum(axis=-2)
    rates = (levers * state.angular_velocities)[..., None] * link_normals(state.angles)
    return join(-offset, state.angles, state.velocity - rates.sum(axis=-2), state.angular_velocities)


def reduce_derivative(parameters: SwimmerParameters, x: ArrayLike, dx: ArrayLike) -> Array:
    """d(reduce(x))/dt for dx/dt = ``dx``, shape (..., 2n + 2).

    Accepts further leading axes on ``dx`` as long as they broadcast against ``x``.
    """
    state, rate = split(x, parameters.n_links), split(dx, parameters.n_links)
    levers = center_of_mass_levers(parameters)
    tangential = (levers * rate.angular_velocities)[..., None] * link_normals(state.angles)
    centripetal = (levers * state.angular_velocities * rate.angles)[..., None] * link_directions(state.angles)
    acceleration = rate.velocity + (tangential - centripetal).sum(axis=-2)
    return join_reduced(rate.angles, rate.angular_velocities, acceleration)


def rotate(vectors: ArrayLike, angle: ArrayLike) -> Array:
    """``vectors`` (..., 2) turned by ``angle`` (..., rad) about the origin."""
    vectors, angle = np.asarray(vectors, dtype=np.float64), np.asarray(angle, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)
