"""How logs were made: beside them stands ``made.csv``, with the command and the versions, a row for each way.

A log's rows have their seeds, or the command has them; what a command does not set is as the code of that commit has
it ("+": with changes that were not committed). A row from before commits were noted has the one that brought the log.
Where the version of a package is empty, the log is older than this table.
"""

from __future__ import annotations

import csv
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["COLUMNS", "MADE", "command_line", "commit", "note_made", "ways"]

MADE = "made.csv"
PACKAGES = ("swimmer-mj", "mujoco", "numpy", "torch", "numba")
COLUMNS = ("log", "command", "commit", "python", *PACKAGES)
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
    versions = platform.python_version(), *map(_version, PACKAGES)
    row = [path.name, command or command_line(sys.argv), commit(Path(__file__)), *versions]
    made = path.parent / MADE
    if row in _rows(made):
        return
    with made.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        writer.writerow(row)


def commit(source: Path) -> str:
    """Of the checkout that has this file of code; nothing if no checkout has it."""

    def git(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["git", "-C", os.fspath(source.parent), *arguments], capture_output=True, text=True, check=False
        )

    try:
        if git("ls-files", "--error-unmatch", source.name).returncode:
            return ""
        head = git("rev-parse", "--short", "HEAD").stdout.strip()
        changed = git("diff", "--quiet", "HEAD", "--", ":(top,glob)**/*.py").returncode
    except OSError:  # there is no git
        return ""
    return f"{head}+" if changed else head


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
