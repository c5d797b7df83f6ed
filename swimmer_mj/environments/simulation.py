"""MuJoCo's simulation of a swimmer, without dm_control.

:class:`Accessors` reads a simulation and sets its state; :class:`Simulation` and dm_control's
:class:`~swimmer_mj.environments.suite.Physics` both have them. The steps of both are the same to the last bit.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj import viscous
from swimmer_mj.dynamics import from_qpos_qvel, to_qpos_qvel
from swimmer_mj.mjcf import mjcf, read_parameters
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["Accessors", "PhysicsError", "Simulation"]

Array = NDArray[np.float64]


class PhysicsError(FloatingPointError):
    """The simulation left what MuJoCo can compute."""


class Accessors:
    """State, centre of mass and target direction of a swimmer in a simulation.

    What they return follows from ``qpos`` and ``qvel`` alone: it is current also between a change of state and the
    next ``forward``. The target direction is not part of that state: a reset leaves it as it is.
    """

    parameters: SwimmerParameters
    data: Any
    """MjData, or dm_control's view of it."""

    def _read(self, parameters: SwimmerParameters) -> None:
        """Take the swimmer's parameters, when the model is loaded."""
        self.parameters = parameters
        self._levers = st.center_of_mass_levers(parameters)
        self._mark_distance = parameters.lengths.sum() / 2 + 0.7

    def set_control(self, control: ArrayLike) -> None:
        """Set the motors to ``control``, shape (n - 1,), torques in units of their limits."""
        np.copyto(self.data.ctrl[: self.parameters.n_links - 1], control)

    def control(self) -> Array:
        """A copy of the motors' controls, shape (n - 1,)."""
        return self.data.ctrl[: self.parameters.n_links - 1].copy()

    def state_vector(self) -> Array:
        """The full state x (:mod:`swimmer_mj.state`), shape (2n + 4,); angles are not wrapped."""
        return from_qpos_qvel(self.data.qpos, self.data.qvel)

    def set_state_vector(self, x: ArrayLike) -> None:
        """Set the full state, shape (2n + 4,); call ``forward`` after it, or do it in a ``reset_context``."""
        self.data.qpos[:], self.data.qvel[:] = to_qpos_qvel(x, self.parameters.n_links)

    def reduced_state(self) -> Array:
        """The reduced state z (:mod:`swimmer_mj.state`), shape (2n + 2,); angles are not wrapped."""
        return st.join_reduced(self.angles(), self.angular_velocities(), self.center_of_mass_velocity())

    def angles(self) -> Array:
        """theta, the angles of the links from the x axis, shape (n,), rad; not wrapped."""
        return self.data.qpos[2:].cumsum()

    def angular_velocities(self) -> Array:
        """dtheta/dt, shape (n,), rad/s."""
        return self.data.qvel[2:].cumsum()

    def joint_positions(self) -> Array:
        """A_0 .. A_n, shape (n + 1, 2), m."""
        return st.joint_positions(self.parameters, self.state_vector())

    def center_of_mass(self) -> Array:
        """G, shape (2,), m."""
        return self.data.qpos[:2] + self._levers @ st.link_directions(self.angles())

    def center_of_mass_velocity(self) -> Array:
        """dG/dt, shape (2,), m/s."""
        rates = self._levers * self.angular_velocities()
        return self.data.qvel[:2] + rates @ st.link_normals(self.angles())

    def target_direction(self) -> float:
        """The direction to swim to, the angle from the x axis in [-pi, pi], rad."""
        w, _, _, z = self.data.mocap_quat[0].tolist()
        return math.atan2(2 * w * z, w * w - z * z)

    def set_target_direction(self, angle: float) -> None:
        """Turn the target direction to ``angle`` (rad, from the x axis) and move its mark."""
        self.data.mocap_quat[0] = math.cos(angle / 2), 0, 0, math.sin(angle / 2)
        self.move_target_mark(self.center_of_mass())

    def move_target_mark(self, center: Array) -> None:
        """Put the mark, which only shows the target direction, ahead of ``center``, shape (2,), m."""
        angle, distance = self.target_direction(), self._mark_distance
        x, y = center.tolist()
        self.data.mocap_pos[0, :2] = x + distance * math.cos(angle), y + distance * math.sin(angle)


class Simulation(Accessors):
    """MuJoCo's simulation of a swimmer, with the viscous friction in force as long as it lives.

    Until :meth:`free` or garbage collection, that is. It can be copied and pickled.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer.
    """

    model: Any
    """MjModel."""

    def __init__(self, parameters: SwimmerParameters) -> None:
        model = mujoco.MjModel.from_xml_string(mjcf(parameters))
        self.__setstate__((model, mujoco.MjData(model)))

    def __getstate__(self) -> tuple[Any, Any]:
        return self.model, self.data

    def __setstate__(self, state: tuple[Any, Any]) -> None:
        self.model, self.data = state
        self._renderer: Any = None
        self._read(read_parameters(self.model))
        self._friction = viscous.hold(self)

    def time(self) -> float:
        """s, since the last reset."""
        return self.data.time

    def reset(self) -> None:
        """Set everything to the model's default, but the target direction; call :meth:`forward` when all is set."""
        direction = self.data.mocap_quat[0].copy()
        mujoco.mj_resetData(self.model, self.data)
        self.data.mocap_quat[0] = direction
        self.move_target_mark(self.center_of_mass())

    def forward(self) -> None:
        """Compute what follows from the state."""
        self.require_friction()
        mujoco.mj_forward(self.model, self.data)
        self._check()

    def step(self, count: int = 1) -> None:
        """Simulate ``count`` timesteps.

        Raises
        ------
        PhysicsError
            MuJoCo raised a warning.
        """
        self.require_friction()
        mujoco.mj_step(self.model, self.data, count)
        self._check()

    def require_friction(self) -> None:
        """Raise RuntimeError if the friction is no longer in force."""
        if not self._friction.alive:
            raise RuntimeError("the simulation is closed and would go on without friction; make another one")
        viscous.friction.require()

    def _check(self) -> None:
        numbers = self.data.warning.number
        if numbers.any():
            names = [mujoco.mjtWarning(i).name for i in np.flatnonzero(numbers).tolist()]
            numbers[:] = 0
            raise PhysicsError(f"the physics state is invalid: MuJoCo warned of {', '.join(names)}")

    def render(self, *, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        """The present state, seen by a camera of the model's; shape (height, width, 3)."""
        if self._renderer is None or (self._renderer.width, self._renderer.height) != (width, height):
            self._close_renderer()
            self._renderer = mujoco.Renderer(self.model, height, width)
        self.forward()
        self._renderer.update_scene(self.data, camera)
        return self._renderer.render()

    def free(self) -> None:
        """Free the rendering context, and release the friction: there are no more steps."""
        self._close_renderer()
        self._friction()

    def _close_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
