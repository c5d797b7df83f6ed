"""The swimmer as a domain of the dm_control suite.

    env = load("swim5", task_kwargs={"random": 0})

Tasks ``swim3``, ``swim4``, ``swim5`` ask to swim along the x axis; ``steer3``, ``steer4``, ``steer5`` along a
direction that is drawn anew for each episode. :func:`register` adds the domain to ``dm_control.suite`` as
``coulom_swimmer``.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings and dm_control carry no types.)
from __future__ import annotations

import collections
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from dm_control import mujoco
from dm_control import suite as dm_suite
from dm_control.rl import control
from dm_control.suite import base
from dm_control.utils import containers
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj import viscous
from swimmer_mj.dynamics import from_qpos_qvel, to_qpos_qvel
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.mjcf import Friction, mjcf, read_friction, read_parameters
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["DOMAIN", "SUITE", "Physics", "Swim", "load", "register", "swim", "unregister"]

DOMAIN = "coulom_swimmer"
"""Name of the domain in ``dm_control.suite``."""

SUITE = containers.TaggedTasks()

_DEFAULT_TIME_LIMIT = 5.0  # s, a trial of the paper
_CONTROL_TIMESTEP = 0.01  # s

Array = NDArray[np.float64]
InitialStates = Callable[[np.random.RandomState], ArrayLike]


class Physics(mujoco.Physics):
    """MuJoCo's simulation of a swimmer, with the viscous friction in force as long as it lives.

    The friction is in force from construction (by any of dm_control's constructors, a copy or an
    unpickling) until :meth:`free` or garbage collection, and so in every reset, forward and step. With
    friction by actuators there is nothing to hold, and MuJoCo's callback is left alone. What the
    accessors return follows from ``qpos`` and ``qvel`` alone: it is current also between a change of state
    and the next ``forward``. The target direction is not part of that state: a reset leaves it as it is.
    """

    def _reload_from_data(self, data: mujoco.wrapper.MjData) -> None:
        self.parameters = read_parameters(data.model.ptr)
        self._levers = st.center_of_mass_levers(self.parameters)
        self._mark_distance = self.parameters.lengths.sum() / 2 + 0.7
        held = getattr(self, "_friction", None)
        if read_friction(data.model.ptr) == "actuators":
            if held is not None:
                held()
            self._friction = None
        elif held is None:
            self._friction = viscous.hold(self)
        super()._reload_from_data(data)

    def reset(self, keyframe_id: int | None = None) -> None:
        """Set everything to the model's default or to a keyframe, but the target direction."""
        direction = self.data.mocap_quat[0].copy()
        super().reset(keyframe_id)
        self.data.mocap_quat[0] = direction
        self.move_target_mark(self.center_of_mass())
        self.after_reset()

    def after_reset(self) -> None:
        """Evaluate the forces that act without the motors.

        dm_control disables all actuators here, those by which the friction may be exerted among them.
        """
        if self._friction is not None:
            super().after_reset()
            return
        controls = self.data.ctrl.copy()
        self.data.ctrl[:] = 0
        try:
            self.forward()
        finally:
            self.data.ctrl[:] = controls

    def free(self) -> None:
        """Free the simulation and rendering contexts, and release the friction."""
        super().free()
        if self._friction is not None:
            self._friction()

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


def wrap_angle(angle: ArrayLike) -> Array:
    """``angle`` (rad) plus a multiple of 2 pi, in (-pi, pi]."""
    return np.pi - np.mod(np.pi - np.asarray(angle, dtype=np.float64), 2 * np.pi)


