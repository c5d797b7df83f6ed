"""What of a run's processor time goes into watching it, logging it and saving it?

    python benchmarks/watching_cost.py [--seconds 60]

The paper's swimmer learns by TD(lambda), one learner, as ``train --tensorboard`` on a terminal has it learn. The
processor time of the threads is taken at each call of what shows (the live table, once a second, and its news),
what logs (TensorBoard's events; metrics.csv is written when a run is saved) and what saves, and is divided by that of
the process. Compiling comes before. Writes benchmarks/results/watching-cost.csv.
"""

from __future__ import annotations

import argparse
import csv
import functools
import os
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest import mock

from rich.console import Console
from rich.live import Live

from swimmer_mj.cli.progress import LearningDisplay
from swimmer_mj.cli.training import train_runs
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.events import EventLogs
from swimmer_mj.learning.runs.run import TrainingRun

OUT = Path(__file__).parent / "results" / "watching-cost.csv"
PARTS = {
    "watching": ((LearningDisplay, "note"), (Live, "refresh")),
    "TensorBoard": ((EventLogs, "note"),),
    "saving": ((TrainingRun, "save"), (TrainingRun, "save_unfinished")),
}


def measure(seconds: float, place: Path) -> list[tuple[str, int, float, float]]:
    """Of each part: calls, processor time (s), and its share (%) of that of the process."""
    spent: dict[str, list[float]] = {part: [] for part in PARTS}

    def timed(part: str, function: Any) -> Any:
        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            before = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[part].append(time.thread_time() - before)

        return call

    train_runs(Console(quiet=True), [TrainingRun(place / "warm", RunConfig(evaluate_every=1))], trials=1)
    run = TrainingRun(place / "run")
    with open(os.devnull, "w") as nowhere:
        console = Console(file=nowhere, force_terminal=True, width=150)
        patches = [
            mock.patch.object(kind, name, timed(part, getattr(kind, name)))
            for part, places in PARTS.items()
            for kind, name in places
        ]
        for patch in patches:
            patch.start()
        before = time.process_time()
        train_runs(console, [run], seconds=seconds, tensorboard=True)
        whole = time.process_time() - before
        for patch in patches:
            patch.stop()
    return [(part, len(times), sum(times), 100 * sum(times) / whole) for part, times in spent.items()]


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(options.seconds, Path(folder))
    with replacing(OUT) as partial, open(partial, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("part", "calls", "seconds", "percent"))
        for part, calls, seconds, percent in rows:
            print(f"{part:12} {calls:6} calls {seconds:8.3f} s {percent:6.2f} % of the process")
            writer.writerow((part, calls, f"{seconds:.3f}", f"{percent:.2f}"))
    note_made(OUT)


if __name__ == "__main__":
    main()
