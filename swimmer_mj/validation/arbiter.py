"""An arbiter over the statements of the physics: Lagrange's equations by automatic differentiation.

It shares nothing with them but the parameters and the order of the state's numbers (A.1). All it is told is where
the points of the chain are, r = A_{i-1} + lambda t_i, and what happens at a point: it has mass m_i dlambda / l_i
and feels dF = -k (v . n) n dlambda (the first sentence of A.2). The rest it works out:

- sums over the points are Gauss-Legendre quadratures along the links;
- velocities of points come from a complex step: v = Im r(q + i h q') / h, with h too small to round;
- T(q, q'), the sum of m v^2 / 2, carries its first and second derivatives along (:class:`Jet`), and there is no
  potential: d/dt (dT/dq') - dT/dq = Q;
- Q is the virtual work of the friction and of the torques: dr/dq . dF, and u_i on theta_{i+1} - theta_i.

So no moment of inertia, no l^3 / 12, no centripetal term and no force between links is written down here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj.parameters import PAPER, SwimmerParameters

__all__ = ["Jet", "LagrangianSwimmer", "Motion"]

Array = NDArray[np.float64]

_STEP = 1e-30  # h: h^2 vanishes beside 1, and h^2 times a length is no denormal number
_NODES = 3  # a link; 2 integrate what is quadratic along a link exactly


@dataclass(frozen=True)
class Jet:
    """Numbers (...) with their first (..., N) and second (..., N, N) derivatives by N variables."""

    value: NDArray[Any]
    gradient: NDArray[Any]
    hessian: NDArray[Any]

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)

    def __mul__(self, constants: Array) -> Jet:
        """Product with constants that broadcast against the numbers."""
        a = np.asarray(constants)
        return Jet(self.value * a, self.gradient * a[..., None], self.hessian * a[..., None, None])

    def function(self, f: NDArray[Any], df: NDArray[Any], ddf: NDArray[Any]) -> Jet:
        """A function of the numbers, whose values and two derivatives are given: the chain rule."""
        g = self.gradient
        return Jet(
            f,
            df[..., None] * g,
            df[..., None, None] * self.hessian + ddf[..., None, None] * g[..., :, None] * g[..., None, :],
        )

    def cos(self) -> Jet:
        """Cosine."""
        c, s = np.cos(self.value), np.sin(self.value)
        return self.function(c, -s, -c)

    def sin(self) -> Jet:
        """Sine."""
        c, s = np.cos(self.value), np.sin(self.value)
        return self.function(s, c, -s)

    def square(self) -> Jet:
        """Square."""
        return self.function(self.value**2, 2 * self.value, np.full_like(self.value, 2))

    def map(self, f: Any) -> Jet:
        """A linear function, applied to the numbers and their derivatives alike."""
        return Jet(f(self.value), f(self.gradient), f(self.hessian))


class Motion(NamedTuple):
    """What a motion amounts to, and how fast it changes along a given dx/dt.

    The size of a rate is the sum of the absolute values of the terms that the rate is the sum of, with the
    accelerations no smaller than what rounding acts on: what its rounding error is proportional to.
    """

    energy: Array
    """Kinetic energy, shape (...), J."""
    momentum: Array
    """Linear momentum, shape (..., 2), kg·m/s."""
    angular_momentum: Array
    """About the origin, shape (...), kg·m²/s."""
    energy_rate: Array
    """d(energy)/dt, W."""
    energy_rate_size: Array
    momentum_rate: Array
    """d(momentum)/dt, N."""
    momentum_rate_size: Array
    angular_momentum_rate: Array
    """d(angular_momentum)/dt, N·m."""
    angular_momentum_rate_size: Array
    friction_power: Array
    """Of A.2's forces on all points, never positive, W."""
    torque_power: Array
    """Of the torques, W."""


