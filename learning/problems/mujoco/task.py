"""Problems by name: dm_control/DOMAIN/TASK, gymnasium/ID, or a file of MJCF with a reward."""

from __future__ import annotations

import hashlib
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import BatchPolicy, EnvironmentForm, EpisodeForm, FilmForm, Policy
from swimmer_mj.learning.problems.mujoco.episodes import Episode, known_task, open_episode, varying
from swimmer_mj.learning.problems.mujoco.problem import MujocoProblem
from swimmer_mj.learning.problems.mujoco.starts import Starts, is_file, load_model
from swimmer_mj.learning.problems.mujoco.tasks.task import Task
from swimmer_mj.own_code import import_own

__all__ = ["MujocoTask"]

Array = NDArray[np.float64]
Form = TypeVar("Form")

ADVICE = {
    "s_lambda": 5.0,
    "value_weight": 10.0,
    "huber": 1.0,
    "trajectories": 256,
    "minibatch": 256,
    "passes": 2,
    "half_life": 60.0,
}
"""Settings of value gradients where nothing better is known: docs/any-model.md says why not those of a swimmer."""
BEGINNING_SEED = 2**31 - 1
BEGINNINGS = 128
"""States in which the environment begins, as they are drawn again and again."""
THEIR_SHARE = 0.3
"""Of the initial states that are learned from: elsewhere would be learned, and the way there not."""


def _function(name: str) -> Callable[..., Any]:
    """The function at "module:function", of a module that has been imported: what a file names is not run."""
    module, colon, function = name.partition(":")
    if not (module and colon and function):
        raise ValueError(f"reward must be like my_module:reward, got {name!r}")
    if module not in sys.modules:
        raise ValueError(
            f"reward {name!r} is code that does not come with swimmer-mj, and reading a run does not run it; if you "
            f"trust it, add --trust {module}, in Python import it before"
        )
    try:
        return getattr(sys.modules[module], function)
    except AttributeError as error:
        raise ValueError(f"reward {name!r}: {error}") from error


