"""Linear value functions, the paper's foil: V_w(x) = w . phi(x) with features on a grid over the state space.

- :class:`RadialBasis`: normalised Gaussian functions, as in Doya (2000), doi:10.1162/089976600300015961. V is smooth,
  and equation 2 applies as it stands.
- :class:`TileCoding`: several displaced grids of boxes (Sutton 1996, the paper's reference 19). V is piecewise constant
  and dV/dx is 0 almost everywhere, so that equation 2 does not apply as it stands. Chosen: H by the finite difference
  (V(x(t + dt)) - V(x(t))) / dt, which is the discrete TD error; and, for the greedy control, the slope of V
  averaged over an interval along each axis, which is exactly (V(x + h e_i) - V(x - h e_i)) / 2h, 2h its width.

Both have as many features as the grid has cells: exponential in the number of state variables.

:class:`LinearTD` is the learner of equation 2 for them, compiled: the same order of updates as
:class:`~swimmer_mj.learning.td.continuous_td.ContinuousTD`, with dV/dw = phi.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_steps, require_euler
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import (
    Rollouts,
    SampleStatistics,
    TrialStatistics,
)

__all__ = ["Axis", "CompiledFeatures", "Features", "LinearTD", "RadialBasis", "TileCoding"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class CompiledFeatures(NamedTuple):
    """Features as numba functions. ``scratch`` is theirs to write, of shape (size,)."""

    constants: Any
    """First argument of each function."""
    value: Callable[..., float]
    """(constants, x, w, scratch): V = w . phi(x)."""
    slope: Callable[..., None]
    """(constants, x, w, dVdx, scratch): fill dVdx (p,), for H and the greedy control."""
    add: Callable[..., None]
    """(constants, x, gain, e, scratch): e += gain phi(x)."""


class Features(Protocol):
    """phi, N functions of the state."""

    @property
    def size(self) -> int:
        """N."""
        ...

    @property
    def smooth(self) -> bool:
        """Whether ``slope`` is dV/dx, so that H may be computed with it."""
        ...

    @property
    def n_axes(self) -> int:
        """p."""
        ...

    def compile(self) -> CompiledFeatures:
        """phi for the learner."""
        ...


@dataclass(frozen=True)
class Axis:
    """Range and resolution of one state variable, in its unit."""

    low: float
    high: float
    count: int
    """Centres or tiles."""
    periodic: bool = False
    """Whether ``high`` is ``low`` again, as for an angle."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"low must be below high and both finite, got {self.low!r} and {self.high!r}")
        if self.count < 2:
            raise ValueError(f"count must be at least 2, got {self.count}")

    @property
    def spacing(self) -> float:
        """Distance between centres: count intervals around a circle, count - 1 along a line."""
        return (self.high - self.low) / (self.count if self.periodic else self.count - 1)


def _require_axes(axes: Sequence[Axis]) -> None:
    if not axes:
        raise ValueError("axes must have at least one axis, got none")


class _Grid(NamedTuple):
    low: Array  # (p,)
    spacing: Array  # (p,)
    wavenumber: Array  # 2 pi / period, 0 where not periodic (p,)
    counts: Indices  # (p,)
    width: float  # of a Gaussian, in spacings


@dataclass(frozen=True)
class RadialBasis:
    """Normalised Gaussians on a product grid: phi_k = a_k / sum_l a_l, a_k = exp(-|(x - c_k) / sigma|^2 / 2).

    On a periodic axis, |x - c|^2 / 2 is replaced by (1 - cos(kappa (x - c))) / kappa^2, kappa = 2 pi / period:
    the same near c, and smooth around the circle. The sum over a product grid factorises, and so phi is a product of
    functions that are normalised on each axis. Beyond the ends of an axis phi is constant in the limit.
    """

    axes: tuple[Axis, ...]
    width: float = 1.0
    """sigma in grid spacings (chosen)."""

    smooth = True

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        if not (math.isfinite(self.width) and self.width > 0):
            raise ValueError(f"width must be positive and finite, got {self.width!r}")

    @property
    def size(self) -> int:
        """Number of centres."""
        return math.prod(axis.count for axis in self.axes)

    @property
    def n_axes(self) -> int:
        """p."""
        return len(self.axes)

    def compile(self) -> CompiledFeatures:
        """phi for the learner."""
        periods = [2 * math.pi / (axis.high - axis.low) if axis.periodic else 0.0 for axis in self.axes]
        grid = _Grid(
            np.array([axis.low for axis in self.axes]),
            np.array([axis.spacing for axis in self.axes]),
            np.array(periods),
            np.array([axis.count for axis in self.axes]),
            self.width,
        )
        return CompiledFeatures(grid, *_radial_functions())


