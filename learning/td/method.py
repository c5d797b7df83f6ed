"""Continuous TD(lambda) as a run sees it: settings, a learner with one of four engines, teams of learners.

The engines are equal but for rounding: one compiled learner, one of a pack of them, one whose network is compiled and
whose problem is not, or the readable reference.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.method import Along
from swimmer_mj.learning.networks.networks import Cascade, DType, Sigmoid
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import Learner, Moment, TrialsForm, episode_of
from swimmer_mj.learning.problems.problem import (
    ControlProblem,
    episode_shares,
    is_by_euler,
    require_euler,
)
from swimmer_mj.learning.problems.settings import require_choices, require_units
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.fused import FusedTD, obstacle
from swimmer_mj.learning.td.population import LANES, PopulationTD
from swimmer_mj.learning.td.stepped import SteppedTD
from swimmer_mj.learning.td.vario_eta import VarioEta

__all__ = ["ETA", "PAPER_NEURONS", "TDLearning", "TDTeam", "TemporalDifferences"]

Array = NDArray[np.float64]

PAPER_NEURONS = 60
ETA = 0.16
"""Learning rate: the best of a sweep with 5 links (docs/what-decides.md); the paper's is 0.01."""
VARIO_ETA = 0.0003
"""With vario-eta: the best of another sweep (docs/reproduction.md, rates at length)."""
MANY = 4
"""Seeds above which a pack is faster than one learner after the other."""


@dataclass(frozen=True)
class TemporalDifferences:
    """Learn by continuous TD(lambda), the paper's method."""

    settings: TDSettings = field(default_factory=lambda: TDSettings(eta=ETA))
    neurons: int = PAPER_NEURONS
    """Of the cascade, the output counted."""
    dtype: DType = "float32"
    sigmoid: Sigmoid = "tanh"
    engine: Literal["auto", "fused", "population", "stepped", "torch"] = "auto"
    """"auto" is "fused" where the problem is compiled and stepped by Euler's method, and its controls are free and of
    the instant, else "stepped"."""

    evaluate_every: ClassVar[int] = 2000
    label: ClassVar[str] = "TD(λ)"

    def __post_init__(self) -> None:
        require_choices(self)
        require_units("neurons", self.neurons, 2)

    @classmethod
    def from_options(
        cls,
        eta: float | None = None,
        s_lambda: float = 1.0,
        vario_eta: bool = False,
        neurons: int = PAPER_NEURONS,
        dtype: DType = "float32",
        engine: Literal["auto", "fused", "population", "stepped", "torch"] = "auto",
    ) -> Self:
        """The method by the options of the command line."""
        settings = TDSettings(
            eta=eta if eta is not None else VARIO_ETA if vario_eta else ETA,
            s_lambda=s_lambda,
            output_scaling=not vario_eta,
            vario=VarioEta() if vario_eta else None,
        )
        return cls(settings, neurons, dtype, engine=engine)

    def network(self, problem: ControlProblem, seed: int) -> Cascade:
        """The network with its initial weights."""
        generator = torch.Generator().manual_seed(seed)
        dtype = getattr(torch, self.dtype)
        return Cascade(problem.n_inputs, self.neurons, generator=generator, dtype=dtype, sigmoid=self.sigmoid)

    def start(self, problem: ControlProblem, seed: int) -> TDLearning:
        """A learner of ``problem``."""
        return TDLearning(self, problem, seed)

    def policy(self, problem: ControlProblem, tensors: Mapping[str, Tensor]) -> GreedyPolicy[Cascade]:
        """The greedy policy of the weights."""
        network = self.network(problem, 0)
        network.load_state_dict({name: tensors[name] for name in network.state_dict()})
        return GreedyPolicy(problem, network)

    # Teams -------------------------------------------------------------------------------------------------------

    team_size: ClassVar[int] = LANES

    def team_key(self, problem: ControlProblem) -> Hashable | None:
        """Problem, network, time, and whether each weight has a rate of its own, with engine "population".

        A pack with such rates is another kernel, of other rounding: what a run computes must not depend on the others.
        """
        if self.engine != "population":
            return None
        time = TDSettings(dt=self.settings.dt, trial_duration=self.settings.trial_duration)
        return problem, dataclasses.replace(self, settings=time), self.settings.vario is not None

    def team(self, learners: Sequence[TDLearning]) -> TDTeam:
        """A pack."""
        return TDTeam(learners)

    def for_seeds(self, problem: ControlProblem, count: int) -> Self:
        """Engine "population" for more than a few compiled learners."""
        if self.engine != "auto" or count <= MANY:
            return self
        compiled = obstacle(problem) is None and problem.form(TrialsForm) is None and is_by_euler(problem)
        return dataclasses.replace(self, engine="population") if compiled else self


