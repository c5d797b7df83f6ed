"""The pendulum swing-up of Doya (2000), in all its forms."""

from swimmer_mj.learning.problems.pendulum.pendulum import Pendulum

__all__ = ["Pendulum"]
