"""The pendulum swing-up of Doya (2000), in all its forms."""