class _Tiles(NamedTuple):
    low: Array  # (p,)
    spacing: Array  # width of a tile (p,)
    periodic: NDArray[np.bool_]  # (p,)
    counts: Indices  # tiles along each axis of one tiling (p,)
    displaced: Array  # fraction of a tile by which a tiling is displaced (n_tilings, p)
    tiling_size: int
    slope_width: float


@dataclass(frozen=True)
class TileCoding:
    """``n_tilings`` grids of boxes, each displaced by its own fraction of a tile; phi is 1 / n_tilings in a hit tile.

    Tiling t is displaced along axis i by ((2 i + 1) t mod n_tilings) / n_tilings of a tile (Sutton and Barto, the
    paper's reference 20: odd displacement vectors). A line axis has one tile more than its count, for the displaced
    grids to cover it; states beyond it count as at its end. No hashing.
    """

    axes: tuple[Axis, ...]
    n_tilings: int = 8
    slope_width: float = 1.0
    """Width of the interval over which V is averaged before its slope is taken, in tiles (chosen)."""

    smooth = False

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        if self.n_tilings < 1:
            raise ValueError(f"n_tilings must be at least 1, got {self.n_tilings}")
        if not (math.isfinite(self.slope_width) and self.slope_width > 0):
            raise ValueError(f"slope_width must be positive and finite, got {self.slope_width!r}")

    @property
    def _counts(self) -> list[int]:
        return [axis.count + (not axis.periodic) for axis in self.axes]

    @property
    def size(self) -> int:
        """Number of tiles in all tilings."""
        return self.n_tilings * math.prod(self._counts)

    @property
    def n_axes(self) -> int:
        """p."""
        return len(self.axes)

    def compile(self) -> CompiledFeatures:
        """phi for the learner."""
        t, i = np.mgrid[: self.n_tilings, : self.n_axes]
        tiles = _Tiles(
            np.array([axis.low for axis in self.axes]),
            np.array([(axis.high - axis.low) / axis.count for axis in self.axes]),
            np.array([axis.periodic for axis in self.axes]),
            np.array(self._counts),
            (2 * i + 1) * t % self.n_tilings / self.n_tilings,
            math.prod(self._counts),
            self.slope_width,
        )
        return CompiledFeatures(tiles, *_tile_functions())


_OPTIONS: dict[str, Any] = {
    "fastmath": {"contract", "nsz", "arcp", "reassoc"},  # sums may be reordered
    "error_model": "numpy",
    "nogil": True,
}
_INNER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True}  # called by compiled code only


@lru_cache(maxsize=1)
def _radial_functions() -> tuple[Any, Any, Any]:
    @njit(**_INNER)
    def on_axes(grid: _Grid, x: Array) -> tuple[Array, Array]:
        """phi of each axis by itself, and its derivative, each (p, largest count)."""
        shape = (x.size, grid.counts.max())
        phi, derivative = np.empty(shape), np.empty(shape)
        for i in range(x.size):
            count, kappa = grid.counts[i], grid.wavenumber[i]
            sigma = grid.width * grid.spacing[i]
            largest = -np.inf
            for j in range(count):
                d = x[i] - (grid.low[i] + grid.spacing[i] * j)
                if kappa > 0:
                    phi[i, j] = -(1 - math.cos(kappa * d)) / (kappa * sigma) ** 2
                    derivative[i, j] = -math.sin(kappa * d) / (kappa * sigma**2)  # d log a / dx
                else:
                    phi[i, j] = -0.5 * (d / sigma) ** 2
                    derivative[i, j] = -d / sigma**2
                largest = max(largest, phi[i, j])
            total = mean = 0.0
            for j in range(count):
                phi[i, j] = math.exp(phi[i, j] - largest)
                total += phi[i, j]
                mean += phi[i, j] * derivative[i, j]
            mean /= total
            for j in range(count):  # d phi_j = phi_j (g_j - sum_l phi_l g_l), g = d log a / dx
                phi[i, j] /= total
                derivative[i, j] = phi[i, j] * (derivative[i, j] - mean)
        return phi, derivative

    @njit(**_INNER)
    def product(grid: _Grid, phi: Array, derivative: Array, derived: int, out: Array) -> int:
        """The product over all axes (N,), differentiated along ``derived`` (-1: none), into ``out``; returns N."""
        out[0] = 1.0
        size = 1
        for i in range(grid.counts.size):
            axis = derivative[i] if i == derived else phi[i]
            count = grid.counts[i]
            for k in range(size - 1, -1, -1):
                before = out[k]
                for j in range(count):
                    out[k * count + j] = before * axis[j]
            size *= count
        return size

    @njit(**_INNER)
    def dot(w: Array, phi: Array, size: int) -> float:
        total = 0.0
        for k in range(size):
            total += w[k] * phi[k]
        return total

    @njit(**_OPTIONS)
    def value(grid: _Grid, x: Array, w: Array, scratch: Array) -> float:
        phi, derivative = on_axes(grid, x)
        return dot(w, scratch, product(grid, phi, derivative, -1, scratch))

    @njit(**_OPTIONS)
    def slope(grid: _Grid, x: Array, w: Array, dVdx: Array, scratch: Array) -> None:
        phi, derivative = on_axes(grid, x)
        for i in range(x.size):
            dVdx[i] = dot(w, scratch, product(grid, phi, derivative, i, scratch))

    @njit(**_OPTIONS)
    def add(grid: _Grid, x: Array, gain: float, e: Array, scratch: Array) -> None:
        phi, derivative = on_axes(grid, x)
        for k in range(product(grid, phi, derivative, -1, scratch)):
            e[k] += gain * scratch[k]

    return value, slope, add