class TDLearning:
    """A learner, by one of the engines; see :class:`swimmer_mj.learning.method.Learning`."""

    def __init__(self, method: TemporalDifferences, problem: ControlProblem, seed: int) -> None:
        settings = method.settings
        self.method = method
        self.problem = problem
        self.network = method.network(problem, seed)
        self.rng = np.random.default_rng(seed)
        self.trials = 0
        self.environment = problem.form(TrialsForm)
        why = obstacle(problem)
        compiled = why is None
        as_problem_steps = self.environment is not None or is_by_euler(problem)
        auto = "fused" if compiled and as_problem_steps else "stepped"
        engine = method.engine if method.engine != "auto" else auto
        if self.environment is not None and engine == "population":
            raise ValueError(
                f"engine 'population' learns on compiled equations, and {problem.name!r} is to be learned in its "
                "environment (physics 'mujoco'); use engine 'fused'"
            )
        if self.environment is not None and engine == "fused" and settings.vario is not None:
            raise ValueError("vario-eta in an environment (physics 'mujoco') needs engine 'stepped'")
        if engine in ("fused", "population"):
            if not compiled:
                raise ValueError(
                    f"engine {engine!r} cannot learn {problem.name!r}, which {why}; use engine 'stepped'"
                )
            if not as_problem_steps:
                require_euler(problem)
        self.fused = FusedTD(problem, self.network, settings) if compiled else None
        one_by_one = {"stepped": SteppedTD, "torch": ContinuousTD}.get(engine)
        self.by_steps = None if one_by_one is None else one_by_one(problem, self.network, settings)
        if self.environment is not None:  # which says now what it cannot step
            self._learn_in(self.environment, np.empty((0, problem.state_size)))

    def learn(self, trials: int) -> Along:
        """``trials`` trials from random states."""
        states = self.draw(trials)
        value, squared_hamiltonian = self._learn(states)
        self.trials += trials
        self.require_finite(states, value)
        return Along(float(value.mean()), float(squared_hamiltonian.mean()))

    def draw(self, trials: int) -> Array:
        """Initial states, (trials, p), one after the other: in which portions they are drawn changes nothing."""
        return np.concatenate([self.problem.initial_states(self.rng, 1) for _ in range(trials)])

    def _learn(self, states: Array) -> tuple[Array, Array]:
        """A trial from each of ``states``: means of V and H^2 along each."""
        if self.by_steps is None and self.environment is None:
            assert self.fused is not None  # engine "fused" or "population"
            statistics = self.fused.train(states)
            return statistics.value, statistics.squared_hamiltonian
        if self.environment is not None:
            moments = self._learn_in(self.environment, states)
        else:
            assert self.by_steps is not None
            moments = [moment for x in states for moment in self.by_steps.run_trial(x)]
        values = np.array([moment.value for moment in moments]).reshape(len(states), -1)
        hamiltonians = np.array([moment.hamiltonian for moment in moments]).reshape(len(states), -1)
        return values.mean(axis=1), (hamiltonians**2).mean(axis=1)

    def _learn_in(self, environment: TrialsForm, states: Array) -> Sequence[Moment]:
        """A trial from each of ``states``."""
        learner: Learner | None = self.fused if self.by_steps is None else self.by_steps
        assert learner is not None
        settings = self.method.settings
        return environment.learn(learner, states, settings.trial_duration, settings.dt)

    def require_finite(self, states: Array, value: Array) -> None:
        """Raise FloatingPointError if learning diverged in the last trials; where they began, and mean V of each."""
        if torch.isfinite(self.network.weight).all():
            return
        k = int(
            np.argmin(np.append(np.isfinite(value[:-1]), False))
        )  # the first that is not finite, else the last
        x = np.array2string(states[k], precision=3, separator=", ", max_line_width=10**6)
        raise FloatingPointError(
            f"weights are no longer finite after trial {self.trials - len(states) + k + 1:,}, which began at x = {x}: "
            f"eta {self.method.settings.eta} is too large"
        )

    def judge(self, states: Array) -> tuple[Array, Array]:
        """V and H at ``states``."""
        if self.fused is None:
            _, V, H = GreedyPolicy(self.problem, self.network).judge(states)
            return V, H
        sample = self.fused.sample(states)
        return sample.value, sample.hamiltonian

    def rewards(self, states: Array, duration: float, skip: float) -> Array:
        """Mean reward of greedy episodes, on the compiled equations where there are any."""
        dt = episode_of(self.problem).dt
        if self.fused is None:
            shares = episode_shares(duration, skip, dt)
            return GreedyPolicy(self.problem, self.network).episodes(states, shares, dt)
        return self.fused.rollout(states, duration, skip, dt).reward

    def result(self) -> dict[str, Tensor]:
        """The network's weights."""
        return self.network.state_dict()

    def tensors(self) -> dict[str, Tensor]:
        """Weights, and variances and rates of vario-eta."""
        if self.by_steps is not None:
            variance, rate = self.by_steps.variances[0], self.by_steps.rates[0]
        else:
            assert self.fused is not None
            variance, rate = self.fused.variance, self.fused.rate
        return {"weight": self.network.weight.data, "variance": variance, "rate": rate}

    def info(self) -> dict[str, Any]:
        """The state of the generator of initial states."""
        return {"rng": self.rng.bit_generator.state, "trial": self.trials}

    def reseed(self, seed: int) -> None:
        """Other initial states from here on."""
        self.rng = np.random.default_rng(seed)

    def restore(self, tensors: Mapping[str, Tensor], info: Mapping[str, Any]) -> None:
        """Go on from what was saved."""
        for name, tensor in self.tensors().items():
            tensor.copy_(tensors[name])
        self.rng.bit_generator.state = info["rng"]
        self.trials = info["trial"]


class TDTeam:
    """Learners in the lanes of a pack."""

    def __init__(self, learners: Sequence[TDLearning]) -> None:
        self.learners = list(learners)
        self.population = PopulationTD([one.fused for one in learners if one.fused is not None])

    def learn(self, trials: int) -> list[Along | FloatingPointError]:
        """``trials`` trials of each."""
        states = [one.draw(trials) for one in self.learners]
        statistics = self.population.train(np.stack(states, axis=1))
        news: list[Along | FloatingPointError] = []
        for lane, one in enumerate(self.learners):
            one.trials += trials
            try:
                V, H2 = statistics.value[:, lane], statistics.squared_hamiltonian[:, lane]
                one.require_finite(states[lane], V)
                news.append(Along(float(V.mean()), float(H2.mean())))
            except FloatingPointError as error:
                news.append(error)
        return news