class Swim(base.Task):
    """Swim as fast as possible in the target direction.

    The reward of a control step is the mean velocity of the centre of mass along the target direction during
    the step, m/s (A.4, averaged exactly: displacement over time). Before the first step it is the velocity.

    Parameters
    ----------
    random_direction : bool
        Whether each episode draws its target direction uniformly; otherwise it is +x. It holds until the next
        episode, or until ``physics.set_target_direction``.
    initial_states : callable, optional
        Called with the task's ``RandomState`` at the start of each episode, it returns the reduced state to
        start from (:mod:`swimmer_mj.state`; angles from the x axis); the centre of mass starts at the origin.
        :func:`~swimmer_mj.initial_states.random_initial_state` by default. For given states in turn::

            remaining = iter(states)
            load("swim5", task_kwargs={"initial_states": lambda _: next(remaining)})
    random : int or numpy.random.RandomState, optional
        Seed or source of random numbers.
    """

    def __init__(
        self,
        *,
        random_direction: bool = False,
        initial_states: InitialStates | None = None,
        random: int | np.random.RandomState | None = None,
    ) -> None:
        super().__init__(random=random)
        self._random_direction = random_direction
        self._initial_states = initial_states
        self._start_time = 0.0
        self._start = self._mean_velocity = np.zeros(2)

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        """Torques of the motors in units of their limits, shape (n - 1,), in [-1, 1]."""
        bound = np.ones(physics.parameters.n_links - 1)
        return specs.BoundedArray(bound.shape, np.float64, minimum=-bound, maximum=bound)

    def initialize_episode(self, physics: Physics) -> None:
        """Set the initial state and the target direction of an episode."""
        n = physics.parameters.n_links
        if self._initial_states is None:
            z: ArrayLike = random_initial_state(self.random, n)
        else:
            z = self._initial_states(self.random)
        physics.set_state_vector(st.expand(physics.parameters, z))
        physics.set_target_direction(self.random.uniform(-np.pi, np.pi) if self._random_direction else 0.0)
        self._start_time, self._start = physics.time(), physics.center_of_mass()
        super().initialize_episode(physics)

    def before_step(self, action: ArrayLike, physics: Physics) -> None:
        """Set the motors to ``action``, shape (n - 1,), torques in units of their limits."""
        self._start_time, self._start = physics.time(), physics.center_of_mass()
        super().before_step(action, physics)

    def after_step(self, physics: Physics) -> None:
        """Measure the mean velocity over the control step, and move the mark of the target along."""
        elapsed, center = physics.time() - self._start_time, physics.center_of_mass()
        if elapsed > 0:
            self._mean_velocity = (center - self._start) / elapsed
        else:
            self._mean_velocity = physics.center_of_mass_velocity()
        physics.move_target_mark(center)
        super().after_step(physics)

    def get_observation(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, physics: Physics
    ) -> collections.OrderedDict[str, Array]:
        """The reduced state in the frame whose x axis is the target direction."""
        direction = physics.target_direction()
        return collections.OrderedDict(
            angles=wrap_angle(physics.angles() - direction),
            angular_velocities=physics.angular_velocities(),
            velocity=st.rotate(physics.center_of_mass_velocity(), -direction),
        )

    def get_reward(self, physics: Physics) -> float:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The mean velocity along the target direction since the start of the control step, m/s."""
        x, y = self._mean_velocity.tolist()
        angle = physics.target_direction()
        return x * math.cos(angle) + y * math.sin(angle)


def _make_environment(
    n_links: int,
    random_direction: bool,
    time_limit: float,
    random: int | np.random.RandomState | None,
    environment_kwargs: dict[str, Any] | None,
    params: SwimmerParameters | None,
    initial_states: InitialStates | None,
    friction: Friction,
) -> control.Environment:
    if params is None:
        params = SwimmerParameters(n_links=n_links)
    elif params.n_links != n_links:
        raise ValueError(f"the task is for {n_links} links, and params has {params.n_links}")
    physics = Physics.from_xml_string(mjcf(params, friction=friction))
    task = Swim(random_direction=random_direction, initial_states=initial_states, random=random)
    environment_kwargs = dict(environment_kwargs or {})
    if "n_sub_steps" not in environment_kwargs:
        environment_kwargs.setdefault("control_timestep", _CONTROL_TIMESTEP)
    return control.Environment(physics, task, time_limit=time_limit, **environment_kwargs)


@SUITE.add()
def swim3(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 3 links swim along the x axis."""
    return _make_environment(
        3, False, time_limit, random, environment_kwargs, params, initial_states, friction
    )


