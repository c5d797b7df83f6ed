"""Value networks V_w: the paper's fully connected cascade, and a plain multilayer network beside it.

Both map inputs of shape (..., m) to values of shape (...), have tanh hidden units (a sigmoid; which one is open in
the paper) and a linear output. Hidden weights start as N(0, 1 / fan-in), output weights as 0, so that V = 0
everywhere at first (chosen).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

__all__ = ["Cascade", "DType", "Multilayer", "Sigmoid", "ValueNetwork"]

DType = Literal["float32", "float64"]
Sigmoid = Literal["tanh", "logistic"]


class ValueNetwork(nn.Module):
    """What learners rely on: a module from inputs to values that knows the learning rate of each weight."""

    n_inputs: int

    def learning_rates(self, eta: float, output_scaling: bool = True) -> list[Tensor]:
        """Learning rate of each weight, one tensor per parameter, in the order of ``parameters()``.

        Section 3.3: weights of the linear output unit have eta / sqrt(n), n being the number of neurons.
        """
        raise NotImplementedError


def _require_positive(value: int, name: str) -> None:
    if value < 1:
        raise ValueError(f"{name} must be at least 1, got {value}")


class Cascade(ValueNetwork):
    """Fully connected cascade: each neuron hears all inputs, the bias and all neurons before it (section 4).

    Row i of ``weight`` has the weights of neuron i: from the m inputs, from the bias, from neurons 0 .. i - 1; the
    rest of the row is zero and stays so. The last neuron is the linear output.

    Parameters
    ----------
    n_inputs : int
        m.
    n_neurons : int
        n, the output counted; the paper has 60.
    generator : torch.Generator, optional
        Source of the initial weights.
    dtype : torch.dtype
        float32 or float64.
    sigmoid : {"tanh", "logistic"}
        Of the hidden neurons.
    """

    def __init__(
        self,
        n_inputs: int,
        n_neurons: int = 60,
        *,
        generator: torch.Generator | None = None,
        dtype: torch.dtype = torch.float32,
        sigmoid: Literal["tanh", "logistic"] = "tanh",
    ) -> None:
        super().__init__()
        _require_positive(n_inputs, "n_inputs")
        _require_positive(n_neurons, "n_neurons")
        if sigmoid not in ("tanh", "logistic"):
            raise ValueError(f"sigmoid must be 'tanh' or 'logistic', got {sigmoid!r}")
        self.sigmoid = sigmoid
        self.n_inputs = n_inputs
        self.n_neurons = n_neurons
        sources = n_inputs + 1 + n_neurons - 1
        fan_in = n_inputs + 1 + torch.arange(n_neurons)[:, None]
        connected = torch.arange(sources)[None, :] < fan_in
        weight = torch.randn(n_neurons, sources, generator=generator, dtype=torch.float64)
        weight = torch.where(connected, weight / fan_in.sqrt(), torch.zeros_like(weight))
        weight[-1] = 0.0
        self.connected: Tensor
        self.register_buffer("connected", connected, persistent=False)
        self.weight = nn.Parameter(weight.to(dtype))

    def forward(self, z: Tensor) -> Tensor:
        """V, shape (...), of inputs ``z``, shape (..., m)."""
        first = self.n_inputs + 1
        fire = torch.tanh if self.sigmoid == "tanh" else torch.sigmoid
        columns = self.weight.T
        activation = z @ columns[: self.n_inputs] + columns[self.n_inputs]  # of all neurons, as far as heard
        for i in range(self.n_neurons - 1):
            y = fire(activation[..., i : i + 1])
            activation = activation + y * columns[first + i]
        return activation[..., -1]

    def learning_rates(self, eta: float, output_scaling: bool = True) -> list[Tensor]:
        """As in :class:`ValueNetwork`; zero where there is no connection."""
        rates = eta * self.connected.to(self.weight.dtype)
        if output_scaling:
            rates[-1] /= self.n_neurons**0.5
        return [rates]


class Multilayer(ValueNetwork):
    """Layers of tanh units, each fully connected to the next.

    Parameters
    ----------
    n_inputs : int
        m.
    hidden : sequence of int
        Units in each hidden layer.
    generator, dtype
        As for :class:`Cascade`.
    """

    def __init__(
        self,
        n_inputs: int,
        hidden: Sequence[int] = (64, 64),
        *,
        generator: torch.Generator | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        _require_positive(n_inputs, "n_inputs")
        for width in hidden:
            _require_positive(width, "each hidden layer's width")
        self.n_inputs = n_inputs
        self.n_neurons = sum(hidden) + 1
        widths = [n_inputs, *hidden, 1]
        self.layers = nn.ModuleList(nn.Linear(a, b, dtype=dtype) for a, b in pairwise(widths))
        for layer in self.layers:
            assert isinstance(layer, nn.Linear)
            spread = 0.0 if layer is self.layers[-1] else (layer.in_features + 1) ** -0.5
            for parameter in layer.parameters():
                draw = torch.randn(parameter.shape, generator=generator, dtype=torch.float64)
                parameter.data.copy_(spread * draw)

    def forward(self, z: Tensor) -> Tensor:
        """V, shape (...), of inputs ``z``, shape (..., m)."""
        for layer in self.layers[:-1]:
            z = torch.tanh(layer(z))
        return self.layers[-1](z)[..., 0]

    def learning_rates(self, eta: float, output_scaling: bool = True) -> list[Tensor]:
        """As in :class:`ValueNetwork`."""
        output = set(self.layers[-1].parameters())
        scale = self.n_neurons**-0.5 if output_scaling else 1.0
        return [torch.full_like(w, eta * scale if w in output else eta) for w in self.parameters()]
