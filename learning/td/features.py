"""Features on a grid over the state space, for linear value functions V_w(x) = w . phi(x).

- :class:`RadialBasis`: normalised Gaussian functions, as in Doya (2000), doi:10.1162/089976600300015961. V is smooth.
- :class:`TileCoding`: several displaced grids of boxes (Sutton 1996, the paper's reference 19). V is piecewise constant
  and dV/dx is 0 almost everywhere.

Both have as many features as the grid has cells: exponential in the number of state variables.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.learning.problems.settings import require_positive

__all__ = ["OPTIONS", "Axis", "CompiledFeatures", "Features", "RadialBasis", "TileCoding"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OPTIONS: dict[str, Any] = {
    "fastmath": {"contract", "nsz", "arcp", "reassoc"},  # sums may be reordered
    "error_model": "numpy",
    "nogil": True,
}


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
    n_hit: int
    """How many features are not 0 at a state, but 1 / n_hit, if they are few; 0: all may be anything."""
    hit: Callable[..., None]
    """(constants, x, which): fill ``which`` (n_hit,) with their numbers."""


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


@njit(**OPTIONS)
def _on_axes(grid: _Grid, x: Array) -> tuple[Array, Array]:
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


@njit(**OPTIONS)
def _product(grid: _Grid, phi: Array, derivative: Array, derived: int, out: Array) -> int:
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


@njit(**OPTIONS)
def _dot(w: Array, phi: Array, size: int) -> float:
    total = 0.0
    for k in range(size):
        total += w[k] * phi[k]
    return total


@njit(**OPTIONS)
def _radial_value(grid: _Grid, x: Array, w: Array, scratch: Array) -> float:
    phi, derivative = _on_axes(grid, x)
    return _dot(w, scratch, _product(grid, phi, derivative, -1, scratch))


@njit(**OPTIONS)
def _radial_slope(grid: _Grid, x: Array, w: Array, dVdx: Array, scratch: Array) -> None:
    phi, derivative = _on_axes(grid, x)
    for i in range(x.size):
        dVdx[i] = _dot(w, scratch, _product(grid, phi, derivative, i, scratch))


@njit(**OPTIONS)
def _radial_add(grid: _Grid, x: Array, gain: float, e: Array, scratch: Array) -> None:
    phi, derivative = _on_axes(grid, x)
    for k in range(_product(grid, phi, derivative, -1, scratch)):
        e[k] += gain * scratch[k]


@njit(**OPTIONS)
def _radial_hit(grid: _Grid, x: Array, which: Indices) -> None:
    """All are hit, which is not said one by one."""


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
        require_positive(self, "width")

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
        return CompiledFeatures(grid, _radial_value, _radial_slope, _radial_add, 0, _radial_hit)


class _Tiles(NamedTuple):
    low: Array  # (p,)
    spacing: Array  # width of a tile (p,)
    periodic: NDArray[np.bool_]  # (p,)
    counts: Indices  # tiles along each axis of one tiling (p,)
    displaced: Array  # fraction of a tile by which a tiling is displaced (n_tilings, p)
    tiling_size: int
    slope_width: float


@njit(**OPTIONS)
def _tile(tiles: _Tiles, t: int, x: Array, moved: int, by: float) -> int:
    """Index of the tile of tiling t that x, moved along one axis, falls into."""
    index = 0
    for i in range(x.size):
        y = x[i] + by if i == moved else x[i]
        j = math.floor((y - tiles.low[i]) / tiles.spacing[i] + tiles.displaced[t, i])
        count = tiles.counts[i]
        j = j % count if tiles.periodic[i] else min(max(j, 0), count - 1)
        index = index * count + j
    return t * tiles.tiling_size + index


@njit(**OPTIONS)
def _value_moved(tiles: _Tiles, x: Array, w: Array, moved: int, by: float) -> float:
    total = 0.0
    n_tilings = tiles.displaced.shape[0]
    for t in range(n_tilings):
        total += w[_tile(tiles, t, x, moved, by)]
    return total / n_tilings


@njit(**OPTIONS)
def _tile_value(tiles: _Tiles, x: Array, w: Array, scratch: Array) -> float:
    return _value_moved(tiles, x, w, -1, 0.0)


@njit(**OPTIONS)
def _tile_slope(tiles: _Tiles, x: Array, w: Array, dVdx: Array, scratch: Array) -> None:
    for i in range(x.size):
        h = 0.5 * tiles.slope_width * tiles.spacing[i]
        dVdx[i] = (_value_moved(tiles, x, w, i, h) - _value_moved(tiles, x, w, i, -h)) / (2 * h)


@njit(**OPTIONS)
def _tile_add(tiles: _Tiles, x: Array, gain: float, e: Array, scratch: Array) -> None:
    n_tilings = tiles.displaced.shape[0]
    for t in range(n_tilings):
        e[_tile(tiles, t, x, -1, 0.0)] += gain / n_tilings


@njit(**OPTIONS)
def _tile_hit(tiles: _Tiles, x: Array, which: Indices) -> None:
    for t in range(which.size):
        which[t] = _tile(tiles, t, x, -1, 0.0)


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
        require_positive(self, "slope_width")

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
        return CompiledFeatures(tiles, _tile_value, _tile_slope, _tile_add, self.n_tilings, _tile_hit)
