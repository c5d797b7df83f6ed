"""How logs were made: beside them stands ``made.csv``, with the command and the versions, a row for each way.

A log's rows have their seeds, or the command has them; what a command does not set is as the code of that version has
it. Where a version is empty, the log is older than this table.
"""

from __future__ import annotations

import csv
import os
import platform
import shlex
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["COLUMNS", "MADE", "command_line", "note_made", "ways"]

MADE = "made.csv"
PACKAGES = ("swimmer-mj", "mujoco", "numpy", "torch", "numba")
COLUMNS = ("log", "command", "python", *PACKAGES)
WHERE = ("--out", "--log", "--logs", "--picture")
"""Options that say where to write, not what."""


def command_line(argv: Sequence[str]) -> str:
    """The command of a process without the folders in it, but for ``benchmarks/``, and without where it wrote."""
    program, *arguments = argv
    kept: list[str] = []
    for before, argument in zip(("", *arguments), arguments, strict=False):
        if before not in WHERE and argument.split("=")[0] not in WHERE:
            kept.append(argument)
    path = Path(program)
    start = ["python", f"benchmarks/{path.name}"] if path.suffix == ".py" else [path.name]
    return shlex.join([*start, *kept])


def note_made(log: str | os.PathLike[str], command: str | None = None) -> None:
    """Add to ``made.csv`` beside ``log`` that this process made it, or made it longer, unless that is there already."""
    path = Path(log)
    row = [path.name, command or command_line(sys.argv), platform.python_version(), *map(_version, PACKAGES)]
    made = path.parent / MADE
    if row in _rows(made):
        return
    with made.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        writer.writerow(row)


def ways(folder: str | os.PathLike[str]) -> dict[str, list[dict[str, str]]]:
    """By log, how it was made."""
    found: dict[str, list[dict[str, str]]] = {}
    for row in _rows(Path(folder) / MADE)[1:]:
        found.setdefault(row[0], []).append(dict(zip(COLUMNS, row, strict=True)))
    return found


def _rows(path: Path) -> list[list[str]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
