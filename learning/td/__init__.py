"""Continuous TD(lambda), sections 2 and 3."""
