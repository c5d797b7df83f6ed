"""The swimmer as a domain of the dm_control suite.

    env = load("swim5", task_kwargs={"random": 0})

Tasks ``swim3``, ``swim4``, ``swim5`` ask to swim along the x axis; ``steer3``, ``steer4``, ``steer5`` along a
direction that is drawn anew for each episode. :func:`register` adds the domain to ``dm_control.suite`` as
``coulom_swimmer``.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings and dm_control carry no types.)
from __future__ import annotations

import sys
from typing import Any

import numpy as np

from swimmer_mj import viscous
from swimmer_mj.environments.simulation import Accessors
from swimmer_mj.environments.swimming import InitialStates, Rules, task_parameters, wrap_angle
from swimmer_mj.libraries import load_triton_apart
from swimmer_mj.mjcf import Friction, mjcf, read_friction, read_parameters
from swimmer_mj.needs import MissingDmControlError
from swimmer_mj.parameters import SwimmerParameters

try:
    from dm_control import mujoco
    from dm_control import suite as dm_suite
    from dm_control.rl import control
    from dm_control.suite import base
    from dm_control.utils import containers
    from dm_env import specs
except ModuleNotFoundError:
    raise MissingDmControlError(
        "a task of swimmer_mj.load", 'gymnasium.make("swimmer_mj.gymnasium:swimmer_mj/Swim5-v0")'
    ) from None

__all__ = ["DOMAIN", "SUITE", "Physics", "Swim", "load", "register", "swim", "unregister", "wrap_angle"]

DOMAIN = "coulom_swimmer"
"""Name of the domain in ``dm_control.suite``."""

SUITE = containers.TaggedTasks()

_DEFAULT_TIME_LIMIT = 5.0  # s, a trial of the paper
_CONTROL_TIMESTEP = 0.01  # s


class Physics(Accessors, mujoco.Physics):  # pyright: ignore[reportIncompatibleMethodOverride]
    """MuJoCo's simulation of a swimmer, with the viscous friction in force as long as it lives.

    The friction is in force from construction (by any of dm_control's constructors, a copy or an
    unpickling) until :meth:`free` or garbage collection, and so in every reset, forward and step. With
    friction by actuators there is nothing to hold, and MuJoCo's callback is left alone.
    """

    def _reload_from_data(self, data: mujoco.wrapper.MjData) -> None:
        self._read(read_parameters(data.model.ptr))
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
            viscous.friction.require()
            super().after_reset()
            return
        controls = self.data.ctrl.copy()
        self.data.ctrl[:] = 0
        try:
            self.forward()
        finally:
            self.data.ctrl[:] = controls

    def step(self, nstep: int = 1) -> None:
        """Simulate ``nstep`` timesteps."""
        if self._friction is not None:
            viscous.friction.require()
        super().step(nstep)

    def render(self, *args: Any, **kwargs: Any) -> Any:
        """What dm_control draws, with the mark of the target where it is now."""
        self.forward()
        return super().render(*args, **kwargs)

    def free(self) -> None:
        """Free the simulation and rendering contexts, and release the friction."""
        super().free()
        if self._friction is not None:
            self._friction()


class Swim(Rules, base.Task):  # pyright: ignore[reportIncompatibleMethodOverride]
    """Swim as fast as possible in the target direction.

    Parameters
    ----------
    **rules
        ``random_direction``, ``initial_states``, ``random``: see :class:`~swimmer_mj.environments.swimming.Rules`.
    """

    def __init__(self, **rules: Any) -> None:
        Rules.__init__(self, **rules)
        base.Task.__init__(self, random=self.random)

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        """Torques of the motors in units of their limits, shape (n - 1,), in [-1, 1]."""
        bound = np.ones(physics.parameters.n_links - 1)
        return specs.BoundedArray(bound.shape, np.float64, minimum=-bound, maximum=bound)

    def after_step(self, physics: Physics) -> None:
        """What the rules say, and the colours of the reward."""
        Rules.after_step(self, physics)
        base.Task.after_step(self, physics)


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
    physics = Physics.from_xml_string(mjcf(task_parameters(n_links, params), friction=friction))
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
    load_triton_apart()
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
