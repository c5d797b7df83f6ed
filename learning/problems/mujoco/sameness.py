"""Whether a change of the state makes no difference to the reward.

That a reward is the same before and after the change at all states that are tried does not say so: one that is 0 but
near a goal is the same nearly everywhere. It must not read what changes, or have a slope along it where it is the same.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["reads", "same_reward"]

Array = NDArray[np.float64]
Rate = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]

TOLERANCE = 1e-7
"""Relative to 1 and more: what is further apart differs."""


def same_reward(rate: Rate, x: Array, values: Array, y: Array, others: Array) -> bool:
    """Whether r and c are the same at the states y (N, p) as at x, and some state would show it if they were not.

    Parameters
    ----------
    rate : callable
        (states (N, p), their readings (N, r)) -> r (N,), c (N, q).
    values, others : array, shape (N, r)
        The readings at x and at y.
    """
    state, read = (torch.from_numpy(one).clone().requires_grad_() for one in (x, values))
    before = _together(rate, state, read)
    with torch.no_grad():
        after = _together(rate, torch.from_numpy(y), torch.from_numpy(others))
    size = 1 + before.detach().abs()
    if not bool(((after - before.detach()).abs() < TOLERANCE * size).all()):
        return False
    steps = y - x, others - values
    rows, readings = (_where(step, at) for step, at in zip(steps, (x, values), strict=True))
    if not reads(rate, x, values, rows, readings):
        return True
    return before.requires_grad and _would_show(before, (state, read), steps, size)


def _where(step: Array, at: Array) -> NDArray[np.bool_]:
    """The columns in which ``step`` is no rounding error."""
    return np.any(np.abs(step) > 1e-9 * (1 + np.abs(at)), axis=0)


def _would_show(
    before: Tensor, inputs: tuple[Tensor, Tensor], steps: tuple[Array, Array], size: Tensor
) -> bool:
    """Whether at some state the slope along what changes is steep enough for the change to be seen, by itself."""
    for k in range(before.shape[1]):
        slopes = torch.autograd.grad(before[:, k].sum(), inputs, retain_graph=True, allow_unused=True)
        for slope, step in zip(slopes, steps, strict=True):
            if slope is None:
                continue
            if bool((slope.mul(torch.from_numpy(step)).abs() > 10 * TOLERANCE * size[:, [k]]).any()):
                return True
    return False


def reads(rate: Rate, x: Array, values: Array, rows: NDArray[np.bool_], readings: NDArray[np.bool_]) -> bool:
    """Whether r or c depends in any way on these rows of the state, or on these readings: what is no number spreads."""
    x, values = x.copy(), values.copy()
    x[:, rows], values[:, readings] = np.nan, np.nan
    with torch.no_grad():
        return not bool(torch.isfinite(_together(rate, torch.from_numpy(x), torch.from_numpy(values))).all())


def _together(rate: Rate, x: Tensor, values: Tensor) -> Tensor:
    """r and c, (N, 1 + q)."""
    r, c = rate(x, values)
    return torch.cat([r[:, None], c], dim=1)
