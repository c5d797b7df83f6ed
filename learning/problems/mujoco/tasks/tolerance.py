"""dm_control's ``rewards.tolerance`` in torch, differentiable inside and outside its bounds."""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

__all__ = ["Sigmoid", "tolerance"]

Sigmoid = Literal["gaussian", "long_tail", "quadratic"]


def tolerance(
    x: Tensor,
    bounds: tuple[float, float] = (0.0, 0.0),
    margin: float = 0.0,
    sigmoid: Sigmoid = "gaussian",
    value_at_margin: float = 0.1,
) -> Tensor:
    """1 where x is in ``bounds``; outside it falls to ``value_at_margin`` at a distance of ``margin``, or to 0 at once.

    As in dm_control/utils/rewards.py (Tassa et al. 2018, arXiv:1801.00690).
    """
    low, high = bounds
    inside = (low <= x) & (x <= high)
    if margin == 0:
        return inside.to(x.dtype)
    d = torch.where(x < low, low - x, x - high) / margin
    if sigmoid == "gaussian":
        value = torch.exp(math.log(value_at_margin) * d**2)
    elif sigmoid == "long_tail":
        value = 1 / ((1 / value_at_margin - 1) * d**2 + 1)
    else:
        value = torch.clamp(1 - (1 - value_at_margin) * d**2, min=0.0)
    return torch.where(inside, torch.ones_like(x), value)
