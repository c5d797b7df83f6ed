"""What the values of options must be, said before anything is computed."""

from __future__ import annotations

__all__ = ["check_seed"]


def check_seed(seed: int) -> None:
    """Raise ValueError unless ``seed`` can be the value of ``--seed``."""
    if seed < 0:
        raise ValueError(f"--seed must not be negative, got {seed}")
