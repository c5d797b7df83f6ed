"""How fast is learning, measured against a bare mj_step of the same swimmer? Prints a table, writes JSON.

python benchmarks/learning_speed.py [--out learning-speed.json]
"""

from __future__ import annotations

import json
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from swimmer_mj.files import replacing
from swimmer_mj.learning.benchmark import run_benchmark


def main(out: Path = Path("runs/benchmarks/learning-speed.json")) -> None:
    """Time everything in one process, one after the other.

    Args:
        out: Where the JSON goes.
    """
    rates = run_benchmark()
    table = Table("", "1/s", "per bare mj_step")
    for name, rate in rates.items():
        table.add_row(name, f"{rate:,.0f}", f"{rate / rates['mj_step_per_s']:.3g}")
    Console().print(table)
    with replacing(out) as partial:
        partial.write_text(json.dumps(rates, indent=2) + "\n")


if __name__ == "__main__":
    tyro.cli(main)
