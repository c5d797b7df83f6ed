"""The constants of learning by value gradients; the symbols are those of the equations."""

from __future__ import annotations

from dataclasses import dataclass

from swimmer_mj.learning.problems.settings import require_not_negative, require_positive

__all__ = ["ValueGradientSettings"]


MOST_STATES = 10_000_000
"""In a round, all of which are kept; more are taken for a slip."""


@dataclass(frozen=True)
class ValueGradientSettings:
    """What defines a learner, besides its problem and its network. What changing a default does: docs/beyond.md."""

    trajectories: int = 512
    """N, in parallel."""
    steps: int = 25
    """T, steps of each of them in a round."""
    dt: float = 0.01
    """Euler step, s."""
    trial_duration: float = 10.0
    """A trajectory starts anew after this long, s, rounded to whole rounds."""
    s_lambda: float = 1.0
    """Decay of what is looked ahead, 1/s: 0 trusts the trajectory to its end, infinity the next state's estimate."""
    value_weight: float = 1.0
    """Of (V - G)^2 in the loss."""
    slope_weight: float = 1.0
    """w, of the gradient's error in the loss."""
    huber: float | None = None
    """Errors of the gradient larger than this many times a round's mean one count by their size, not by its square, as
    in Huber's loss; None: all count by their square."""
    flips: float = 0.0
    """Probability that a control has its sign flipped for a step: exploration. None was better than some."""
    minibatch: int = 512
    """States in one step of Adam."""
    passes: int = 1
    """Over the states of a round; what is left after whole minibatches is left out."""
    learning_rate: float = 2e-3
    """Of Adam, in the first round."""
    half_life: float = 500.0
    """Rounds after which the learning rate is halved."""
    final_rate: float = 1e-5
    """Learning rate below which it does not fall."""
    clip: float = 1.0
    """Largest norm of a gradient step."""
    averaged_share: float = 0.1
    """The averaged weights, which are the result, are those of about this last share of all rounds."""

    def __post_init__(self) -> None:
        for name in ("trajectories", "steps", "minibatch", "passes"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise ValueError(f"{name} must be an integer of at least 1, got {value!r}")
        require_positive(self, "dt", "trial_duration", "learning_rate", "half_life", "final_rate", "clip")
        require_not_negative(self, "value_weight", "slope_weight")
        if self.huber is not None:
            require_positive(self, "huber")
        if not self.s_lambda >= 0:
            raise ValueError(f"s_lambda must not be negative, got {self.s_lambda!r}")
        if not 0 <= self.flips <= 0.5:
            raise ValueError(f"flips must be in [0, 0.5], got {self.flips!r}")
        if not 0 < self.averaged_share <= 1:
            raise ValueError(f"averaged_share must be in (0, 1], got {self.averaged_share!r}")
        if self.value_weight == self.slope_weight == 0:
            raise ValueError("value_weight and slope_weight must not both be 0")
        if self.steps * self.dt > self.trial_duration * (1 + 1e-9):
            raise ValueError(
                f"trial_duration must be at least steps x dt = {self.steps * self.dt:g} s, got {self.trial_duration}"
            )
        if self.trajectories * self.steps > MOST_STATES:
            raise ValueError(
                f"trajectories x steps must be at most {MOST_STATES:,}, got {self.trajectories * self.steps:,}"
            )
        if self.minibatch > self.trajectories * self.steps:
            raise ValueError(
                "minibatch must be at most trajectories x steps = "
                f"{self.trajectories * self.steps}, got {self.minibatch}"
            )

    @property
    def steps_per_round(self) -> int:
        """Simulation steps in a round."""
        return self.trajectories * self.steps

    def rate(self, round_number: int) -> float:
        """Adam's learning rate in a round, from 0 on."""
        return max(
            min(self.final_rate, self.learning_rate),
            self.learning_rate * 2 ** (-round_number / self.half_life),
        )
