"""The tables of docs/errors.md: what is said, what was tried, what was survived; written from the logs.

    python benchmarks/trouble.py

The logs are those of ``refusals.py``, ``fuzz_inputs.py`` and ``kill_and_resume.py``. A table stands between
``<!-- log: NAME -->`` and ``<!-- end -->``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.summaries import Summary

RESULTS = Path(__file__).parent / "results"
PAGE = Path(__file__).parents[1] / "docs" / "errors.md"
MARKED = re.compile(r"(<!-- log: ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
KINDS = ("while learning", "while saving all the time", "at a file", "full disk", "out of memory")


def read(name: str) -> list[dict[str, str]]:
    """The rows of a log."""
    with open(RESULTS / f"{name}.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def refusals() -> Summary:
    """What the commands say when they refuse."""
    rows = [
        (f"`{row['asked']}`", f"`{row['said'].replace('|', chr(92) + '|')}`", row["status"])
        for row in read("refusals")
    ]
    return Summary("", ("`swimmer-mj` ..", "it says", "exit status"), rows)


def fuzzed_inputs() -> Summary:
    """How many odd inputs of each kind were taken and refused."""
    found = read("fuzzed-inputs")
    columns = ("inputs", "taken", "refused", "wrong")
    rows = [(row["target"], *(f"{int(row[name]):,}" for name in columns)) for row in found]
    rows.append(("all", *(f"{sum(int(row[name]) for row in found):,}" for name in columns)))
    return Summary("", ("what was odd", *columns), rows)


def kills() -> Summary:
    """How often runs were killed, by what they were doing then, and how many went on to the same bits."""
    found = read("kills")
    rows = []
    for target in dict.fromkeys(row["target"] for row in found):
        of_target = [row for row in found if row["target"] == target]
        counts = (str(sum(row["kind"] == kind for row in of_target)) for kind in KINDS)
        same = sum(row["result"] == "same bits" for row in of_target)
        rows.append((target, *counts, f"{same} of {len(of_target)}"))
    return Summary("", ("runs", *KINDS, "the same bits in the end"), rows)


TABLES: dict[str, Callable[[], Summary]] = {
    "refusals": refusals,
    "fuzzed-inputs": fuzzed_inputs,
    "kills": kills,
}


def with_tables(text: str) -> str:
    """The text of the page with its tables as the logs have them."""
    return MARKED.sub(lambda match: f"{match[1]}\n{TABLES[match[2]]().markdown()}\n{match[4]}", text)


if __name__ == "__main__":
    with replacing(PAGE) as partial:
        partial.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
