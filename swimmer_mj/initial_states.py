"""The law of the initial states of an episode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st

__all__ = ["random_initial_state"]

MAX_ANGULAR_VELOCITY = 1.0
"""rad/s. The paper says no more than "random"; this and the next bound are ours (chosen)."""

MAX_VELOCITY = 0.3
"""m/s, of each component of the velocity of the centre of mass."""


def random_initial_state(
    rng: np.random.Generator | np.random.RandomState, n_links: int, size: int | None = None
) -> NDArray[np.float64]:
    """Reduced states with independent, uniformly distributed components.

    Angles lie in [-pi, pi], angular velocities in [-1, 1] rad/s, and both components of the velocity of the
    centre of mass in [-0.3, 0.3] m/s. The paper's trials start "from random states"; the law is ours.

    Parameters
    ----------
    rng : numpy.random.Generator or numpy.random.RandomState
        Source of random numbers.
    n_links : int
        Number of links n.
    size : int, optional
        How many states.

    Returns
    -------
    ndarray, shape (2n + 2,) or (size, 2n + 2)
        See :mod:`swimmer_mj.state`.
    """
    bound = st.join_reduced(
        np.full(n_links, np.pi), np.full(n_links, MAX_ANGULAR_VELOCITY), np.full(2, MAX_VELOCITY)
    )
    return rng.uniform(-bound, bound, size=bound.shape if size is None else (size, *bound.shape))
