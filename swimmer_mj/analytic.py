"""The swimmer's equations of motion, as appendix A.3 of Coulom (2002) states them.

To be read beside the paper. Two slips of its print, which unit masses and lengths hide, are corrected
(docs/errata.md): the rotational inertia of a rod is m_i l_i^2 / 12, and the force balance reads
f_i = f_{i-1} - F_i + m_i G''_i.

The unknowns are the accelerations q = (A0'', theta''_1 .. theta''_n). Every vector of A.3 is affine in them:

    v = C q + c        kept as one array [C | c] of shape (..., 2, n + 3)

so that the paper's recursions are written down as they stand, and its n + 2 equations are read off at the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.parameters import PAPER, SwimmerParameters

__all__ = ["AnalyticSwimmer", "friction_forces", "friction_moments"]

Array = NDArray[np.float64]


def friction_forces(k: float, lengths: Array, center_velocities: Array, normals: Array) -> Array:
    """F_i = -k l_i (G'_i . n_i) n_i, the viscous force on each link (A.2), shape (..., n, 2), N."""
    normal_velocities = (center_velocities * normals).sum(axis=-1)
    return (-k * lengths * normal_velocities)[..., None] * normals


def friction_moments(k: float, lengths: Array, angular_velocities: Array) -> Array:
    """M_i = -k theta'_i l_i^3 / 12, the viscous moment on each link about G_i (A.2), shape (..., n), N·m."""
    return -k * angular_velocities * lengths**3 / 12


def _det(a: Array, b: Array) -> Array:
    """det(a, b) = a_x b_y - a_y b_x for a of shape (..., 2) and b of shape (..., 2, m); shape (..., m)."""
    return a[..., 0, None] * b[..., 1, :] - a[..., 1, None] * b[..., 0, :]


def _solve(A: Array, b: Array) -> Array:
    """The solution of A q = b, typed as the float64 that it is."""
    return np.asarray(np.linalg.solve(A, b), dtype=np.float64)


class AnalyticSwimmer:
    """dx/dt = f(x, u) for the state x and the torques u of A.1, by the linear system of A.3.

    Everything accepts leading batch axes. u_i acts as +u_i on link i + 1 and as -u_i on link i.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer; the paper's 5 links by default.
    """

    def __init__(self, parameters: SwimmerParameters = PAPER) -> None:
        self.parameters = parameters

    def _system(self, x: Array) -> tuple[Array, Array]:
        """A (..., n + 2, n + 2) and b (..., n + 2) with A q = b + T u; T is :meth:`_torque_map`."""
        p = self.parameters
        n, m, l, k = p.n_links, p.masses, p.lengths, p.viscous_friction
        _, theta, A0_dot, theta_dot = st.split(x, n)
        t, normal = st.link_directions(theta), st.link_normals(theta)

        link_velocities = (l * theta_dot)[..., None] * normal  # A'_i - A'_{i-1}
        G_dot = A0_dot[..., None, :] + np.cumsum(link_velocities, axis=-2) - link_velocities / 2
        F = friction_forces(k, l, G_dot, normal)
        M = friction_moments(k, l, theta_dot)

        A_ddot = np.zeros((*x.shape[:-1], 2, n + 3))  # A''_0, then A''_1 and so on
        A_ddot[..., 0, 0] = A_ddot[..., 1, 1] = 1.0
        f_before = np.zeros_like(A_ddot)  # f_0 = 0
        equations = np.zeros((*x.shape[:-1], n + 2, n + 3))
        for i in range(n):
            half_link_ddot = np.zeros_like(A_ddot)  # G''_i - A''_{i-1} = A''_i - G''_i
            half_link_ddot[..., 2 + i] = l[i] / 2 * normal[..., i, :]
            half_link_ddot[..., -1] = -l[i] / 2 * theta_dot[..., i, None] ** 2 * t[..., i, :]
            G_ddot = A_ddot + half_link_ddot
            A_ddot = G_ddot + half_link_ddot

            f = f_before + m[i] * G_ddot  # f_i = f_{i-1} - F_i + m_i G''_i
            f[..., -1] -= F[..., i, :]

            # 0 = det(G_i A_i, f_i + f_{i-1}) + M_i - m_i l_i^2 / 12 theta''_i   (- u_i + u_{i-1})
            equations[..., 2 + i, :] = _det(l[i] / 2 * t[..., i, :], f + f_before)
            equations[..., 2 + i, -1] += M[..., i]
            equations[..., 2 + i, 2 + i] -= m[i] * l[i] ** 2 / 12
            f_before = f
        equations[..., :2, :] = f_before  # f_n = 0
        return equations[..., :-1], -equations[..., -1]

    def _torque_map(self) -> Array:
        """T (n + 2, n - 1): how the torques enter the right-hand sides, +u_i - u_{i-1} in row i of A.3."""
        n = self.parameters.n_links
        T = np.zeros((n + 2, n - 1))
        joints = np.arange(n - 1)
        T[2 + joints, joints] = 1.0
        T[3 + joints, joints] = -1.0
        return T

    def derivative(self, x: ArrayLike, u: ArrayLike) -> Array:
        """f(x, u), the time derivative of the state.

        Parameters
        ----------
        x : array_like, shape (..., 2n + 4)
            State (see :mod:`swimmer_mj.state`).
        u : array_like, shape (..., n - 1)
            Torques, N·m.

        Returns
        -------
        ndarray, shape (..., 2n + 4)
        """
        n = self.parameters.n_links
        u = st.torques(u, n)
        x = np.asarray(x, dtype=np.float64)
        A, b = self._system(x)
        q = _solve(A, (b + u @ self._torque_map().T)[..., None])[..., 0]
        state = st.split(np.broadcast_to(x, (*q.shape[:-1], x.shape[-1])), n)
        return np.concatenate([state.velocity, state.angular_velocities, q], axis=-1)

    def drift(self, x: ArrayLike) -> Array:
        """a(x) = f(x, 0), shape (..., 2n + 4)."""
        return self.derivative(x, np.zeros(self.parameters.n_links - 1))

    def control_matrix(self, x: ArrayLike) -> Array:
        """B(x) = df/du, exact because f is affine in u; shape (..., 2n + 4, n - 1)."""
        return self.drift_and_control_matrix(x)[1]

    def drift_and_control_matrix(self, x: ArrayLike) -> tuple[Array, Array]:
        """a(x), shape (..., 2n + 4), and B(x), shape (..., 2n + 4, n - 1), from one linear solve."""
        n = self.parameters.n_links
        x = np.asarray(x, dtype=np.float64)
        A, b = self._system(x)
        T = np.broadcast_to(self._torque_map(), (*b.shape, n - 1))
        q = _solve(A, np.concatenate([b[..., None], T], axis=-1))
        state = st.split(x, n)
        drift = np.concatenate([state.velocity, state.angular_velocities, q[..., 0]], axis=-1)
        return drift, np.concatenate([np.zeros_like(q[..., 1:]), q[..., 1:]], axis=-2)

    def euler_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the explicit Euler method, u held."""
        return euler_step(lambda y: self.derivative(y, u), np.asarray(x, dtype=np.float64), dt)

    def rk4_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the classical Runge-Kutta method, u held."""
        return rk4_step(lambda y: self.derivative(y, u), np.asarray(x, dtype=np.float64), dt)
