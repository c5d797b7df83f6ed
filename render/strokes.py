"""The strokes of a gait: how long it takes until a swimmer moves as before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.trajectory import Trajectory

__all__ = ["NoStrokeError", "Stroke", "joint_angles", "last_stroke", "steady_part"]

Array = NDArray[np.float64]

SHORTEST = 0.2
"""Of the strokes that are looked for, s."""
SETTLING = 1 / 3
"""How much of the time since the last turn is left out."""
ALIKE = 0.5
"""The largest :attr:`Stroke.mismatch`: what differs more does not repeat."""
STILL = 0.02
"""A swimmer whose joints deviate from their mean angles by less than this, rad, does not stroke."""


class NoStrokeError(ValueError):
    """Nothing repeats; the message says where, and what to do."""


@dataclass(frozen=True)
class Stroke:
    """States first .. last of a trajectory: one stroke."""

    first: int
    last: int
    duration: float
    """s."""
    mismatch: float
    """How far poses are from those a stroke before: 0 where the gait is periodic, 1 where they are unrelated."""


def joint_angles(trajectory: Trajectory) -> tuple[Array, Array]:
    """theta_{i+1} - theta_i and its rate, both of shape (T + 1, n - 1), rad and rad/s; links may turn several times."""
    state = st.split(trajectory.states, trajectory.parameters.n_links)
    return np.diff(state.angles, axis=-1), np.diff(state.angular_velocities, axis=-1)


def steady_part(trajectory: Trajectory) -> slice:
    """The states since the longest time with one target direction began, less its first third."""
    turns = np.flatnonzero(np.diff(trajectory.target_directions)) + 1
    edges = np.array([0, *turns, trajectory.n_steps + 1])
    longest = int(np.argmax(np.diff(edges)))
    first, end = int(edges[longest]), int(edges[longest + 1])
    return slice(first + round(SETTLING * (end - first)), end)


def last_stroke(trajectory: Trajectory) -> Stroke:
    """The last stroke of :func:`steady_part`.

    A stroke is the shortest time after which the joint angles are closest to what they were: a local minimum of the
    mismatch, at most a tenth above the lowest.

    Raises
    ------
    NoStrokeError
        Nothing repeats: fewer than two strokes, or a motion without any.
    """
    part = steady_part(trajectory)
    if trajectory.parameters.n_links < 2 or part.stop - part.start < 4:
        raise NoStrokeError(f"no stroke repeats in {trajectory.duration:g} s; draw a longer episode")
    times = trajectory.times[part]
    dt = float(np.diff(times).mean())
    lags = np.arange(max(1, round(SHORTEST / dt)), len(times) // 2 + 1)
    mismatch = _mismatch(joint_angles(trajectory)[0][part], lags)
    before, here, after = mismatch[:-2], mismatch[1:-1], mismatch[2:]
    minima = 1 + np.flatnonzero((here <= before) & (here < after) & (here <= ALIKE))
    if not minima.size:
        raise NoStrokeError(
            f"no stroke of {SHORTEST:g} s or more repeats in the steady {times[-1] - times[0]:.3g} s of the episode; "
            "draw a longer one, or a policy that swims"
        )
    bound = 1.1 * mismatch[minima].min() + 0.02
    chosen = int(minima[np.flatnonzero(mismatch[minima] <= bound)[0]])
    last = part.stop - 1
    return Stroke(last - int(lags[chosen]), last, float(lags[chosen] * dt), float(mismatch[chosen]))


def _mismatch(angles: Array, lags: NDArray[np.int_]) -> Array:
    """How far joint angles (times, n - 1) are from those some steps before, shape (lags,).

    The root mean square distance of their points on the unit circle, over what it is where they are unrelated.
    """
    points = np.stack([np.cos(angles), np.sin(angles)])
    unrelated = np.sqrt(2 * points.var(axis=1).mean())
    if unrelated < STILL:
        return np.full(len(lags), np.inf)
    apart = (np.sqrt(((points[:, lag:] - points[:, :-lag]) ** 2).mean()) for lag in lags.tolist())
    return np.array([*apart]) / unrelated
