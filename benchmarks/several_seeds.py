"""How fast do four learners swim of which the faster go on? Ten times the command, on two idle cores.

    python benchmarks/several_seeds.py [--links 5] [--first 140] [--times 10] [--seconds 120]

runs ``swimmer-mj train --method value-gradient --coordinates joints --held --seeds 140-143 --halve --seconds 120``,
then 144-147 and so on, and ``swimmer-mj evaluate`` on the one that was left in the end, which also swims against the
pulls of the best known gaits of 2 and 3 m/s, as in ``gait_shares.py``. Adds a row each to
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

import numpy as np
import tyro
from gait_shares import best_gaits, swim
from rich.console import Console
from yardstick import append, finished

from swimmer_mj.learning.runs.run import load_policy

OUT = Path(__file__).parent / "results" / "several-seeds.csv"
COLUMNS = ("links", "seed", "seeds", "seconds", "cores", "left", "bests", "speed", "steady_speed",
           "against_2", "against_3", "folded")  # fmt: skip
TEAM = 4
PULLED = (2.0, 3.0)
"""m/s, of the gaits whose pulls are swum against."""


def command(*arguments: object) -> dict[str, Any]:
    """What ``swimmer-mj`` prints as JSON."""
    line = [sys.executable, "-m", "swimmer_mj", *map(str, arguments), "--json"]
    return json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)


def pulled(directory: Path, links: int) -> tuple[float, ...]:
    """Speed against the pull of each gait, m/s, and the share of the time that the chain is folded without one."""
    best = best_gaits(links)
    policy, _, _ = load_policy(directory)
    swum = swim(policy, np.array([0.0, *(best[speed].pull for speed in PULLED)]))
    return (*swum.speed[1:].mean(axis=1).tolist(), float(swum.folded[0].mean()))


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
    done = finished(out, COLUMNS)
    left = [seed for seed in range(first, first + TEAM * times, TEAM) if (str(links), str(seed)) not in done]
    with tempfile.TemporaryDirectory() as folder:
        if left:
            command("train", "--out", f"{folder}/compiled", *kind, "--seconds", 1)
        for seed in left:
            runs = f"{folder}/{seed}"
            seeds = ("--seeds", f"{seed}-{seed + TEAM - 1}", "--halve", "--seconds", seconds)
            looks = ("--evaluate-every", evaluate_every)
            learned = command("train", "--out", runs, *kind, *seeds, *looks)
            found = command("evaluate", learned["fastest"])
            bests = " ".join(f"{run['best_speed'] or 0:.2f}" for run in learned["runs"])
            winner = Path(learned["fastest"]).name.removeprefix("seed-")
            speeds = (found[name] for name in ("speed_mean", "steady_speed_mean"))
            numbers = (f"{number:.4f}" for number in (*speeds, *pulled(Path(learned["fastest"]), links)))
            row = (links, seed, TEAM, f"{seconds:g}", os.cpu_count() or 1, winner, bests, *numbers)
            append(out, [row])
            console.print(*row)


if __name__ == "__main__":
    tyro.cli(main)