class LagrangianSwimmer:
    """dx/dt = f(x, u) for the state x and the torques u of A.1; everything accepts leading batch axes.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer; the paper's 5 links by default.
    """

    def __init__(self, parameters: SwimmerParameters = PAPER) -> None:
        self.parameters = parameters
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        l = parameters.lengths[:, None]
        self._lambda = l * (nodes + 1) / 2  # shape (n, nodes), from A_{i-1}
        self._dlambda = l * weights / 2
        self._masses = parameters.masses[:, None] * weights / 2

    def _points(self, x: Array) -> tuple[list[Jet], list[Jet]]:
        """r and v of the points, each x and y of shape (..., n, nodes), by q and q'."""
        n, size = self.parameters.n_links, x.shape[-1]
        q, q_dot = x[..., : n + 2], x[..., n + 2 :]
        along = np.eye(n + 2, size) + 1j * _STEP * np.eye(n + 2, size, n + 2)  # d(q + i h q')/d(q, q')
        gradient = np.broadcast_to(along, (*q.shape, size))
        hessian = np.zeros((*q.shape, size, size), dtype=np.complex128)
        moving = Jet(q + 1j * _STEP * q_dot, gradient, hessian)

        axis = x.ndim - 1
        A0 = [moving.map(lambda a, c=c: np.take(a, [c], axis)) for c in (0, 1)]
        theta = moving.map(lambda a: np.take(a, range(2, n + 2), axis))
        r = []
        for start, t in zip(A0, (theta.cos(), theta.sin()), strict=True):
            links = t * self.parameters.lengths
            before = links.map(lambda a: np.cumsum(a, axis) - a) + start  # A_{i-1}
            points = [(t * self._lambda[:, p]) + before for p in range(_NODES)]
            r.append(Jet(*(np.stack(parts, axis + 1) for parts in zip(*map(_parts, points), strict=True))))
        return [c.map(np.real) for c in r], [c.map(lambda a: a.imag / _STEP) for c in r]

    def _friction(self, r: list[Jet], v: list[Jet]) -> list[Array]:
        """A.2's force on each point, its x and y, shape (..., n, nodes)."""
        t = [(c.value[..., -1:] - c.value[..., :1]) / np.ptp(self._lambda, axis=1)[:, None] for c in r]
        normal = [-t[1], t[0]]
        v_n = v[0].value * normal[0] + v[1].value * normal[1]
        return [-self.parameters.viscous_friction * v_n * c * self._dlambda for c in normal]

    def _kinetic_energy(self, v: list[Jet]) -> Jet:
        by_point = (v[0].square() + v[1].square()) * (self._masses / 2)
        axes = (by_point.value.ndim - 2, by_point.value.ndim - 1)
        return by_point.map(lambda a: a.sum(axis=axes))

    def _system(self, x: Array) -> tuple[Array, Array, Array]:
        """M (..., n + 2, n + 2) and b (..., n + 2) with M q'' = b + T u, and the size of b's terms.

        T is :meth:`_torque_map`.
        """
        n = self.parameters.n_links
        r, v = self._points(x)
        kinetic = self._kinetic_energy(v)
        force = self._friction(r, v)
        by_q, by_q_dot = slice(None, n + 2), slice(n + 2, None)
        work = np.stack([F[..., None] * c.gradient[..., by_q] for F, c in zip(force, r, strict=True)])
        of_q = kinetic.gradient[..., by_q]
        mixed = (kinetic.hessian[..., by_q_dot, by_q] @ x[..., by_q_dot, None])[..., 0]
        b = work.sum((0, -3, -2)) + of_q - mixed
        size = np.abs(work).sum((0, -3, -2)) + np.abs(of_q) + np.abs(mixed)
        return kinetic.hessian[..., by_q_dot, by_q_dot], b, size

    def _torque_map(self) -> Array:
        """T (n + 2, n - 1) = d(theta_{i+1} - theta_i)/dq, transposed."""
        n = self.parameters.n_links
        by_angle = np.diff(np.eye(n), axis=0)
        return np.concatenate([np.zeros((n - 1, 2)), by_angle], axis=1).T

    def conditioning(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """How rounding in the equations of motion comes to show in the accelerations.

        Returns
        -------
        condition : ndarray, shape (...)
            The condition number of the mass matrix M, for joint angles in place of the links' angles, as MuJoCo
            solves: the larger of the two. Times 1 + |A0| / the shortest l_i, because levers are differences of
            positions.
        size : ndarray, shape (...)
            An acceleration: the sum of what rounding acts on even where it cancels. These are the terms of the
            right-hand side over |M|; and, from velocities as vectors, of which v . n is a difference, k l_i v / m_i
            and v times the largest angular velocity, with v the largest velocity that a point can have.
        """
        x, u = np.asarray(x, dtype=np.float64), np.asarray(u, dtype=np.float64)
        p = self.parameters
        n = p.n_links
        M, _, terms = self._system(x)
        S = np.eye(n + 2)  # q of MuJoCo's coordinates
        S[2:, 2:] = np.tri(n)
        condition = np.asarray(np.linalg.cond(S.T @ M @ S), dtype=np.float64)
        condition *= 1 + np.linalg.norm(x[..., :2], axis=-1) / p.lengths.min()
        right_hand_side = terms + np.abs(u) @ np.abs(self._torque_map()).T
        size = np.linalg.norm(right_hand_side, axis=-1) / np.linalg.norm(M, 2, axis=(-2, -1))
        spins = np.abs(x[..., n + 4 :])
        v = np.linalg.norm(x[..., n + 2 : n + 4], axis=-1) + spins @ p.lengths
        size += v * ((p.viscous_friction * p.lengths / p.masses).max() + spins.max(-1))
        return condition, size

    def derivative(self, x: ArrayLike, u: ArrayLike) -> Array:
        """f(x, u), shape (..., 2n + 4)."""
        x, u = np.asarray(x, dtype=np.float64), np.asarray(u, dtype=np.float64)
        drift, B = self.drift_and_control_matrix(x)
        return drift + (B @ u[..., None])[..., 0]

    def drift(self, x: ArrayLike) -> Array:
        """a(x) = f(x, 0), shape (..., 2n + 4)."""
        return self.drift_and_control_matrix(x)[0]

    def control_matrix(self, x: ArrayLike) -> Array:
        """B(x) = df/du, shape (..., 2n + 4, n - 1)."""
        return self.drift_and_control_matrix(x)[1]

    def drift_and_control_matrix(self, x: ArrayLike) -> tuple[Array, Array]:
        """a(x), shape (..., 2n + 4), and B(x), shape (..., 2n + 4, n - 1)."""
        x = np.asarray(x, dtype=np.float64)
        n = self.parameters.n_links
        M, b, _ = self._system(x)
        T = np.broadcast_to(self._torque_map(), (*b.shape, n - 1))
        q = np.asarray(np.linalg.solve(M, np.concatenate([b[..., None], T], axis=-1)), dtype=np.float64)
        drift = np.concatenate([x[..., n + 2 :], q[..., 0]], axis=-1)
        return drift, np.concatenate([np.zeros_like(q[..., 1:]), q[..., 1:]], axis=-2)

    def motion(self, x: ArrayLike, dx: ArrayLike, u: ArrayLike, size: ArrayLike = 0.0) -> Motion:
        """Energy, momenta and powers at x (..., 2n + 4) under torques u (..., n - 1), and their rates along dx.

        ``size`` (...) is that of :meth:`conditioning`, for the sizes of the rates.
        """
        x, dx, u, size = (np.asarray(a, dtype=np.float64) for a in (x, dx, u, size))
        n = self.parameters.n_links
        reach = np.abs(dx)
        reach[..., n + 2 :] += size[..., None]
        r, v = self._points(x)
        energy = self._kinetic_energy(v)
        m, points = self._masses, (-2, -1)

        momentum_rates = np.stack([m[..., None] * c.gradient * dx[..., None, None, :] for c in v], -1)
        momentum_sizes = [m[..., None] * np.abs(c.gradient) * reach[..., None, None, :] for c in v]
        # L = sum of m (x v_y - y v_x)
        products = ((r[0], v[1], 1.0), (r[1], v[0], -1.0))
        angular, angular_rate, angular_size = (np.zeros(x.shape[:-1]) for _ in range(3))
        for a, b, sign in products:
            angular += (sign * m * a.value * b.value).sum(points)
            for value, gradient in ((a.value, b.gradient), (b.value, a.gradient)):
                along = (gradient * dx[..., None, None, :]).sum(-1)
                angular_rate += (sign * m * value * along).sum(points)
                along = (np.abs(gradient) * reach[..., None, None, :]).sum(-1)
                angular_size += (m * np.abs(value) * along).sum(points)
        Fx, Fy = self._friction(r, v)
        return Motion(
            energy=energy.value,
            momentum=np.stack([(m * c.value).sum(points) for c in v], -1),
            angular_momentum=angular,
            energy_rate=(energy.gradient * dx).sum(-1),
            energy_rate_size=(np.abs(energy.gradient) * reach).sum(-1),
            momentum_rate=momentum_rates.sum((-4, -3, -2)),
            momentum_rate_size=sum((s.sum((-3, -2, -1)) for s in momentum_sizes), np.zeros(x.shape[:-1])),
            angular_momentum_rate=angular_rate,
            angular_momentum_rate_size=angular_size,
            friction_power=(Fx * v[0].value + Fy * v[1].value).sum(points),
            torque_power=(u * np.diff(x[..., n + 4 :], axis=-1)).sum(-1),
        )


def _parts(jet: Jet) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    return jet.value, jet.gradient, jet.hessian
