"""A MuJoCo model as a control problem: MuJoCo is the drift, the control matrix and the Jacobian.

Give a model, a reward as a torch function of named things, and learn::

    problem = MujocoProblem("arm.xml", lambda scene: -scene.site("hand").norm(dim=1))

The model must be smooth: what contacts, friction and joint limits do is computed, but its derivatives jump where a
constraint becomes active, and the control matrix leaves constraints out, equality constraints too.
:meth:`MujocoProblem.caution` says at which share of states one is active, and learners warn with it.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import (
    EPISODE,
    BatchForm,
    CoordinatesForm,
    CostForm,
    Encoding,
    EpisodeForm,
    FilmForm,
    HoldForm,
    Policy,
)
from swimmer_mj.learning.problems.held import Memory, Slope
from swimmer_mj.learning.problems.mujoco import heading
from swimmer_mj.learning.problems.mujoco.actuation import actuation
from swimmer_mj.learning.problems.mujoco.batched import MujocoBatch, Rate
from swimmer_mj.learning.problems.mujoco.checks import require_functions, require_rates, require_whole_steps
from swimmer_mj.learning.problems.mujoco.coordinates import layout
from swimmer_mj.learning.problems.mujoco.encoding import (
    How,
    encode,
    encoding,
    rows_asked_for,
    turning,
    unused,
)
from swimmer_mj.learning.problems.mujoco.readings import Scene, recorded, scene_of
from swimmer_mj.learning.problems.mujoco.sameness import same_reward
from swimmer_mj.learning.problems.mujoco.simulations import Simulations, learners_model, own_model
from swimmer_mj.learning.problems.mujoco.starts import (
    Draw,
    Starts,
    anywhere,
    drawn,
    held_for,
    load_model,
    states,
)
from swimmer_mj.mjcf import FRICTION_TUPLE
from swimmer_mj.viscous import hold

__all__ = ["MujocoProblem"]

Array = NDArray[np.float64]
Form = TypeVar("Form")
Function = Callable[[Scene], Tensor]

SAMPLE = 256
"""States from which scales, and what does not matter, are read off."""
SETTLING = 1.0
"""How long those states move under random controls before their scales are taken, s."""
SPARSE = 8
"""Of the states seen, every so many are asked how they move; all, what they earn."""


class MujocoProblem:
    """A :class:`~swimmer_mj.learning.problems.problem.ControlProblem` of a MuJoCo model.

    Parameters
    ----------
    model : MjModel, MjSpec, str, path or environment
        The model, its specification, its XML, or its file. Or where it is: an environment of dm_control
        (``suite.load(..)``), its Physics, or a MuJoCo environment of Gymnasium (``gymnasium.make("Swimmer-v5")``, also
        wrapped); the model and the control step are taken from it, nothing else. What is done to it later has no
        effect.
    reward_rate : callable
        r of a :class:`~swimmer_mj.learning.problems.mujoco.readings.Scene`, shape (N,), in torch; per second.
    control_cost : callable or sequence of float, optional
        c >= 0, (N, q) or one for each control: the reward rate is r - sum_i c_i u_i^2, where u is how far ctrl is from
        the middle of its range. The greedy control of the instant is then B^T dV/dx / 2c within its limits; without it,
        bang-bang.
    name : str
        What to call it.
    draw : callable, optional
        The law of initial states. By default angles that turn freely are anywhere, limited joints anywhere in their
        range, whatever equality constraints say, other positions within 1 of those of the model, velocities within 1.
    s_gamma : float
        Shortness factor, 1/s.
    control_timestep : float, optional
        For how long a control is held when the policy acts, s; by default the environment's, or the model's own time
        step.
    without : sequence of str, optional
        Joints whose positions nothing depends on; None finds them.
    inputs : mapping, optional
        How coordinates enter the network, by their names in ``problem.layout.names``: a factor, or "angle" for cos and
        sin; 0 leaves one out. What is not named is encoded by what initial states and short rollouts show. Of a body
        for which it makes no difference where it looks, positions and velocities are as it sees them
        (:mod:`~swimmer_mj.learning.problems.mujoco.heading`).
    control_limits : sequence of float, optional
        For actuators without a ctrlrange.
    held : bool
        Choose controls for the time for which they are held
        (:func:`~swimmer_mj.learning.problems.held.held_control`), not for the instant: where a strong actuator would
        overstep within that time, less of it is used.
    threads : int, optional
        All cores by default. Results do not depend on it.
    """

    def __init__(
        self,
        model: Any,
        reward_rate: Function,
        *,
        control_cost: Function | Sequence[float] | None = None,
        name: str = "mujoco",
        draw: Draw | None = None,
        s_gamma: float = 1.0,
        control_timestep: float | None = None,
        without: Sequence[str] | None = None,
        inputs: Mapping[str, How] | None = None,
        control_limits: Sequence[float] | None = None,
        held: bool = True,
        threads: int | None = None,
    ) -> None:
        if not 0 < s_gamma < math.inf:
            raise ValueError(f"s_gamma must be positive and finite, got {s_gamma!r}")
        if threads is not None and threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads!r}")
        self.name, self.s_gamma = name, s_gamma
        source, self.model = model, own_model(load_model(model))
        model = self.model
        self.control_timestep = held_for(source, model) if control_timestep is None else control_timestep
        require_whole_steps(self.control_timestep, float(model.opt.timestep))
        self._actuation = actuation(model, control_limits)
        self.control_limits = self._actuation.limits
        self._home = np.array(model.qpos0)
        self._draw = partial(anywhere, model) if draw is None else draw
        starts = drawn(model, self._draw, np.random.default_rng(0), 2)
        self.goal_size = 0 if starts.goal is None else starts.goal.shape[1]
        self._threads, self.held = threads, held
        if _declares_friction(model):
            hold(self)
        asked: dict[str, Function] = {"reward_rate": reward_rate}
        if callable(control_cost):
            asked["control_cost"] = control_cost
        require_functions(asked)
        self.readings = recorded(model, asked, self.goal_size)
        self._reward, self._cost = reward_rate, control_cost
        self._lay_out(() if without is None else without)
        x = self.initial_states(np.random.default_rng(0), 3)
        require_rates(self.rate, x, self.read(x), len(self.control_limits))
        seen = self._seen()
        if without is None and (
            found := unused(model, self.layout, self._same, seen, np.random.default_rng(1))
        ):
            kept = [k for k, name in enumerate(self.layout.names) if name not in found]
            self._lay_out(found)
            seen = seen[:, kept]
        self.layout = self.layout._replace(angle=turning(self.layout, self._same, seen))
        self.heading = self._idle_heading(seen)
        self._constrained = self._share_of_constrained(seen)
        self.encoding = self._encoding({} if inputs is None else inputs, seen)
        self.n_inputs = 2 * len(self.encoding.angle) + len(self.encoding.linear)

    def _lay_out(self, without: Sequence[str]) -> None:
        """Leave out the positions of these joints."""
        self.layout = layout(self.model, without, self.goal_size)
        self.state_size = len(self.layout.names)
        self.__dict__.pop("_own", None)  # which was of another layout

    # The reward ----------------------------------------------------------------------------------------------------

    def rate(self, x: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
        """r (N,) and the coefficients c (N, q), of states x (N, p) with the ``values`` (N, r) of their readings."""
        scene = scene_of(self.model, self.layout.coordinates, self._home, x, self.readings, values)
        r = self._reward(scene)
        if callable(self._cost):
            return r, self._cost(scene)
        return r, torch.from_numpy(self._constant_cost).to(x).expand(len(x), -1)

    @property
    def _constant_cost(self) -> Array | None:
        """c (q,), unless it depends on the state."""
        if callable(self._cost):
            return None
        if self._cost is None:
            return np.zeros(self.control_limits.size)
        cost, q = np.array(self._cost, dtype=np.float64), self.control_limits.size
        if cost.shape != (q,):
            raise ValueError(f"control_cost must be one for each of {q} controls, got {self._cost!r}")
        return cost

    # ControlProblem ------------------------------------------------------------------------------------------------

    @property
    def _single(self) -> MujocoBatch:
        """For calls from Python, one at a time in each thread: the runs of several seeds share a problem."""
        own = self.__dict__.setdefault("_own", threading.local())
        if not hasattr(own, "batch"):
            own.batch = self.batch()
        return own.batch

    def __getstate__(self) -> dict[str, Any]:
        """Without what belongs to a thread, and is made again when it is needed."""
        return {name: value for name, value in self.__dict__.items() if name != "_own"}

    def batch(self, centred: bool = False) -> MujocoBatch:
        """Its compiled loops, with buffers of their own; with central differences if ``centred``."""
        co, ac, readings, threads = self.layout.coordinates, self._actuation, self.readings, self._threads
        learner = Simulations(partial(learners_model, self.model), self._home, readings, threads)
        actor = Simulations(partial(own_model, self.model), self._home, readings, threads)
        return MujocoBatch(
            learner,
            actor,
            co,
            ac,
            self.rate,
            self._constant_cost,
            centred,
            timestep=float(self.model.opt.timestep),
            held=self.held,
            s_gamma=self.s_gamma,
            control_timestep=self.control_timestep,
        )

    def read(self, x: Array) -> Array:
        """The readings at x (N, p), shape (N, r)."""
        return self._single.read(np.ascontiguousarray(x.T)).T

    def _checked(self, x: Array) -> Array:
        """x (..., p) as float64; ValueError if it has another last axis."""
        x = np.asarray(x, dtype=np.float64)
        if x.ndim == 0 or x.shape[-1] != self.state_size:
            raise ValueError(f"states must have a last axis of {self.state_size}, got shape {x.shape}")
        return x

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., p), with the controls in the middle of their ranges, and B(x), shape (..., p, q).

        Constraints act in a, and not in B, which is what controls do to the unconstrained model: where one is active
        (an equality between joints always is), a + B u is not MuJoCo's acceleration. :meth:`step` has them in all of
        it, and so has the choice of a control that is held.
        """
        x = self._checked(x)
        p, q = self.state_size, len(self.control_limits)
        a, B = self._single.drift_and_control_matrix(np.ascontiguousarray(x.reshape(-1, p)))
        return a.reshape(x.shape), B.reshape(*x.shape, q)

    def _rates(self, x: Array) -> Rate:
        x = self._checked(x)
        flat = np.ascontiguousarray(x.reshape(-1, self.state_size).T)
        r, c = self._single.rate(flat)
        return Rate(r.reshape(x.shape[:-1]), c.T.reshape(*x.shape[:-1], len(c)))

    def reward(self, x: Array) -> Array:
        """r(x), shape (...), without the control's cost."""
        return self._rates(x).reward

    def control_cost(self, x: Array) -> Array:
        """c(x), shape (..., q)."""
        return self._rates(x).cost

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) by one step of the learner's, u held."""
        x = self._checked(x)
        if not 0 < dt < math.inf:
            raise ValueError(f"dt must be positive and finite, got {dt!r}")
        p, q = self.state_size, len(self.control_limits)
        u = np.ascontiguousarray(np.broadcast_to(u, (*x.shape[:-1], q)).reshape(-1, q).T)
        return self._single.step(np.ascontiguousarray(x.reshape(-1, p).T), u, dt).T.reshape(x.shape)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """``count`` draws, shape (count, p)."""
        return self.states(drawn(self.model, self._draw, rng, count))

    def states(self, starts: Starts) -> Array:
        """x (count, p) of MuJoCo's coordinates."""
        return states(self.layout.coordinates, self.state_size, starts)

    def _choose(
        self, slope_at: Slope, x: Array, duration: float | None, memory: Memory | None = None
    ) -> Array:
        """Greedy u (..., q) at x (..., p), held for ``duration``, by default a control timestep; no ``memory``."""
        x = self._checked(x)
        flat = np.ascontiguousarray(x.reshape(-1, self.state_size).T)
        return self._single.control(slope_at, flat, duration).T.reshape(
            *x.shape[:-1], len(self.control_limits)
        )

    def ctrl(self, u: Array) -> Array:
        """MuJoCo's ctrl (..., nu) of controls u (..., q)."""
        ctrl = np.zeros((*u.shape[:-1], self.model.nu))
        ctrl[..., self._actuation.actuator] = self._actuation.middle + u
        return ctrl

    def place(self, data: Any, x: Array) -> None:
        """Set the state of ``data`` to x (p,)."""
        co = self.layout.coordinates
        data.qpos[:] = self._home
        data.qpos[co.scalar_qpos] = x[co.scalar_row]
        for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
            data.qpos[start : start + 4] = x[row : row + 4]
        data.qvel[co.velocity_dof] = x[co.velocity_row]
        data.act[:] = x[co.activation_row]

    def play(self, policy: Policy, duration: float) -> Iterator[tuple[Any, Any, float]]:
        """(model, data, control timestep) at each control of an episode from the first initial state of seed 0."""
        data = mujoco.MjData(self.model)
        start = drawn(self.model, self._draw, np.random.default_rng(0), 1)
        self.place(data, self.states(start)[0])
        dt = self.control_timestep
        for _ in range(round(duration / dt)):
            mujoco.mj_forward(self.model, data)
            yield self.model, data, dt
            x = self.states(Starts(data.qpos[None], data.qvel[None], start.goal, data.act[None]))[0]
            data.ctrl[:] = self.ctrl(policy(x))
            mujoco.mj_step(self.model, data, max(1, round(dt / self.model.opt.timestep)))

    def inputs(self, x: Tensor) -> Tensor:
        """cos and sin of angles that turn freely, the rest scaled to order one; (..., m)."""
        return self._encode(x if self.heading is None else heading.enter(self.heading, x))

    def _encode(self, x: Tensor) -> Tensor:
        """The inputs at the coordinates in which V is learned."""
        return encode(self.encoding, x)

    def form(self, kind: type[Form]) -> Form | None:
        """Batches of states by MuJoCo, and the control's cost."""
        if kind is BatchForm:
            batch = self.batch()
            return BatchForm(  # pyright: ignore[reportReturnType]
                self.encoding,
                batch.greedy_step,
                batch.greedy_act,
                batch.targets,
                batch.reward,
                None if self.heading is None else heading.batch_coordinates(self.heading),
            )
        if kind is CoordinatesForm and self.heading is not None:
            enter, leave = partial(heading.enter, self.heading), partial(heading.leave, self.heading)
            return CoordinatesForm(enter, leave, self._encode)  # pyright: ignore[reportReturnType]
        if kind is EpisodeForm:
            return EPISODE._replace(dt=self.control_timestep)  # pyright: ignore[reportReturnType]
        if kind is FilmForm:
            return FilmForm(self.play)  # pyright: ignore[reportReturnType]
        if kind is CostForm and self._cost is not None:
            return CostForm(self.control_cost)  # pyright: ignore[reportReturnType]
        if kind is HoldForm and self.held:
            return HoldForm(self._choose)  # pyright: ignore[reportReturnType]
        return None

    # What is found out about the model -----------------------------------------------------------------------------

    def _wanderings(self) -> Array:
        """States reached from initial states by random controls, held, within a second; (SAMPLE, p)."""
        rng = np.random.default_rng(0)
        x = self.initial_states(rng, SAMPLE)
        U = self.control_limits
        dt = min(self.control_timestep, 0.02)
        u = rng.uniform(-U, U, (SAMPLE, U.size))
        for k in range(round(SETTLING / dt)):
            if k % max(1, round(0.1 / dt)) == 0:
                u = rng.uniform(-U, U, (SAMPLE, U.size))
            later = self.step(x, u, dt)
            ok = np.isfinite(later).all(axis=1) & (np.abs(later).max(axis=1) < 1e4)
            x = np.where(ok[:, None], later, x)
        return x

    def _seen(self) -> Array:
        """Initial states, and states reached from them; (2 SAMPLE, p)."""
        return np.concatenate([self.initial_states(np.random.default_rng(0), SAMPLE), self._wanderings()])

    def _encoding(self, asked: Mapping[str, How], seen: Array) -> Encoding:
        rows = rows_asked_for(self.layout, asked)
        if self.heading is None:
            return encoding(self.layout, rows, (), seen)
        seen = heading.enter(self.heading, torch.from_numpy(seen)).numpy()
        return encoding(self.layout, rows, (self.heading.hinge,), seen)

    def _changes(self, x: Array) -> Array:
        """Drift and columns of the control matrix, (N, 1 + q, p)."""
        a, B = self.drift_and_control_matrix(x)
        return np.concatenate([a[:, None], B.transpose(0, 2, 1)], axis=1)

    def _same(self, x: Array, y: Array) -> bool:
        """Whether neither what moves the states x (N, p) nor their reward differs at the states y."""
        before, after = self._changes(x[::SPARSE]), self._changes(y[::SPARSE])
        if not (np.abs(after - before) < 1e-7 * (1 + np.abs(before))).all():
            return False
        return same_reward(self.rate, x, self.read(x), y, self.read(y))

    def _idle_heading(self, x: Array) -> heading.Heading | None:
        """What moves in a plane in which it makes no difference where it looks; None if nothing does."""
        angle = np.random.default_rng(2).uniform(-3, 3, len(x))
        for found in heading.headings(self.model, self.layout.coordinates):
            y = heading.turned(found, x, angle)
            if heading.turns_along(found, self._changes, x[::SPARSE], angle[::SPARSE]) and same_reward(
                self.rate, x, self.read(x), y, self.read(y)
            ):
                return found
        return None

    def _share_of_constrained(self, seen: Array) -> float:
        data, active = mujoco.MjData(self.model), 0
        for x in seen:
            self.place(data, x)
            mujoco.mj_forward(self.model, data)
            active += data.nefc > 0
        return active / len(seen)

    def constrained_share(self) -> float:
        """The share of states, drawn and reached by random controls, at which a constraint is active."""
        return self._constrained

    def caution(self) -> str | None:
        """One line, if a constraint is active at some of the states seen; None if none is. Learners warn with it."""
        share = self.constrained_share()
        if share == 0:
            return None
        return (
            f"{self.name}: constraints (contacts, joint limits, equalities, dry friction) are active at "
            f"{100 * share:.0f} % of the states seen; there the model is not smooth, gradients may mislead, and the "
            f"control matrix is that without them"
        )


def _declares_friction(model: Any) -> bool:
    names = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TUPLE, k) or "" for k in range(model.ntuple))
    return any(name.endswith(FRICTION_TUPLE) for name in names)
