"""What the values of options must be, said before anything is computed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

__all__ = ["check_directory", "check_seed", "trust_modules"]


def check_seed(seed: int) -> None:
    """Raise ValueError unless ``seed`` can be the value of ``--seed``."""
    if seed < 0:
        raise ValueError(f"--seed must not be negative, got {seed}")
    if seed >= 2**63:
        raise ValueError(f"--seed must be less than 2**63, got {seed}")


def check_directory(path: Path) -> None:
    """Raise ValueError unless ``path`` can be the directory of ``--out``, or be made; nothing is made."""
    if "\0" in str(path):
        raise ValueError("--out must be a path, got one with a zero byte")
    there = path.absolute()
    try:
        while not there.exists():
            there = there.parent
    except OSError as error:
        raise ValueError(
            f"--out cannot be {str(path)[:80]}: {error.strerror}; choose another directory"
        ) from None
    if not there.is_dir():
        raise NotADirectoryError(f"{there} is a file; choose another directory with --out")
    unwritable = not os.access(there, os.W_OK | os.X_OK) or there.as_posix().split("/")[1:2] in (
        ["proc"],
        ["sys"],
    )
    if unwritable:
        raise PermissionError(
            f"--out cannot be {path}: {there} is not to be written to; choose another directory"
        )


def trust_modules(modules: Sequence[str]) -> None:
    """Import the modules of ``--trust``."""
    if modules:
        from swimmer_mj.learning.runs.registry import trust

        trust(modules)