@dataclass(frozen=True)
class MujocoTask:
    """A :class:`~swimmer_mj.learning.problems.mujoco.problem.MujocoProblem` that config.json can keep."""

    environment: str = "dm_control/cartpole/swingup"
    """dm_control/DOMAIN/TASK, gymnasium/ID, or the path of an MJCF file."""
    reward_function: str | None = None
    """module:function of the reward rate, a torch function of a Scene; None where the environment's is known."""
    control_cost: tuple[float, ...] | None = None
    """Coefficient of u^2 for each control; None: the environment's, or none."""
    s_gamma: float = math.nan
    """Shortness factor, 1/s; not given, what is known to learn the task, or 1."""
    limits: tuple[float, ...] | None = None
    """For actuators without a ctrlrange."""
    held: bool = True
    """Choose controls for the time for which they are held, not for the instant."""
    threads: int | None = None
    """All cores by default; what is learned does not depend on it."""
    digest: str = ""
    """Of the MJCF file that was learned from; filled in, and held against the file when a run is read."""
    control_timestep: float | None = None
    """Of an MJCF file: for how long a control is held, s, a whole number of the model's own time steps; None: one of
    them. An environment has its own."""

    def __post_init__(self) -> None:
        if self._is_file:
            self._keep_digest()
        first = self._first  # an environment that does not exist is refused first
        if first is not None and self.control_timestep is not None:
            raise ValueError(
                f"{self.environment} holds a control for {first.control_timestep:g} s, and control_timestep is for a "
                f"model of one's own, FILE.xml; got {self.control_timestep!r}: leave it out"
            )
        if math.isnan(self.s_gamma):
            object.__setattr__(self, "s_gamma", self.task.s_gamma)
        self.problem  # noqa: B018 - what cannot be learned is refused now

    def _keep_digest(self) -> None:
        if not Path(self.environment).is_file():
            raise FileNotFoundError(f"there is no model {self.environment}")
        found = hashlib.sha256(Path(self.environment).read_bytes()).hexdigest()[:16]
        if self.digest not in ("", found):
            raise ValueError(
                f"{self.environment} has changed since it was learned from: put it back as it was, or begin a new run"
            )
        object.__setattr__(self, "digest", found)

    @classmethod
    def from_options(
        cls,
        environment: str = "",
        reward: str | None = None,
        s_gamma: float = math.nan,
        control_timestep: float | None = None,
    ) -> Self:
        """The problem by the options of the command line."""
        if not environment:
            raise ValueError(
                "problem must name a model: dm_control/DOMAIN/TASK, gymnasium/ID or FILE.xml; got 'mujoco'"
            )
        if reward is not None:  # what is typed is meant to be run
            import_own(reward.partition(":")[0], f"--reward {reward!r}")
        if is_file(environment):
            environment = os.fspath(Path(environment).resolve())
        return cls(environment, reward, s_gamma=s_gamma, control_timestep=control_timestep)

    @property
    def _is_file(self) -> bool:
        return is_file(self.environment)

    @cached_property
    def task(self) -> Task:
        """What is known of it."""
        known = None if self._is_file else known_task(self.environment)
        if self.reward_function is not None:
            reward = _function(self.reward_function)
            if known is not None:
                return known._replace(learned=reward)
            if not self._is_file and (drawn := varying(self.environment)):
                raise ValueError(
                    f"{self.environment}: each episode has another model ({', '.join(drawn)}), and one is learned: "
                    "make it a model of your own, with what differs as a goal (docs/any-model.md)"
                )
            return Task(reward)
        if known is None:
            raise ValueError(
                f"{self.environment}: its reward is not known as a torch function; "
                "give --reward module:function (docs/any-model.md)"
            )
        return known

    @cached_property
    def _first(self) -> Episode | None:
        return None if self._is_file else open_episode(self.environment, 0)

    @cached_property
    def problem(self) -> MujocoProblem:
        """The problem itself."""
        task, first = self.task, self._first
        model = load_model(self.environment) if first is None else first.model
        draw = task.draw
        return MujocoProblem(
            model,
            task.learned or task.reward,
            control_cost=task.cost if self.control_cost is None else self.control_cost,
            name=self.environment,
            draw=None if draw is None else partial(draw, model),
            s_gamma=self.s_gamma,
            control_timestep=self.control_timestep if first is None else first.control_timestep,
            control_limits=self.limits,
            held=self.held,
            threads=self.threads,
        )

    # ControlProblem ------------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """That of the environment."""
        return self.environment

    @property
    def advice(self) -> Mapping[str, Any]:
        """Settings of value gradients that are known to learn it, or such tasks."""
        return {"dt": self.problem.control_timestep, **ADVICE, **self.task.advice}

    def caution(self) -> str | None:
        """One line, if the model is not smooth at some of the states seen."""
        return self.problem.caution()

    @property
    def state_size(self) -> int:
        """p."""
        return self.problem.state_size

    @property
    def n_inputs(self) -> int:
        """m."""
        return self.problem.n_inputs

    @property
    def control_limits(self) -> Array:
        """U, shape (q,)."""
        return self.problem.control_limits

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., p), and B(x), shape (..., p, q)."""
        return self.problem.drift_and_control_matrix(x)

    def reward(self, x: Array) -> Array:
        """r(x), shape (...), without the control's cost."""
        return self.problem.reward(x)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt), u held."""
        return self.problem.step(x, u, dt)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """``count`` draws, shape (count, p): of the problem's law, and a share as the environment begins."""
        x = self.problem.initial_states(rng, count)
        if self._first is not None:
            own = np.flatnonzero(rng.random(count) < THEIR_SHARE)
            x[own] = self._beginnings[rng.integers(BEGINNINGS, size=own.size)]
        return x

    def inputs(self, x: Tensor) -> Tensor:
        """The network's inputs, (..., m)."""
        return self.problem.inputs(x)

    def form(self, kind: type[Form]) -> Form | None:
        """As the problem's, and the environment that judges it."""
        first = self._first
        if kind is FilmForm:
            return FilmForm(self._play)  # pyright: ignore[reportReturnType]
        if first is not None and kind is EpisodeForm:
            return EpisodeForm(first.steps * first.control_timestep, 0.0, first.control_timestep)  # pyright: ignore
        if first is not None and kind is EnvironmentForm:
            return EnvironmentForm("return", "", self._starts, self._returns)  # pyright: ignore
        return self.problem.form(kind)

    # The environment -----------------------------------------------------------------------------------------------

    def state(self, episode: Episode) -> Array:
        """x, shape (p,)."""
        goal = self.task.goal(episode.model, episode.data)
        qpos = self.task.relative(np.array(episode.data.qpos), goal)
        act = np.array(episode.data.act).reshape(1, -1)
        known = goal[None] if self.problem.goal_size else None
        return self.problem.states(Starts(qpos[None], np.array(episode.data.qvel)[None], known, act))[0]

    @cached_property
    def _beginnings(self) -> Array:
        """States in which episodes begin, shape (BEGINNINGS, p); no episode that is judged is one of theirs."""
        episode, found = open_episode(self.environment, BEGINNING_SEED), []
        for _ in range(BEGINNINGS):
            found.append(self.state(episode))
            episode.restart()
        return np.stack(found)

    def _starts(self, count: int) -> Array:
        """The states in which the episodes of seeds 0 .. count - 1 begin."""
        return np.stack([self.state(open_episode(self.environment, seed)) for seed in range(count)])

    def _play(self, policy: Policy, duration: float) -> Iterator[tuple[Any, Any, float]]:
        """An episode of the environment, or of the model from an initial state."""
        if self._first is None:
            yield from self.problem.play(policy, duration)
            return
        episode = open_episode(self.environment, 0)
        for _ in range(round(duration / episode.control_timestep)):
            data = getattr(episode.data, "ptr", episode.data)
            yield episode.model, data, episode.control_timestep
            if episode.over:
                return
            episode.step(self.problem.ctrl(policy(self.state(episode))))

    def _returns(self, policy: Policy, count: int, workers: int) -> Array:
        return self.returns(policy, range(count))

    def returns(self, policy: Policy, seeds: Sequence[int]) -> Array:
        """Return of an episode of each seed, in the environment as it is; they run side by side."""
        episodes = [open_episode(self.environment, seed) for seed in seeds]
        act = policy.acting() if isinstance(policy, BatchPolicy) else policy
        total, running = np.zeros(len(episodes)), list(range(len(episodes)))
        while running:
            u = act(np.stack([self.state(episodes[k]) for k in running]))
            ctrl = self.problem.ctrl(u)
            for k, one in zip(running, ctrl, strict=True):
                total[k] += episodes[k].step(one)
            running = [k for k in running if not episodes[k].over]
        return total
