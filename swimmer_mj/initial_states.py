"""The law of the initial states of an episode."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st

__all__ = ["InitialLaw", "random_initial_state"]

InitialLaw = Literal["moderate", "rest", "fast", "straight", "gliding"]

MAX_ANGULAR_VELOCITY = 1.0
"""rad/s. The paper says no more than "random"; this and the next bound are ours (chosen)."""

MAX_VELOCITY = 0.3
"""m/s, of each component of the velocity of the centre of mass."""

MAX_GLIDE = 5.0
"""m/s, along x, of a chain that glides; beyond what has been seen of any learner."""


def random_initial_state(
    rng: np.random.Generator | np.random.RandomState,
    n_links: int,
    size: int | None = None,
    law: InitialLaw = "moderate",
) -> NDArray[np.float64]:
    """Reduced states with independent, uniformly distributed components, drawn one state after the other.

    Angles lie in [-pi, pi], angular velocities in [-1, 1] rad/s, and both components of the velocity of the
    centre of mass in [-0.3, 0.3] m/s. The paper's trials start "from random states"; the law is ours. The other laws
    are there to see how much it matters to learning.

    Parameters
    ----------
    rng : numpy.random.Generator or numpy.random.RandomState
        Source of random numbers.
    n_links : int
        Number of links n.
    size : int, optional
        How many states.
    law : {"moderate", "rest", "fast", "straight", "gliding"}
        As above, without any velocity, with bounds of velocities three times as large, or at rest with all links within
        0.5 rad of one direction. "gliding": half of all states, at random, are as above; the others are almost
        straight, head or tail first, within 0.4 rad of the x axis and each link within 0.3 rad of that, and move along
        x with up to 5 m/s.

    Returns
    -------
    ndarray, shape (2n + 2,) or (size, 2n + 2)
        See :mod:`swimmer_mj.state`.
    """
    pace = {"moderate": 1.0, "rest": 0.0, "fast": 3.0, "straight": 0.0, "gliding": 1.0}.get(law)
    if pace is None:
        raise ValueError(f"law must be one of {', '.join(map(repr, get_args(InitialLaw)))}, got {law!r}")
    n = n_links
    bound = st.join_reduced(
        np.full(n, 0.5 if law == "straight" else np.pi),
        np.full(n, pace * MAX_ANGULAR_VELOCITY),
        np.full(2, pace * MAX_VELOCITY),
    )
    if law == "straight":
        bound = np.append(bound, np.pi)  # of the common direction
    if law == "gliding":
        bound = np.append(
            bound, [1.0, 1.0, 0.4, MAX_GLIDE]
        )  # whether; tail first or not; direction; velocity
    states = rng.uniform(-bound, bound, size=bound.shape if size is None else (size, *bound.shape))
    states, more = states[..., : 2 * n + 2].copy(), states[..., 2 * n + 2 :]
    if law == "straight":
        states[..., :n] += more
    if law == "gliding":
        glides, tail_first, direction, velocity = np.moveaxis(more, -1, 0)[..., None]
        common = direction + np.where(tail_first > 0, np.pi, 0.0)
        states[..., :n] = np.where(glides > 0, common + states[..., :n] * (0.3 / np.pi), states[..., :n])
        states[..., 2 * n :] = np.where(glides > 0, np.abs(velocity) * [1.0, 0.0], states[..., 2 * n :])
    return states
