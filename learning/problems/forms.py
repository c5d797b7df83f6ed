"""Other forms of a control problem, which it may offer by ``problem.form(KIND)``: what a learner asks for, and no type.

========================  ==========================================  ==================================================
form                      of what it is made                          who asks for it
========================  ==========================================  ==================================================
:class:`TorchForm`        torch functions of batches of states        value gradients, on any device
:class:`BatchForm`        compiled, batches of trajectories           value gradients on CPUs, fast episodes
:class:`CompiledForm`     compiled, one state                         TD(lambda): the fused kernel
:class:`LanesForm`        compiled, a state in each SIMD lane         TD(lambda): a pack of learners
:class:`CoordinatesForm`  other coordinates in which V is learned     value gradients
:class:`CostForm`         what controls cost                          greedy control, H
:class:`HoldForm`         what a held control leads to                greedy control
:class:`EnvironmentForm`  an environment in which it is judged        evaluation
:class:`EpisodeForm`      how long an episode is                      evaluation
:class:`FilmForm`         a MuJoCo model in motion                    pictures
:class:`SwimmerForm`      a swimmer in dm_control                     pictures, the viewer
:class:`TrialsForm`       an environment in which it is learned       TD(lambda) through MuJoCo
========================  ==========================================  ==================================================

Forms state the same problem, and tests hold them equal to its NumPy functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.problem import DT, EPISODE_DURATION, SETTLING_TIME, ControlProblem
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.trajectory import Trajectory

__all__ = [
    "EPISODE",
    "BatchCoordinates",
    "BatchForm",
    "BatchPolicy",
    "CompiledForm",
    "CoordinatesForm",
    "CostForm",
    "Encoding",
    "EnvironmentForm",
    "EpisodeForm",
    "FilmForm",
    "HoldForm",
    "Judgement",
    "LanesForm",
    "Learner",
    "Moment",
    "Policy",
    "Score",
    "SwimmerForm",
    "TorchForm",
    "TrialsForm",
    "episode_of",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Field = Callable[[Tensor], Tensor]


class TorchForm(NamedTuple):
    """dx/dt = a(x) + B(x) u and r(x) as torch functions, differentiable, so that Jacobians follow by themselves."""

    drift: Field
    """a: (N, p) -> (N, p)."""
    control_matrix: Field
    """B: (N, p) -> (N, p, q)."""
    reward_rate: Field
    """r: (N, p) -> (N,)."""


class CompiledForm(NamedTuple):
    """The problem as numba functions of one state.

    They write into the arrays that they are given and allocate nothing. ``z`` and ``dVdz`` have the learner's dtype,
    everything else is float64.
    """

    constants: Any
    """First argument of ``dynamics`` and ``reward``: whatever numba can take."""
    dynamics: Callable[..., None]
    """(constants, x, a, B): fill the drift a (p,) and the control matrix B (p, q), which starts as zeros."""
    reward: Callable[..., float]
    """(constants, x): r(x)."""
    inputs: Callable[..., None]
    """(x, z): fill the network's inputs z (m,)."""
    input_pullback: Callable[..., None]
    """(z, dVdz, dVdx): fill dVdx (p,) with (dz/dx)^T dVdz, given the inputs z at x."""


class LanesForm(NamedTuple):
    """The problem as numba functions of LANES states: number i of each stands at [i LANES, (i + 1) LANES)."""

    constants: Any
    greedy: Callable[..., None]
    """(constants, limits, x, dVdx, u, f, r): fill the greedy control u, f = a + B u and the reward r."""
    encode: Callable[..., None]
    """(constants, x, z, start): fill the inputs, ``z.flat[start:]``, in the learner's dtype."""
    pull_back: Callable[..., None]
    """(constants, z, start, dVdz, dVdx): fill dVdx with (dz/dx)^T dVdz."""


class Encoding(NamedTuple):
    """How a state is encoded: angles by cos and sin, the rest by a factor. All are arrays of indices but ``scale``."""

    angle: Indices
    """Where the angles stand in x."""
    cosine: Indices
    """Where their cosines stand in z."""
    sine: Indices
    """Where their sines stand in z."""
    linear: Indices
    """Where the rest stands in x."""
    scaled: Indices
    """Where it stands in z."""
    scale: Array
    """What it is multiplied by."""


class CoordinatesForm(NamedTuple):
    """Other coordinates y of the state, in which V is learned: dV/dy is what is compared with its target.

    They are torch functions, differentiable. The network's inputs are ``encode`` of ``enter``.
    """

    enter: Field
    """y of x, (..., p) -> (..., p)."""
    leave: Field
    """Its inverse."""
    encode: Field
    """z of y, (..., p) -> (..., m)."""


class BatchCoordinates(NamedTuple):
    """The same for N states at once, compiled."""

    enter: Callable[[Array, Array], None]
    """(x, y): fill y (p, N) at x (p, N)."""
    to_state: Callable[[Array, Array], None]
    """(x, slope): replace dV/dy (p, N) by dV/dx at x (p, N)."""
    from_state: Callable[[Array, NDArray[Any]], None]
    """(x, slope): replace dV/dx (T, p, N) by dV/dy at x (T, p, N)."""


