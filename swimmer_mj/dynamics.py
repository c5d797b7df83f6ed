"""The swimmer's dynamics as one interface, and MuJoCo behind it.

:class:`~swimmer_mj.analytic.AnalyticSwimmer` and :class:`MujocoSwimmer` share parameters and state vector and
no line of physics: what one of them gets wrong, the other shows.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.mjcf import Friction, mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = ["Dynamics", "MujocoSwimmer", "QposQvel", "from_qpos_qvel", "to_qpos_qvel"]

Array = NDArray[np.float64]


class Dynamics(Protocol):
    """dx/dt = a(x) + B(x) u of a swimmer, for full states x (:mod:`swimmer_mj.state`) and torques u, N·m.

    Every method accepts leading batch axes.
    """

    parameters: SwimmerParameters

    def derivative(self, x: ArrayLike, u: ArrayLike) -> Array:
        """f(x, u), shape (..., 2n + 4)."""
        ...

    def drift(self, x: ArrayLike) -> Array:
        """a(x) = f(x, 0), shape (..., 2n + 4)."""
        ...

    def control_matrix(self, x: ArrayLike) -> Array:
        """B(x) = df/du, shape (..., 2n + 4, n - 1)."""
        ...

    def drift_and_control_matrix(self, x: ArrayLike) -> tuple[Array, Array]:
        """a(x) and B(x) together."""
        ...

    def euler_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the explicit Euler method, u held."""
        ...

    def rk4_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the classical Runge-Kutta method, u held."""
        ...


class QposQvel(NamedTuple):
    """MuJoCo's coordinates of a swimmer."""

    qpos: Array
    """A0x, A0y (m), theta_1 and the joint angles theta_{i+1} - theta_i (rad), shape (..., n + 2)."""
    qvel: Array
    """The time derivative of qpos, shape (..., n + 2)."""


def _joint_angles(angles: Array) -> Array:
    """theta_1, theta_2 - theta_1, .. from theta_1, theta_2, .. along the last axis."""
    joint_angles = angles.copy()
    joint_angles[..., 1:] -= angles[..., :-1]
    return joint_angles


def to_qpos_qvel(x: ArrayLike, n_links: int) -> QposQvel:
    """MuJoCo's coordinates of the full state ``x``, shape (..., 2n + 4)."""
    state = st.split(x, n_links)
    return QposQvel(
        np.concatenate([state.position, _joint_angles(state.angles)], axis=-1),
        np.concatenate([state.velocity, _joint_angles(state.angular_velocities)], axis=-1),
    )


def from_qpos_qvel(qpos: ArrayLike, qvel: ArrayLike) -> Array:
    """The full state of MuJoCo's coordinates, shape (..., 2n + 4); angles are not wrapped."""
    qpos, qvel = np.asarray(qpos, dtype=np.float64), np.asarray(qvel, dtype=np.float64)
    return st.join(
        qpos[..., :2], np.cumsum(qpos[..., 2:], axis=-1), qvel[..., :2], np.cumsum(qvel[..., 2:], axis=-1)
    )


class MujocoSwimmer:
    """dx/dt = f(x, u) by MuJoCo.

    States and torques are those of :class:`~swimmer_mj.analytic.AnalyticSwimmer`; torques are in N·m and are
    not clamped. Batches are worked off one by one. An instance has one ``MjData``: share it between
    threads, and they overwrite each other's state.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer; the paper's 5 links by default.
    friction : {"callback", "actuators"}
        Whether the viscous friction is a passive force or exerted by actuators (:mod:`swimmer_mj.mjcf`).
    """

    def __init__(self, parameters: SwimmerParameters = PAPER, friction: Friction = "callback") -> None:
        self.parameters = parameters
        self.friction: Friction = friction
        self._model = mujoco.MjModel.from_xml_string(mjcf(parameters, friction=friction))
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
        self._data = mujoco.MjData(self._model)
        # d(generalised force)/du, which for motors on hinges does not depend on the state
        n_joints = parameters.n_links - 1
        moment = np.zeros((self._model.nu, self._model.nv))
        if n_joints:
            mujoco.mj_forward(self._model, self._data)
            mujoco.mju_sparse2dense(
                moment,
                self._data.actuator_moment,
                self._data.moment_rownnz,
                self._data.moment_rowadr,
                self._data.moment_colind,
            )
        self._moment = moment[:n_joints] / parameters.torque_limits[:, None]

    def _friction_in_force(self) -> AbstractContextManager[None]:
        return viscous_friction() if self.friction == "callback" else nullcontext()

    def _acceleration(self, x: Array, u: Array) -> Array:
        """The second derivatives of A0 and theta at one state, shape (n + 2,)."""
        data = self._data
        data.qpos[:], data.qvel[:] = to_qpos_qvel(x, self.parameters.n_links)
        data.ctrl[: u.size] = u / self.parameters.torque_limits
        mujoco.mj_forward(self._model, data)
        return np.concatenate([data.qacc[:2], np.cumsum(data.qacc[2:])])

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
        state = st.split(x, n)
        batch = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
        x, u = np.broadcast_to(x, (*batch, x.shape[-1])), np.broadcast_to(u, (*batch, n - 1))
        q = np.empty((*batch, n + 2))
        with self._friction_in_force():
            for index in np.ndindex(batch):
                q[index] = self._acceleration(x[index], u[index])
        velocities = np.concatenate([state.velocity, state.angular_velocities], axis=-1)
        return np.concatenate([np.broadcast_to(velocities, q.shape), q], axis=-1)

    def drift(self, x: ArrayLike) -> Array:
        """a(x) = f(x, 0), shape (..., 2n + 4)."""
        return self.derivative(x, np.zeros(self.parameters.n_links - 1))

    def control_matrix(self, x: ArrayLike) -> Array:
        """B(x) = df/du, exact because f is affine in u; shape (..., 2n + 4, n - 1)."""
        return self.drift_and_control_matrix(x)[1]

    def drift_and_control_matrix(self, x: ArrayLike) -> tuple[Array, Array]:
        """a(x), shape (..., 2n + 4), and B(x), shape (..., 2n + 4, n - 1), by one ``mj_forward`` each."""
        n = self.parameters.n_links
        x = np.asarray(x, dtype=np.float64)
        state = st.split(x, n)
        batch = x.shape[:-1]
        q = np.empty((*batch, n + 2))
        B = np.zeros((*batch, 2 * n + 4, n - 1))
        u = np.zeros(n - 1)
        solved = np.empty_like(self._moment)
        with self._friction_in_force():
            for index in np.ndindex(batch):
                q[index] = self._acceleration(x[index], u)
                mujoco.mj_solveM(self._model, self._data, solved, self._moment)
                accelerations = B[index][n + 2 :]
                accelerations[:2] = solved[:, :2].T
                accelerations[2:] = np.cumsum(solved[:, 2:], axis=-1).T
        return np.concatenate([state.velocity, state.angular_velocities, q], axis=-1), B

    def euler_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the explicit Euler method, u held."""
        return euler_step(lambda y: self.derivative(y, u), np.asarray(x, dtype=np.float64), dt)

    def rk4_step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """x(t + dt) by the classical Runge-Kutta method, u held."""
        return rk4_step(lambda y: self.derivative(y, u), np.asarray(x, dtype=np.float64), dt)
