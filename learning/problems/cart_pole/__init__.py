"""The cart-pole swing-up of Doya (2000), as torch functions."""

from swimmer_mj.learning.problems.cart_pole.cart_pole import CartPole

__all__ = ["CartPole"]