class BatchForm(NamedTuple):
    """The problem for N trajectories at once, which stand on the last axis; N is a multiple of LANES.

    The functions work in buffers of their own: no two threads may use one form at the same time.
    """

    encoding: Encoding
    greedy_step: Callable[..., None]
    """(slope_at, x, dVdx, flips, dt, u, y, memory=None): greedy controls u (q, N) times ``flips``, and the states y
    (p, N) after an Euler step from x; y may be x. With dt = 0 only the controls are wanted, those of a policy. For
    controls that are chosen for where they lead, ``slope_at`` gives dV/dx elsewhere, and a
    :class:`~swimmer_mj.learning.problems.held.Memory` goes from step to step along the same trajectories."""
    greedy_rk4: Callable[..., None]
    """As ``greedy_step``, as exactly as episodes are stepped, with u held: by the classical Runge-Kutta method, or by
    the model's own steps of its own integrator. ``y`` may be x."""
    targets: Callable[..., None]
    """(x, u, V, dVdx, dt, s_gamma, s_lambda, out): g and G of :mod:`swimmer_mj.learning.value_gradient.equations`."""
    reward: Callable[[Array, Array], Array]
    """Of x (..., p, N) and u (..., q, N), what the control costs taken off: (..., N)."""
    coordinates: BatchCoordinates | None = None
    """Those in which V is learned, and which ``encoding`` is of; None: the state's own."""


class CostForm(NamedTuple):
    """Controls that cost: the reward rate is r(x) - sum_i c_i(x) u_i^2."""

    coefficients: Callable[[Array], Array]
    """c >= 0 at x: (..., p) -> (..., q)."""


class HoldForm(NamedTuple):
    """Controls that are chosen for the time for which they are held, not for the instant."""

    choose: Callable[..., Array]
    """(slope_at, x, duration, memory=None) -> u (..., q) at states x (..., p), held for ``duration`` in s, or for as
    long as a policy's if it is None; ``slope_at`` and ``memory`` as in a :class:`BatchForm`."""


class Moment(NamedTuple):
    """What a learner did at one state."""

    control: Array
    """u, shape (q,)."""
    value: float
    """V_w(x) before the update."""
    hamiltonian: float
    """H."""


class Learner(Protocol):
    """One step at a time; the caller moves the state."""

    def start_trial(self) -> None:
        """Zero traces."""
        ...

    def learn_at(self, x: Array) -> Moment:
        """Update weights and traces at the state ``x``, shape (p,)."""
        ...

    def end_trial(self) -> None:
        """Finish: the network's tensors are up to date."""
        ...


class Judgement(NamedTuple):
    """What is thought of states; leading axes are those of the states."""

    control: Array
    """u, shape (..., q)."""
    value: Array
    """V(x), shape (...)."""
    hamiltonian: Array
    """H(x), shape (...)."""


class Policy(Protocol):
    """pi: states (..., p) -> controls (..., q)."""

    @property
    def problem(self) -> ControlProblem:
        """Whose states and controls they are."""
        ...

    def __call__(self, x: Array) -> Array:
        """u at ``x``."""
        ...

    def judge(self, x: Array) -> Judgement:
        """What it thinks of ``x``."""
        ...

    def episodes(self, states: Array, shares: Array, dt: float) -> Array:
        """Sums (N,) over episodes from ``states`` (N, p) of the reward rates times ``shares`` (steps,), by RK4.

        :func:`swimmer_mj.learning.problems.problem.episode_sums` computes them for any policy.
        """
        ...


@runtime_checkable
class BatchPolicy(Policy, Protocol):
    """A policy with a faster way to act on batches."""

    def acting(self) -> Callable[[Array], Array]:
        """States (N, p) -> controls (N, q), as of now: what is learned later is not in it."""
        ...


class Score(NamedTuple):
    """What was measured of each episode."""

    measure: str
    """A word: "speed", "return"."""
    unit: str
    values: Array
    """Of each episode."""


class EnvironmentForm(NamedTuple):
    """The environment in which policies are judged, whatever they learned on."""

    measure: str
    """What a policy is judged by, a word: "speed", "return"."""
    unit: str
    starts: Callable[[int], Array]
    """The initial states of so many episodes of an evaluation, shape (count, p)."""
    evaluate: Callable[[Policy, int, int], Array]
    """(policy, n_episodes, workers): of each episode."""
    scores: Callable[[Policy, int, int], Sequence[Score]] | None = None
    """The same with all that is measured in one pass over the episodes, ``measure`` first; None if that is all."""


class EpisodeForm(NamedTuple):
    """The episodes over which rewards are averaged; without it, :data:`EPISODE`."""

    duration: float
    """s."""
    skip: float
    """How much of it is left out at the beginning, s."""
    dt: float
    """For how long a control is held, s."""


EPISODE = EpisodeForm(EPISODE_DURATION, SETTLING_TIME, DT)


def episode_of(problem: ControlProblem) -> EpisodeForm:
    """The episodes of an evaluation of ``problem``."""
    return problem.form(EpisodeForm) or EPISODE


class FilmForm(NamedTuple):
    """A MuJoCo model to be drawn."""

    play: Callable[[Policy, float], Iterator[tuple[Any, Any, float]]]
    """(policy, duration in s): MjModel, MjData and the control timestep (s), at each control of an episode."""


class SwimmerForm(NamedTuple):
    """A swimmer to be drawn and watched."""

    parameters: SwimmerParameters
    record: Callable[[Policy, float], Trajectory]
    """(policy, duration in s): an episode in dm_control."""


class TrialsForm(NamedTuple):
    """An environment to learn in, step by step, in place of the equations."""

    learn: Callable[[Learner, Array, float, float], Sequence[Moment]]
    """(learner, initial states (trials, p), trial duration in s, dt in s): a trial from each."""