@lru_cache(maxsize=1)
def _tile_functions() -> tuple[Any, Any, Any]:
    @njit(**_INNER)
    def tile(tiles: _Tiles, t: int, x: Array, moved: int, by: float) -> int:
        """Index of the tile of tiling t that x, moved along one axis, falls into."""
        index = 0
        for i in range(x.size):
            y = x[i] + by if i == moved else x[i]
            j = math.floor((y - tiles.low[i]) / tiles.spacing[i] + tiles.displaced[t, i])
            count = tiles.counts[i]
            j = j % count if tiles.periodic[i] else min(max(j, 0), count - 1)
            index = index * count + j
        return t * tiles.tiling_size + index

    @njit(**_INNER)
    def value_moved(tiles: _Tiles, x: Array, w: Array, moved: int, by: float) -> float:
        total = 0.0
        n_tilings = tiles.displaced.shape[0]
        for t in range(n_tilings):
            total += w[tile(tiles, t, x, moved, by)]
        return total / n_tilings

    @njit(**_OPTIONS)
    def value(tiles: _Tiles, x: Array, w: Array, scratch: Array) -> float:
        return value_moved(tiles, x, w, -1, 0.0)

    @njit(**_OPTIONS)
    def slope(tiles: _Tiles, x: Array, w: Array, dVdx: Array, scratch: Array) -> None:
        for i in range(x.size):
            h = 0.5 * tiles.slope_width * tiles.spacing[i]
            dVdx[i] = (value_moved(tiles, x, w, i, h) - value_moved(tiles, x, w, i, -h)) / (2 * h)

    @njit(**_OPTIONS)
    def add(tiles: _Tiles, x: Array, gain: float, e: Array, scratch: Array) -> None:
        n_tilings = tiles.displaced.shape[0]
        for t in range(n_tilings):
            e[tile(tiles, t, x, -1, 0.0)] += gain / n_tilings

    return value, slope, add


class _Kernel(NamedTuple):
    train: Callable[..., None]
    sample: Callable[..., None]
    rollout: Callable[..., None]


