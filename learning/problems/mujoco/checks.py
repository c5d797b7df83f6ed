"""What is asked of the functions and numbers that a problem of a MuJoCo model is made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["require_functions", "require_rates", "require_whole_steps"]


def require_whole_steps(control_timestep: float, timestep: float) -> None:
    """ValueError unless a control is held for a whole number of the model's own steps."""
    steps = control_timestep / timestep
    if not (0 < steps < math.inf and round(steps) >= 1 and abs(steps - round(steps)) < 1e-6 * steps):
        raise ValueError(
            f"control_timestep must be a whole number of the model's steps of {timestep:g} s, got {control_timestep!r}"
        )


def require_functions(asked: Mapping[str, object]) -> None:
    """ValueError unless each, by what it is for, is a function."""
    for name, function in asked.items():
        if not callable(function):
            raise ValueError(f"{name} must be a function of a Scene, got {function!r}")


def require_rates(
    rate: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]], x: NDArray, values: NDArray, n_controls: int
) -> None:
    """ValueError unless r and c are as they should be at the states x (N, p), whose readings are ``values`` (N, r)."""
    try:
        r, c = rate(torch.from_numpy(x), torch.from_numpy(values))
    except ValueError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())
        raise ValueError(f"reward_rate or control_cost fails at {len(x)} states: {said}") from error
    for name, value, shape in (("reward_rate", r, x.shape[:1]), ("control_cost", c, (len(x), n_controls))):
        if not isinstance(value, Tensor):
            raise ValueError(
                f"{name} must return a tensor of shape {shape} at {len(x)} states, got {type(value).__name__}"
            )
        if tuple(value.shape) != shape:
            raise ValueError(f"{name} must have shape {shape} at {len(x)} states, got {tuple(value.shape)}")
        if not bool(torch.isfinite(value).all()):
            raise ValueError(f"{name} is not finite at an initial state")
    if bool((c < 0).any()):
        raise ValueError(f"control_cost must not be negative, got {float(c.min())}")
