"""The best known gaits, looked at closely and swum on MuJoCo (docs/gaits.md).

    python benchmarks/gait_replays.py

writes benchmarks/results/gait-replays.csv, a row a gait; gaits that it has are not measured again. Each is swum for
8 s from a state that is off by a disturbance, with the feedback and without. CasADi is not needed.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro

from swimmer_mj.learning.experiments.gaits.gait import BEST, Gait, crossing_shares, load_gaits, mean_power
from swimmer_mj.learning.experiments.gaits.replay import periodic_feedback, replay
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import write_table

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "gait-replays.csv"
COLUMNS = (
    "links", "speed", "pull", "duration", "defect", "saturated", "power", "positive_power", "fold", "fold_joint",
    "crossings", "strokes", "replayed_speed", "largest_error", "without_feedback",
)  # fmt: skip
SECONDS = 8.0
DISTURBANCE = 1e-3
"""Standard deviation of each state variable at the beginning, rad, rad/s, m/s."""
STROKES_LEFT_OUT = 0.5
"""Share of the strokes in which the disturbance dies out."""


def sharpest_bend(gait: Gait) -> tuple[float, int]:
    """The largest angle of a joint, degrees, whole turns left out, and which joint has it, the first being 1."""
    n = gait.parameters.n_links
    bends = np.degrees(np.abs(np.angle(np.exp(1j * np.diff(gait.states[:, :n], axis=1))))).max(axis=0)
    return float(bends.max()), int(bends.argmax()) + 1


def measured(links: int, speed: float, gait: Gait) -> tuple[float | str, ...]:
    """A row."""
    limits = gait.parameters.torque_limits
    n_strokes = math.ceil(SECONDS / gait.duration)
    disturbance = np.random.default_rng(0).normal(0.0, DISTURBANCE, gait.states.shape[1])
    feedback = periodic_feedback(gait)
    held = replay(gait, feedback, n_strokes, disturbance)
    free = replay(gait, replace(feedback, gains=np.zeros_like(feedback.gains)), n_strokes, disturbance)
    late = slice(int(STROKES_LEFT_OUT * n_strokes), None)
    crossings = "; ".join(f"{i}-{j} {share:.0%}" for (i, j), share in crossing_shares(gait).items())
    return (
        links, speed, gait.pull, gait.duration, float(np.abs(gait.fine[1]).max()),
        float((np.abs(gait.controls) > 0.999 * limits).mean()), *mean_power(gait), *sharpest_bend(gait),
        crossings or "none", n_strokes, float(held.speeds[late].mean()),
        float(np.abs(held.speeds[late] / speed - 1).max()), float(free.speeds[late].mean()),
    )  # fmt: skip


def main(out: Path = OUT) -> None:
    """Measure each.

    Args:
        out: CSV.
    """
    known = {}
    if out.exists():
        with out.open(newline="", encoding="utf-8") as file:
            known = {tuple(row[:3]): row for row in list(csv.reader(file))[1:]}
    rows: list[Sequence[float | str]] = []
    for path in sorted(BEST.glob("swim*.npz")):
        for speed, gait in load_gaits(path).items():
            links = gait.parameters.n_links
            row = known.get((str(links), f"{speed:g}", f"{gait.pull:.6g}"))
            rows.append(row or measured(links, speed, gait))
            print(*rows[-1], flush=True)
            write_table(out, COLUMNS, [[_number(cell) for cell in row] for row in rows])
            note_made(out)


def _number(cell: float | str) -> float | str:
    """A cell of a file as it was written, as a number if it is one."""
    try:
        return float(cell)
    except ValueError:
        return cell


if __name__ == "__main__":
    tyro.cli(main)