@lru_cache(maxsize=16)
def _compile(
    dynamics: Callable[..., None],
    reward: Callable[..., float],
    value: Callable[..., float],
    slope: Callable[..., None],
    add: Callable[..., None],
    by_difference: bool,
) -> _Kernel:
    @njit(**_INNER)
    def decide(limits: Array, dVdx: Array, a: Array, B: Array, f: Array, u: Array) -> float:
        """The greedy control u = U sign(B^T dV/dx) and f = a + B u; returns dV/dx . f."""
        p, q = B.shape
        for i in range(p):
            f[i] = a[i]
        for k in range(q):
            gain = 0.0
            for i in range(p):
                gain += B[i, k] * dVdx[i]
            u[k] = limits[k] if gain > 0 else (-limits[k] if gain < 0 else 0.0)
            for i in range(p):
                f[i] += u[k] * B[i, k]
        rate = 0.0
        for i in range(p):
            rate += dVdx[i] * f[i]
        return rate

    @njit(**_INNER)
    def judge(
        constants: Any,
        features: Any,
        limits: Array,
        w: Array,
        scratch: Array,
        x: Array,
        dt: float,
        s_gamma: float,
        f: Array,
    ) -> tuple[float, float, float]:
        """V, H and r at x; fills f."""
        p = x.size
        a, B, dVdx, u = np.empty(p), np.zeros((p, limits.size)), np.empty(p), np.empty(limits.size)
        dynamics(constants, x, a, B)
        r = reward(constants, x)
        V = value(features, x, w, scratch)
        slope(features, x, w, dVdx, scratch)
        V_dot = decide(limits, dVdx, a, B, f, u)
        if by_difference:
            V_dot = (value(features, x + dt * f, w, scratch) - V) / dt
        return V, r - s_gamma * V + V_dot, r

    @njit(**_OPTIONS)
    def train(
        constants: Any,
        features: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        dt: float,
        s_gamma: float,
        s_lambda: float,
        eta: float,
        w: Array,
        e: Array,
        scratch: Array,
        statistics: Array,
    ) -> None:
        """One trial from each initial state; ``statistics`` (trials, 3) gets the means of V, H^2 and r."""
        f = np.empty(initial_states.shape[1])
        decay = 1.0 - dt * (s_gamma + s_lambda)
        for trial in range(initial_states.shape[0]):
            e[:] = 0.0
            x = initial_states[trial].copy()
            statistics[trial] = 0.0
            for _ in range(n_steps):
                V, H, r = judge(constants, features, limits, w, scratch, x, dt, s_gamma, f)
                gain = dt * eta * H
                for k in range(w.size):
                    w[k] += gain * e[k]
                    e[k] *= decay
                add(features, x, dt, e, scratch)
                for i in range(x.size):
                    x[i] += dt * f[i]
                statistics[trial, 0] += V / n_steps
                statistics[trial, 1] += H * H / n_steps
                statistics[trial, 2] += r / n_steps

    @njit(**_OPTIONS)
    def sample(
        constants: Any,
        features: Any,
        limits: Array,
        states: Array,
        dt: float,
        s_gamma: float,
        w: Array,
        scratch: Array,
        out: Array,
    ) -> None:
        """V and H at each of ``states``, into ``out`` (states, 2)."""
        f = np.empty(states.shape[1])
        for k in range(states.shape[0]):
            V, H, _ = judge(constants, features, limits, w, scratch, states[k], dt, s_gamma, f)
            out[k, 0], out[k, 1] = V, H

    @njit(**_OPTIONS)
    def rollout(
        constants: Any,
        features: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        n_skip: int,
        dt: float,
        s_gamma: float,
        w: Array,
        scratch: Array,
        out: Array,
    ) -> None:
        """Greedy episodes by RK4, control held over each step; means and returns into ``out`` (episodes, 2)."""
        p, q = initial_states.shape[1], limits.size
        a, B, dVdx, f, u = np.empty(p), np.zeros((p, q)), np.empty(p), np.empty(p), np.empty(q)
        for episode in range(initial_states.shape[0]):
            x = initial_states[episode].copy()
            gain = discounted = 0.0
            for t in range(n_steps):
                slope(features, x, w, dVdx, scratch)
                start, increment = x.copy(), np.zeros(p)
                for stage in range(4):
                    dynamics(constants, x, a, B)
                    r = reward(constants, x)
                    if stage == 0:
                        decide(limits, dVdx, a, B, f, u)
                    else:
                        for i in range(p):
                            f[i] = a[i]
                            for k in range(q):
                                f[i] += B[i, k] * u[k]
                    share = (1.0 if stage in (0, 3) else 2.0) / 6.0
                    fraction = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of dt, of this stage
                    following = 1.0 if stage == 2 else 0.5  # of dt, of the next
                    discounted += share * dt * math.exp(-s_gamma * dt * (t + fraction)) * r
                    if t >= n_skip:
                        gain += share * r
                    for i in range(p):
                        increment[i] += share * f[i]
                        x[i] = start[i] + dt * (increment[i] if stage == 3 else following * f[i])
            out[episode, 0] = gain / (n_steps - n_skip)
            out[episode, 1] = discounted

    return _Kernel(train, sample, rollout)


