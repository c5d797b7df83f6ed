"""The learner of this project with the hooks that its peers have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OursSettings:
    """Those of value gradients that are tuned; ``swimmer-mj train --coordinates joints --held`` has the defaults."""

    form: Literal["state, instant", "joints, held"] = "joints, held"
    """Of what V is learned, and for how long torques are chosen."""
    trajectories: int = 256
    steps: int = 25
    s_gamma: float = 0.5
    s_lambda: float = 1.0
    minibatch: int = 256
    passes: int = 1
    rate: float = 2e-3
    half_life: float = 500.0
    huber: float = 1.0
    hidden: int = 64
    engine: Literal["compiled", "torch"] = "compiled"


class Ours:
    """Value gradients."""

    hold = 1

    def __init__(self, problem: Swimming, settings: OursSettings, seed: int) -> None:
        if settings.form == "joints, held":
            problem = replace(problem, coordinates="joints", held=True)
        generator = torch.Generator().manual_seed(seed)
        network = Multilayer(problem.n_inputs, (settings.hidden,) * 2, generator=generator)
        chosen = ValueGradientSettings(
            trajectories=settings.trajectories,
            steps=settings.steps,
            s_lambda=settings.s_lambda,
            minibatch=settings.minibatch,
            passes=settings.passes,
            learning_rate=settings.rate,
            half_life=settings.half_life,
            huber=settings.huber,
        )
        self.learner = ValueGradientLearner(problem, network, chosen, seed=seed, engine=settings.engine)

    @property
    def simulation_steps(self) -> int:
        """Steps of 0.01 s."""
        return self.learner.simulation_steps

    @property
    def gradient_evaluations(self) -> int:
        """Each step is followed back once."""
        return self.learner.simulation_steps

    def policy(self) -> Callable[[Array], Array]:
        """Greedy, by the averaged weights: torques (N, q) at states (N, p)."""
        return self.learner.control

    def learn(self) -> None:
        """One round."""
        self.learner.step()
