"""The cart-pole swing-up of Doya (2000), as torch functions."""