class LinearTD:
    """The learner of equation 2 for V_w = w . phi, compiled, in float64.

    Parameters
    ----------
    problem : ControlProblem
        What to learn; must have a compiled form.
    features : Features
        phi, over the problem's state variables.
    settings : TDSettings, optional
        The algorithm's constants; ``output_scaling`` means nothing here and ``vario`` must be None.
    hamiltonian : "gradient" or "difference", optional
        H with dV/dx . f, or with (V(x(t + dt)) - V(x(t))) / dt; "gradient" by default where phi is smooth.
    """

    def __init__(
        self,
        problem: ControlProblem,
        features: Features,
        settings: TDSettings | None = None,
        hamiltonian: Literal["gradient", "difference"] | None = None,
    ) -> None:
        self.settings = settings = TDSettings() if settings is None else settings
        if settings.vario is not None:
            raise ValueError("LinearTD has one learning rate: settings.vario must be None")
        compiled = problem.form(CompiledForm)
        if compiled is None:
            raise ValueError(f"problem {problem.name!r} has no compiled form")
        if features.n_axes != problem.state_size:
            raise ValueError(
                f"{problem.name} has {problem.state_size} state variables, the features {features.n_axes}"
            )
        if hamiltonian is None:
            hamiltonian = "gradient" if features.smooth else "difference"
        if hamiltonian not in ("gradient", "difference"):
            raise ValueError(f"hamiltonian must be 'gradient' or 'difference', got {hamiltonian!r}")
        if hamiltonian == "gradient" and not features.smooth:
            raise ValueError("hamiltonian must be 'difference' where V is piecewise constant, got 'gradient'")
        self.problem = problem
        self.features = features
        self.hamiltonian = hamiltonian
        self.weight: Array = np.zeros(features.size)
        self.trace: Array = np.zeros(features.size)
        self._scratch: Array = np.zeros(features.size)
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        self._constants = compiled.constants
        self._phi = features.compile()
        self._kernel = _compile(
            compiled.dynamics,
            compiled.reward,
            self._phi.value,
            self._phi.slope,
            self._phi.add,
            hamiltonian == "difference",
        )

    def phi(self, x: Array) -> Array:
        """Features, shape (N,), at ``x``, shape (p,)."""
        out = np.zeros(self.features.size)
        self._phi.add(self._phi.constants, self._state(x), 1.0, out, self._scratch)
        return out

    def slope(self, x: Array) -> Array:
        """dV/dx, shape (p,), at ``x``, shape (p,); of the averaged V where the features are not smooth."""
        out = np.empty(self.features.n_axes)
        self._phi.slope(self._phi.constants, self._state(x), self.weight, out, self._scratch)
        return out

    def value(self, x: Array) -> float:
        """V at ``x``, shape (p,)."""
        return self._phi.value(self._phi.constants, self._state(x), self.weight, self._scratch)

    def _state(self, x: Array) -> Array:
        return as_states(np.asarray(x)[None], self.problem.state_size)[0]

    def train(self, initial_states: Array) -> TrialStatistics:
        """One trial from each of ``initial_states`` (trials, p), one after the other."""
        require_euler(self.problem)
        states = as_states(initial_states, self.problem.state_size)
        settings = self.settings
        statistics = np.empty((len(states), 3))
        self._kernel.train(
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            settings.steps_per_trial,
            settings.dt,
            self.problem.s_gamma,
            settings.s_lambda,
            settings.eta,
            self.weight,
            self.trace,
            self._scratch,
            statistics,
        )
        return TrialStatistics(*statistics.T)

    def sample(self, states: Array) -> SampleStatistics:
        """V and H at each of ``states`` (count, p); nothing is learned."""
        states = as_states(states, self.problem.state_size)
        out = np.empty((len(states), 2))
        self._kernel.sample(
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            self.settings.dt,
            self.problem.s_gamma,
            self.weight,
            self._scratch,
            out,
        )
        return SampleStatistics(*out.T)

    def rollout(
        self, initial_states: Array, duration: float, skip: float = 0.0, dt: float = 0.01
    ) -> Rollouts:
        """Greedy episodes of ``duration`` seconds by RK4 with the control held for ``dt``; nothing is learned."""
        states = as_states(initial_states, self.problem.state_size)
        n_steps, n_skip = episode_steps(duration, skip, dt)
        out = np.empty((len(states), 2))
        self._kernel.rollout(
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            n_steps,
            n_skip,
            dt,
            self.problem.s_gamma,
            self.weight,
            self._scratch,
            out,
        )
        return Rollouts(*out.T)