@SUITE.add()
def swim4(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 4 links swim along the x axis."""
    return _make_environment(
        4, False, time_limit, random, environment_kwargs, params, initial_states, friction
    )


@SUITE.add()
def swim5(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 5 links swim along the x axis."""
    return _make_environment(
        5, False, time_limit, random, environment_kwargs, params, initial_states, friction
    )


@SUITE.add()
def steer3(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 3 links swim in a direction drawn for each episode."""
    return _make_environment(
        3, True, time_limit, random, environment_kwargs, params, initial_states, friction
    )


@SUITE.add()
def steer4(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 4 links swim in a direction drawn for each episode."""
    return _make_environment(
        4, True, time_limit, random, environment_kwargs, params, initial_states, friction
    )


@SUITE.add()
def steer5(
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    params: SwimmerParameters | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task in which 5 links swim in a direction drawn for each episode."""
    return _make_environment(
        5, True, time_limit, random, environment_kwargs, params, initial_states, friction
    )


def swim(
    params: SwimmerParameters,
    *,
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    initial_states: InitialStates | None = None,
    friction: Friction = "callback",
) -> control.Environment:
    """Return the task of swimming along the x axis for a swimmer of any number of links; see :func:`load`."""
    return _make_environment(
        params.n_links, False, time_limit, random, environment_kwargs, params, initial_states, friction
    )


def load(
    task_name: str,
    task_kwargs: dict[str, Any] | None = None,
    environment_kwargs: dict[str, Any] | None = None,
    visualize_reward: bool = False,
) -> control.Environment:
    """Return the environment of a task, as ``dm_control.suite.load`` does for its domains.

    Parameters
    ----------
    task_name : str
        ``swim3``, ``swim4``, ``swim5``, ``steer3``, ``steer4`` or ``steer5``.
    task_kwargs : dict, optional
        ``random`` (a seed), ``time_limit`` (s, 5 by default), ``params`` (:class:`SwimmerParameters` with the
        task's number of links), ``initial_states`` (see :class:`Swim`) and ``friction`` (``"callback"`` by
        default or ``"actuators"``, see :mod:`swimmer_mj.mjcf`).
    environment_kwargs : dict, optional
        Passed to ``dm_control.rl.control.Environment``: ``control_timestep`` (s, 0.01 by default),
        ``n_sub_steps``, ``flat_observation``, ``legacy_step``.
    visualize_reward : bool
        Whether the colours of rendered frames show the reward.

    Raises
    ------
    ValueError
        There is no such task.
    """
    if task_name not in SUITE:
        raise ValueError(f"there is no task {task_name!r}; the tasks are {', '.join(SUITE)}")
    env = SUITE[task_name](**(task_kwargs or {}), environment_kwargs=environment_kwargs)
    env.task.visualize_reward = visualize_reward
    return env


def _rebuild_suite_constants() -> None:
    """Recompute the task lists of ``dm_control.suite`` from its domains, as it does when imported."""
    dm_suite.ALL_TASKS = dm_suite._get_tasks(tag=None)
    dm_suite.BENCHMARKING = dm_suite._get_tasks("benchmarking")
    dm_suite.EASY = dm_suite._get_tasks("easy")
    dm_suite.HARD = dm_suite._get_tasks("hard")
    dm_suite.EXTRA = tuple(sorted(set(dm_suite.ALL_TASKS) - set(dm_suite.BENCHMARKING)))
    dm_suite.NO_REWARD_VIZ = dm_suite._get_tasks("no_reward_visualization")
    dm_suite.REWARD_VIZ = tuple(sorted(set(dm_suite.ALL_TASKS) - set(dm_suite.NO_REWARD_VIZ)))
    dm_suite.TASKS_BY_DOMAIN = dm_suite._get_tasks_by_domain(dm_suite.ALL_TASKS)


def register() -> None:
    """Add the domain ``coulom_swimmer`` to ``dm_control.suite``, in this process; a second call does nothing.

    dm_control has no official way to add a domain: this extends its private table and recomputes its task
    lists. Lists that another module has imported by name before stay as they were.

    Raises
    ------
    ValueError
        Another domain has that name.
    """
    this_module = sys.modules[__name__]
    if dm_suite._DOMAINS.setdefault(DOMAIN, this_module) is not this_module:
        raise ValueError(f"dm_control.suite already has another domain {DOMAIN!r}")
    _rebuild_suite_constants()


def unregister() -> None:
    """Undo :func:`register`; does nothing if the domain is not there."""
    if dm_suite._DOMAINS.get(DOMAIN) is sys.modules[__name__]:
        del dm_suite._DOMAINS[DOMAIN]
        _rebuild_suite_constants()
