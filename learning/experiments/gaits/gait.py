"""A periodic gait: states at the nodes of one stroke, and the torques that are held between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.files import replacing
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["BEST", "GLIDE", "Gait", "crossing_shares", "load_gaits", "mean_power", "pulled", "save_gaits"]

Array = NDArray[np.float64]

BEST = Path(__file__).parent / "best"
"""The best known gaits: a file a number of links."""
GLIDE = 1e-4
"""m/s²: what swims against no more does not swim, it glides."""
SAMPLES = 8
"""Of an interval, where a stroke is looked at closely."""


def pulled(parameters: SwimmerParameters, pull: float) -> Array:
    """What a pull (m/s²) along -x adds to dx/dt: every point is accelerated alike; shape (2n + 4,)."""
    added = np.zeros(st.full_size(parameters.n_links))
    st.split(added, parameters.n_links).velocity[0] = -pull
    return added


@dataclass(frozen=True)
class Gait:
    """One stroke of N equal intervals."""

    parameters: SwimmerParameters
    duration: float
    """T, s."""
    states: Array
    """Reduced states z_0 .. z_{N-1} at the beginning of each interval, shape (N, 2n + 2)."""
    controls: Array
    """u_0 .. u_{N-1}, N·m, shape (N, n - 1)."""
    turns: Array
    """Whole turns of each link in a stroke, shape (n,)."""
    pull: float = 0.0
    """The swimmer is pulled back, along -x, by this force per mass, m/s²."""

    @property
    def n_intervals(self) -> int:
        """N."""
        return len(self.states)

    def closed_states(self) -> Array:
        """z_0 .. z_N, shape (N + 1, 2n + 2): z_N is z_0 after the turns."""
        end = self.states[0].copy()
        end[: self.parameters.n_links] += 2 * np.pi * self.turns
        return np.concatenate([self.states, end[None]])

    def resampled(self, n_intervals: int) -> Gait:
        """Its states and torques at the nodes of another number of intervals."""
        if n_intervals == self.n_intervals:
            return self
        old, new = np.arange(self.n_intervals + 1.0), np.arange(n_intervals) * self.n_intervals / n_intervals
        states = np.stack([np.interp(new, old, column) for column in self.closed_states().T], axis=1)
        controls = self.controls[new.astype(int)]
        return Gait(self.parameters, self.duration, states, controls, self.turns, self.pull)

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Full states inside the intervals by DOP853 on A.3, from each node with the centre of mass at the origin.

        Shapes (N, SAMPLES + 1, 2n + 4); and the defects, where each ends against the next node, (N, 2n + 2).
        """
        p, h = self.parameters, self.duration / self.n_intervals
        swimmer, back = AnalyticSwimmer(p), pulled(p, self.pull)
        x = np.empty((self.n_intervals, SAMPLES + 1, st.full_size(p.n_links)))
        for k, (z, u) in enumerate(zip(self.states, self.controls, strict=True)):
            solved = solve_ivp(
                lambda _, y, u=u: swimmer.derivative(y, u) + back,
                (0, h),
                st.expand(p, z),
                method="DOP853",
                t_eval=np.linspace(0, h, SAMPLES + 1),
                rtol=1e-10,
                atol=1e-10,
            )
            x[k] = solved.y.T
        return x, st.reduce(p, x[:, -1]) - self.closed_states()[1:]

    @cached_property
    def speed(self) -> float:
        """Mean velocity of the centre of mass along x, m/s, by :attr:`fine`."""
        path = st.center_of_mass(self.parameters, self.fine[0][:, [0, -1]])
        return float((path[:, 1, 0] - path[:, 0, 0]).sum() / self.duration)


def mean_power(gait: Gait) -> tuple[float, float]:
    """Mean power of the torques, and of what they do where that is positive, W (motors that win nothing back)."""
    n = gait.parameters.n_links
    rates = np.diff(st.split(gait.fine[0], n).angular_velocities, axis=-1)  # of the joints
    power = gait.controls[:, None] * rates
    return tuple(float(np.trapezoid(p.sum(axis=-1), axis=1).mean() / SAMPLES) for p in (power, power.clip(0)))  # type: ignore[return-value]


def crossing_shares(gait: Gait) -> dict[tuple[int, int], float]:
    """The share of the stroke in which two links cross, for those that ever do; links are counted from 1."""
    joints = st.joint_positions(gait.parameters, gait.fine[0][:, :-1])
    starts, ends = joints[..., :-1, :], joints[..., 1:, :]

    def side(i: int, points: Array) -> Array:
        """On which side of link i points are."""
        along, to = ends[..., i, :] - starts[..., i, :], points - starts[..., i, :]
        return along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]

    shares = {}
    n = gait.parameters.n_links
    for i in range(n):
        for j in range(i + 2, n):  # neighbours share a joint
            apart = side(i, starts[..., j, :]) * side(i, ends[..., j, :])
            across = side(j, starts[..., i, :]) * side(j, ends[..., i, :])
            if (share := float(((apart < 0) & (across < 0)).mean())) > 0:
                shares[i + 1, j + 1] = share
    return shares


def save_gaits(gaits: dict[float, Gait], path: Path) -> None:
    """Write gaits of one swimmer of the paper's parameters, by their mean speed, m/s."""
    arrays = {}
    for speed, gait in sorted(gaits.items()):
        for name in ("duration", "states", "controls", "turns", "pull"):
            arrays[f"{speed:g} {name}"] = getattr(gait, name)
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_gaits(path: Path) -> dict[float, Gait]:
    """Gaits by their mean speed, as :func:`save_gaits` wrote them; none if there is no file."""
    if not path.exists():
        return {}
    with np.load(path, allow_pickle=False) as data:
        found = {}
        for speed in dict.fromkeys(name.split()[0] for name in data.files):
            states, controls, turns = (data[f"{speed} {name}"] for name in ("states", "controls", "turns"))
            duration, pull = float(data[f"{speed} duration"]), float(data[f"{speed} pull"])
            parameters = SwimmerParameters(n_links=len(turns))
            found[float(speed)] = Gait(parameters, duration, states, controls, turns, pull)
    return found
