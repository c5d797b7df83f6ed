"""A network with one hidden layer as a cascade that lacks connections, so that the fused kernel can learn it.

A cascade whose hidden neurons hear the inputs and the bias only, and whose output hears the bias and the hidden
neurons only, is a network with one hidden layer. The missing connections have weight 0 and rate 0, and so stay 0.
"""

from __future__ import annotations

import torch

from swimmer_mj.learning.networks.networks import Cascade

__all__ = ["Layered"]


class Layered(Cascade):
    """One layer of tanh units and a linear output: n_hidden (n_inputs + 2) + 1 weights.

    Parameters
    ----------
    n_inputs : int
        m.
    n_hidden : int
        Hidden units; with 3 inputs, 13 make the 66 weights of figure 1.
    generator : torch.Generator, optional
        Source of the initial weights: hidden N(0, 1 / (m + 1)), output 0.
    dtype : torch.dtype
        float32 or float64.
    """

    def __init__(
        self,
        n_inputs: int,
        n_hidden: int = 13,
        *,
        generator: torch.Generator | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if n_hidden < 1:
            raise ValueError(f"n_hidden must be at least 1, got {n_hidden}")
        super().__init__(n_inputs, n_hidden + 1, generator=generator, dtype=torch.float64)
        fan_in = self.connected.sum(dim=1, keepdim=True)
        connected = torch.zeros_like(self.connected)
        connected[:-1, : n_inputs + 1] = True
        connected[-1, n_inputs:] = True
        weight = self.weight.data * (fan_in / (n_inputs + 1)).sqrt()
        self.connected = connected
        self.weight.data = torch.where(connected, weight, torch.zeros_like(weight)).to(dtype)

    @property
    def n_weights(self) -> int:
        """Weights that there are."""
        return int(self.connected.sum())
