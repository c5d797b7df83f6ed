"""Experiments write their results as small CSV files; the figures read them."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.files import replacing

__all__ = [
    "LOGS",
    "Summary",
    "Table",
    "last_look",
    "read_table",
    "rows_of",
    "rows_where",
    "settings_of",
    "span",
    "write_table",
]

LOGS = Path(__file__).parent / "logs"
"""The committed logs."""

Table = dict[str, NDArray]
"""Columns by name, each of shape (rows,): float64, or str where a cell is not a number."""


class Summary(NamedTuple):
    """A table of text."""

    title: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """The table in Markdown, without its title."""
        lines = [self.header, ("---",) * len(self.header), *self.rows]
        return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def write_table(
    path: str | os.PathLike[str],
    header: Sequence[str],
    rows: Iterable[Sequence[str | float]],
    digits: int = 6,
) -> None:
    """Write ``rows`` under ``header``; numbers with ``digits`` significant digits, in full where they are integers."""

    def cell(value: str | float) -> str:
        if isinstance(value, str):
            return value
        number = float(value)
        return str(int(number)) if number.is_integer() and abs(number) < 1e15 else f"{number:.{digits}g}"

    with replacing(path) as partial, partial.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            if len(row) != len(header):
                raise ValueError(f"a row must have {len(header)} cells, got {len(row)}")
            writer.writerow([cell(value) for value in row])


def read_table(path: str | os.PathLike[str]) -> Table:
    """The columns of a CSV file."""
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if not rows:
        raise ValueError(f"{os.fspath(path)} has no rows")
    return {name: _column(cells) for name, cells in zip(header, zip(*rows, strict=True), strict=True)}


def _column(cells: Sequence[str]) -> NDArray:
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        return np.array(cells)


def rows_of(table: Table) -> list[tuple[str | float, ...]]:
    """The rows of ``table``, of numbers and text as Python has them."""
    return list(zip(*(column.tolist() for column in table.values()), strict=True))


def rows_where(table: Table, **equal: str | float) -> Table:
    """The rows in which each named column equals the value given."""
    size = len(next(iter(table.values())))
    chosen = np.ones(size, dtype=bool)
    for name, value in equal.items():
        chosen &= table[name] == value
    return {name: column[chosen] for name, column in table.items()}


def settings_of(table: Table) -> list[tuple[str, str]]:
    """The pairs of ``factor`` and ``setting`` of a study, in their order."""
    return list(dict.fromkeys(zip(table["factor"].tolist(), table["setting"].tolist(), strict=True)))


def last_look(table: Table, column: str = "trial") -> Table:
    """The rows in which ``column`` has its largest value."""
    return rows_where(table, **{column: float(table[column].max())})


def span(values: NDArray[np.float64], spec: str = ".2f") -> str:
    """Smallest to largest."""
    return f"{values.min():{spec}} to {values.max():{spec}}"
