"""Learning of value gradients as a run sees it: settings of learner and network, the learner, its policy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.method import TRIAL_SECONDS, Along
from swimmer_mj.learning.networks.networks import Cascade, DType, Multilayer, Sigmoid, ValueNetwork
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import TrialsForm, episode_of
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.settings import require_choices, require_units
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

__all__ = ["ValueGradientLearning", "ValueGradients"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ValueGradients:
    """Learn V and dV/dx along trajectories (:mod:`swimmer_mj.learning.value_gradient.equations`)."""

    settings: ValueGradientSettings = field(default_factory=ValueGradientSettings)
    layers: tuple[int, ...] | None = (64, 64)
    """Units of each hidden layer; None: a cascade."""
    neurons: int = 60
    """Of the cascade, the output counted."""
    dtype: DType = "float32"
    sigmoid: Sigmoid = "tanh"
    engine: Literal["auto", "compiled", "torch"] = "auto"
    device: Literal["cpu", "cuda"] = "cpu"
    """Where torch computes."""

    s_gamma: ClassVar[float] = 0.5
    """Shortness factor with which a swimmer was found to learn fastest, 1/s; docs/beyond.md."""
    evaluate_every: ClassVar[int] = 1000
    label: ClassVar[str] = "value gradient"

    def __post_init__(self) -> None:
        require_choices(self)
        require_units("neurons", self.neurons, 2)
        for units in self.layers or ():
            require_units("layers", units, 1)
        if self.layers is not None and self.sigmoid != "tanh":
            raise ValueError(f"layers are of tanh units: sigmoid must be 'tanh', got {self.sigmoid!r}")

    @classmethod
    def from_options(
        cls,
        s_lambda: float = 1.0,
        neurons: int | None = None,
        dtype: DType = "float32",
        engine: Literal["auto", "compiled", "torch"] = "auto",
        device: Literal["cpu", "cuda"] = "cpu",
    ) -> Self:
        """The method by the options of the command line; with ``neurons``, a cascade."""
        settings = ValueGradientSettings(s_lambda=s_lambda)
        if neurons is None:
            return cls(settings, dtype=dtype, engine=engine, device=device)
        return cls(settings, None, neurons, dtype, engine=engine, device=device)

    def network(self, problem: ControlProblem, seed: int) -> ValueNetwork:
        """The network with its initial weights, on the CPU."""
        generator = torch.Generator().manual_seed(seed)
        dtype = getattr(torch, self.dtype)
        if self.layers is not None:
            return Multilayer(problem.n_inputs, self.layers, generator=generator, dtype=dtype)
        return Cascade(problem.n_inputs, self.neurons, generator=generator, dtype=dtype, sigmoid=self.sigmoid)

    def start(self, problem: ControlProblem, seed: int) -> ValueGradientLearning:
        """A learner of ``problem``."""
        if self.device == "cuda" and not torch.cuda.is_available():
            raise ValueError("device 'cuda': torch finds no CUDA device here; learn with device 'cpu'")
        if problem.form(TrialsForm) is not None:
            raise ValueError(
                f"value gradients need the equations themselves, and {problem.name!r} is to be learned in its "
                "environment (physics 'mujoco'); use physics 'analytic'"
            )
        return ValueGradientLearning(self, problem, seed)

    def policy(self, problem: ControlProblem, tensors: Mapping[str, Tensor]) -> GreedyPolicy[ValueNetwork]:
        """The greedy policy of the weights."""
        network = self.network(problem, 0)
        network.load_state_dict({name: tensors[name] for name in network.state_dict()})
        return GreedyPolicy(problem, network)


class ValueGradientLearning:
    """A learner; see :class:`swimmer_mj.learning.method.Learning`. What acts is the average of its weights."""

    def __init__(self, method: ValueGradients, problem: ControlProblem, seed: int) -> None:
        self.network = method.network(problem, seed).to(method.device)
        self.learner = ValueGradientLearner(
            problem, self.network, method.settings, seed=seed, engine=method.engine
        )
        self.trials = 0

    def learn(self, trials: int) -> Along:
        """Rounds until so many trials' worth of time more is simulated; mean V along the last one."""
        value = math.nan
        self.trials += trials
        dt = self.learner.settings.dt
        while self.learner.simulation_steps * dt < self.trials * TRIAL_SECONDS * (1 - 1e-12):
            value = self.learner.step().value
        return Along(value, math.nan)

    def judge(self, states: Array) -> tuple[Array, Array]:
        """V and H at ``states``."""
        judged = self.learner.policy().judge(states)
        return judged.value, judged.hamiltonian

    def rewards(self, states: Array, duration: float, skip: float) -> Array:
        """Mean reward of greedy episodes."""
        return self.learner.rollout(states, duration, skip, episode_of(self.learner.problem).dt)

    def result(self) -> dict[str, Tensor]:
        """The averaged weights."""
        return self.learner.averaged_network().state_dict()

    def tensors(self) -> dict[str, Tensor]:
        """The averaged weights under their own names, and the learner's tensors."""
        own = {f"learner.{name}": tensor for name, tensor in self.learner.state_dict()["tensors"].items()}
        return {**self.result(), **own}

    def info(self) -> dict[str, Any]:
        """The learner's counters and generator."""
        return {"learner": self.learner.state_dict()["info"], "trial": self.trials}

    def reseed(self, seed: int) -> None:
        """Other initial states, flips and minibatches from here on."""
        self.learner.reseed(seed)

    def restore(self, tensors: Mapping[str, Tensor], info: Mapping[str, Any]) -> None:
        """Go on from what was saved."""
        own = {name: tensors[f"learner.{name}"] for name in self.learner.state_dict()["tensors"]}
        self.learner.load_state_dict({"tensors": own, "info": info["learner"]})
        self.trials = info["trial"]
