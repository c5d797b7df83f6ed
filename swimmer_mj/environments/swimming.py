"""The swimmer's task, without dm_control: how episodes start, what is observed, what is rewarded.

:class:`Rules` are those of dm_control's task (:class:`swimmer_mj.environments.suite.Swim`) and of the
:class:`Environment` here, which simulates with MuJoCo alone. For the same seed both give the same episodes, to the
last bit; a test holds them equal.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.environments.simulation import Accessors, Simulation
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["TASKS", "Environment", "InitialStates", "Rules", "task_parameters", "wrap_angle"]

TASKS = {f"{kind}{n}": (n, kind == "steer") for kind in ("swim", "steer") for n in (3, 4, 5)}
"""The number of links of each task, and whether an episode draws its target direction."""

Array = NDArray[np.float64]
InitialStates = Callable[[np.random.RandomState], ArrayLike]


def wrap_angle(angle: ArrayLike) -> Array:
    """``angle`` (rad) plus a multiple of 2 pi, in (-pi, pi]."""
    return np.pi - np.mod(np.pi - np.asarray(angle, dtype=np.float64), 2 * np.pi)


def task_parameters(n_links: int, params: SwimmerParameters | None) -> SwimmerParameters:
    """``params``, which must have the task's number of links; the paper's values if there are none."""
    if params is None:
        return SwimmerParameters(n_links=n_links)
    if params.n_links != n_links:
        raise ValueError(f"the task is for {n_links} links, and params has {params.n_links}")
    return params


class Rules:
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
        self._random = random if isinstance(random, np.random.RandomState) else np.random.RandomState(random)
        self._random_direction = random_direction
        self._initial_states = initial_states
        self._start_time = 0.0
        self._start = self._mean_velocity = np.zeros(2)

    @property
    def random(self) -> np.random.RandomState:
        """The source of random numbers."""
        return self._random

    def initialize_episode(self, physics: Any) -> None:
        """Set the initial state and the target direction of an episode."""
        n = physics.parameters.n_links
        if self._initial_states is None:
            z: ArrayLike = random_initial_state(self.random, n)
        else:
            z = self._initial_states(self.random)
        physics.set_state_vector(st.expand(physics.parameters, z))
        physics.set_target_direction(self.random.uniform(-np.pi, np.pi) if self._random_direction else 0.0)
        self._start_time, self._start = physics.time(), physics.center_of_mass()
        self.after_step(physics)

    def before_step(self, action: ArrayLike, physics: Any) -> None:
        """Set the motors to ``action``, shape (n - 1,), torques in units of their limits."""
        self._start_time, self._start = physics.time(), physics.center_of_mass()
        physics.set_control(action)

    def after_step(self, physics: Any) -> None:
        """Measure the mean velocity over the control step, and move the mark of the target along."""
        elapsed, center = physics.time() - self._start_time, physics.center_of_mass()
        if elapsed > 0:
            self._mean_velocity = (center - self._start) / elapsed
        else:
            self._mean_velocity = physics.center_of_mass_velocity()
        physics.move_target_mark(center)

    def get_observation(self, physics: Accessors) -> collections.OrderedDict[str, Array]:
        """The reduced state in the frame whose x axis is the target direction."""
        direction = physics.target_direction()
        return collections.OrderedDict(
            angles=wrap_angle(physics.angles() - direction),
            angular_velocities=physics.angular_velocities(),
            velocity=st.rotate(physics.center_of_mass_velocity(), -direction),
        )

    def get_reward(self, physics: Accessors) -> float:
        """The mean velocity along the target direction since the start of the control step, m/s."""
        x, y = self._mean_velocity.tolist()
        angle = physics.target_direction()
        return x * math.cos(angle) + y * math.sin(angle)


class Environment:
    """The task in MuJoCo alone; its episodes do not end by themselves.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer.
    n_sub_steps : int
        How many steps of 0.01 s a control is held for.
    **rules
        Those of :class:`Rules`.
    """

    def __init__(self, parameters: SwimmerParameters, *, n_sub_steps: int = 1, **rules: Any) -> None:
        self.physics = Simulation(parameters)
        self.task = Rules(**rules)
        self.n_sub_steps = n_sub_steps

    def control_timestep(self) -> float:
        """For how long a control is held, s."""
        return self.n_sub_steps * self.physics.model.opt.timestep

    def reset(self) -> collections.OrderedDict[str, Array]:
        """Start an episode; returns the first observation."""
        self.physics.reset()
        self.task.initialize_episode(self.physics)
        self.physics.forward()
        return self.task.get_observation(self.physics)

    def step(self, action: ArrayLike) -> tuple[collections.OrderedDict[str, Array], float]:
        """Hold the torques ``action``, shape (n - 1,), in units of their limits; returns observation and reward."""
        self.task.before_step(action, self.physics)
        self.physics.step(self.n_sub_steps)
        self.task.after_step(self.physics)
        return self.task.get_observation(self.physics), self.task.get_reward(self.physics)
