"""Learning the value gradient."""
