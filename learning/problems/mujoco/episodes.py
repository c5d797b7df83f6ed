"""Episodes of environments as their authors ship them, behind one interface."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.learning.problems.mujoco.tasks.task import Task
from swimmer_mj.needs import MissingDmControlError

__all__ = ["DmControlEpisode", "Episode", "GymnasiumEpisode", "known_task", "open_episode", "varying"]

Array = NDArray[np.float64]


class Episode(Protocol):
    """An episode that has begun."""

    model: Any
    """MjModel."""
    data: Any
    """MjData, or dm_control's view of it."""
    control_timestep: float
    """For how long a control is held, s."""
    steps: int
    """Controls in an episode that is not cut short."""
    over: bool

    def step(self, ctrl: Array) -> float:
        """The environment's own reward of a step."""
        ...

    def restart(self) -> None:
        """Begin another episode, with the random numbers that follow."""
        ...


class DmControlEpisode:
    """An episode of dm_control.suite."""

    def __init__(self, name: str, seed: int) -> None:
        try:
            from dm_control import suite
        except ModuleNotFoundError:
            raise MissingDmControlError(f"dm_control/{name}", "a task of Gymnasium's: gymnasium/ID") from None
        domain, _, task = name.partition("/")
        if (domain, task) not in suite.ALL_TASKS:
            found = sorted({d for d, _ in suite.ALL_TASKS})
            tasks = ", ".join(t for d, t in suite.ALL_TASKS if d == domain)
            known = f"domain {domain!r} has {tasks}" if tasks else f"domains are {', '.join(found)}"
            raise ValueError(f"dm_control.suite has no task {name!r}: {known}")
        self._environment = suite.load(domain, task, task_kwargs={"random": seed})
        physics = self._environment.physics
        self._environment.reset()
        self.model, self.data = physics.model.ptr, physics.data
        self.control_timestep = self._environment.control_timestep()
        if not math.isfinite(self._environment._step_limit):
            raise ValueError(
                f"dm_control/{name} has no time limit, so that its episodes never end: it cannot be judged"
            )
        self.steps = round(self._environment._step_limit)
        self.over = False

    def step(self, ctrl: Array) -> float:
        """The environment's own reward of a step."""
        after = self._environment.step(ctrl)
        self.over = after.last()
        return float(after.reward)

    def restart(self) -> None:
        """Begin another episode, with the random numbers that follow."""
        self._environment.reset()
        self.over = False


class GymnasiumEpisode:
    """An episode of a MuJoCo environment of Gymnasium's."""

    def __init__(self, name: str, seed: int) -> None:
        try:
            import gymnasium
        except ModuleNotFoundError as error:
            raise ValueError(
                f"gymnasium/{name} needs Gymnasium: pip install 'swimmer-mj[gymnasium]'"
            ) from error
        if ":" in name:  # which Gymnasium would take for a module to import
            raise ValueError(
                f"gymnasium/{name}: import the module that registers it, and leave it out of the name"
            )
        try:
            self._environment = gymnasium.make(name)
        except (gymnasium.error.Error, ImportError) as error:
            said = " ".join(str(error).split())
            raise ValueError(f"gymnasium has no environment {name!r}: {said}") from error
        self._environment.reset(seed=seed)
        inner: Any = self._environment.unwrapped
        if not (hasattr(inner, "frame_skip") and isinstance(getattr(inner, "model", None), mujoco.MjModel)):
            raise ValueError(f"gymnasium/{name} is no MuJoCo environment")
        self.model, self.data = inner.model, inner.data
        self.control_timestep = inner.dt
        spec = self._environment.spec
        self.steps = (spec and spec.max_episode_steps) or 1000
        self.over = False

    def step(self, ctrl: Array) -> float:
        """The environment's own reward of a step."""
        _, reward, terminated, truncated, _ = self._environment.step(ctrl)
        self.over = terminated or truncated
        return float(reward)

    def restart(self) -> None:
        """Begin another episode, with the random numbers that follow."""
        self._environment.reset()
        self.over = False


def open_episode(environment: str, seed: int) -> Episode:
    """An episode of "dm_control/DOMAIN/TASK" or "gymnasium/ID", whose random numbers are those of ``seed``."""
    suite, _, name = environment.partition("/")
    return DmControlEpisode(name, seed) if suite == "dm_control" else GymnasiumEpisode(name, seed)


def varying(environment: str) -> tuple[str, ...]:
    """Arrays of the model that differ between episodes: what they hold is no part of the state."""
    one, other = (open_episode(environment, seed).model for seed in (0, 1))
    names = (name for name in dir(one) if not name.startswith("_"))
    return tuple(
        name
        for name in names
        if isinstance(value := getattr(one, name), np.ndarray)
        and value.dtype.kind in "fi"
        and not np.array_equal(value, getattr(other, name), equal_nan=value.dtype.kind == "f")
    )


def known_task(environment: str) -> Task | None:
    """What is known of it; None if nothing is."""
    from swimmer_mj.learning.problems.mujoco.tasks import dm_control, gymnasium

    suite, _, name = environment.partition("/")
    return {"dm_control": dm_control.TASKS, "gymnasium": gymnasium.TASKS}[suite].get(name)
