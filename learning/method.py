"""What a run has to know of a method: learn so much, judge, act, save, restore.

A method is a frozen dataclass whose fields are its settings; config.json keeps them. It starts learning of a problem,
and makes policies of what was learned. A method of one's own needs no more than :class:`Method` and :class:`Learning`
ask for; docs/extending.md has one.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.problem import ControlProblem

__all__ = ["TRIAL_SECONDS", "Along", "Learning", "Method", "Reseeded", "Team", "TeamMethod"]

Array = NDArray[np.float64]

TRIAL_SECONDS = 5.0
"""Simulated time that counts as a trial, for methods that know no trials, s: the paper's."""


class Along(NamedTuple):
    """Means along the trajectories of the last trials; nan where a method does not know them."""

    value: float
    """Mean of V."""
    squared_hamiltonian: float
    """Mean of H^2."""


class Learning(Protocol):
    """A learner at work on one problem, with one seed. The same seed gives the same bits, also after a resume."""

    def learn(self, trials: int) -> Along:
        """So many trials more; in which portions they are asked for changes nothing.

        FloatingPointError says that learning has diverged, where, and what to change.
        """
        ...

    def judge(self, states: Array) -> tuple[Array, Array]:
        """V and H, each (N,), at states (N, p), by the policy that :meth:`result` keeps."""
        ...

    def rewards(self, states: Array, duration: float, skip: float) -> Array:
        """Mean reward rate, (N,), of that policy's episodes of ``duration`` seconds after the first ``skip``.

        :func:`swimmer_mj.learning.problems.problem.episode_sums` computes it for any policy.
        """
        ...

    def result(self) -> Mapping[str, Tensor]:
        """What acts, as tensors that :meth:`Method.policy` understands."""
        ...

    def tensors(self) -> Mapping[str, Tensor]:
        """All tensors that resuming needs, those of :meth:`result` among them."""
        ...

    def info(self) -> dict[str, Any]:
        """What else resuming needs, as JSON values."""
        ...

    def restore(self, tensors: Mapping[str, Tensor], info: Mapping[str, Any]) -> None:
        """Go on from what was saved."""
        ...


@runtime_checkable
class Reseeded(Protocol):
    """A learner that can go on with other random numbers, as after a divergence it must."""

    def reseed(self, seed: int) -> None:
        """Draw from generators that begin with ``seed``; what was learned stays."""
        ...


class Method(Protocol):
    """A way to learn."""

    def start(self, problem: ControlProblem, seed: int) -> Learning:
        """A learner that has learned nothing yet; ValueError or TypeError if it cannot learn ``problem``."""
        ...

    def policy(self, problem: ControlProblem, tensors: Mapping[str, Tensor]) -> Policy:
        """The policy whose tensors :meth:`Learning.result` gave."""
        ...


class Team(Protocol):
    """Several learners that learn in step."""

    def learn(self, trials: int) -> list[Along | FloatingPointError]:
        """As :meth:`Learning.learn`, for each of them; what one computes does not depend on the others."""
        ...


@runtime_checkable
class TeamMethod(Protocol):
    """A method whose runs may learn in step, faster than one after the other."""

    def team_key(self, problem: ControlProblem) -> Hashable | None:
        """What runs must share to be in one team; None: this one learns alone."""
        ...

    @property
    def team_size(self) -> int:
        """The most learners in a team."""
        ...

    def team(self, learners: Sequence[Any]) -> Team:
        """A team of learners that :meth:`Method.start` gave."""
        ...

    def for_seeds(self, problem: ControlProblem, count: int) -> Any:
        """The method, with what suits ``count`` runs of it at a time where that was left open."""
        ...
