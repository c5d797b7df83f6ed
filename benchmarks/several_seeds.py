"""How fast do four learners swim of which the faster go on? Ten times the command, on two idle cores.

    python benchmarks/several_seeds.py [--links 5] [--first 140] [--times 10] [--seconds 120]

runs ``swimmer-mj train --method value-gradient --coordinates joints --held --seeds 140-143 --halve --seconds 120``,
then 144-147 and so on, and ``swimmer-mj evaluate`` on the one that was left in the end. Adds a row each to
benchmarks/results/several-seeds.csv; seeds that are there are not learned again. The clock is the wall's, so that
nothing else may run beside it; the seeds were used for nothing else.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from yardstick import append, finished

OUT = Path(__file__).parent / "results" / "several-seeds.csv"
COLUMNS = ("links", "seed", "seeds", "seconds", "cores", "left", "bests", "speed", "steady_speed")
TEAM = 4


def command(*arguments: object) -> dict[str, Any]:
    """What ``swimmer-mj`` prints as JSON."""
    line = [sys.executable, "-m", "swimmer_mj", *map(str, arguments), "--json"]
    return json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)


def main(
    links: int = 5,
    first: int = 140,
    times: int = 10,
    seconds: float = 120.0,
    evaluate_every: int = 1000,
    out: Path = OUT,
) -> None:
    """Learn and judge.

    Args:
        links: Of the swimmer.
        first: The first seed.
        times: How often.
        seconds: Wall-clock time of each.
        evaluate_every: Trials between the looks by which the faster are told.
        out: The table that rows are added to.
    """
    console = Console(highlight=False)
    kind = ("--method", "value-gradient", "--coordinates", "joints", "--held", "--links", links)
    with tempfile.TemporaryDirectory() as folder:
        command("train", "--out", f"{folder}/compiled", *kind, "--seconds", 1)
        for seed in range(first, first + TEAM * times, TEAM):
            if (str(links), str(seed)) in finished(out, COLUMNS):
                continue
            runs = f"{folder}/{seed}"
            seeds = ("--seeds", f"{seed}-{seed + TEAM - 1}", "--halve", "--seconds", seconds)
            looks = ("--evaluate-every", evaluate_every)
            learned = command("train", "--out", runs, *kind, *seeds, *looks)
            found = command("evaluate", learned["fastest"])
            bests = " ".join(f"{run['best_speed'] or 0:.2f}" for run in learned["runs"])
            left = Path(learned["fastest"]).name.removeprefix("seed-")
            speeds = (f"{found[name]:.4f}" for name in ("speed_mean", "steady_speed_mean"))
            row = (links, seed, TEAM, f"{seconds:g}", os.cpu_count() or 1, left, bests, *speeds)
            append(out, [row])
            console.print(*row)


if __name__ == "__main__":
    tyro.cli(main)
