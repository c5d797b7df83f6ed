"""Planning without learning: iLQR, DDP and MPPI in a receding horizon, on the compiled equations.

    python benchmarks/planners.py tune      # some settings of each around the best known, on starts of their own
    python benchmarks/planners.py final     # the fastest of them, longer, on the starts of the evaluation

Rows go to benchmarks/results/planners.csv; what is there already is not done again. The swimmers are MuJoCo's.
The price is the processor time of one core for a control step of 0.01 s of one swimmer: a plan is made for each action,
which is held for some steps.
"""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import tyro
from numpy.typing import NDArray
from peers.ddp import Ddp, DdpSettings
from peers.engine import SwimEngine
from peers.mppi import Mppi, MppiSettings
from rich.console import Console
from tournament import TUNING_SEED, log
from yardstick import CONTROL_TIMESTEP

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.environments.vector import SwimmerVectorEnv
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.runs.sweep import random_search
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parent / "results" / "planners.csv"
COLUMNS = (
    "stage", "planner", "sample", "settings", "seed", "starts", "seconds", "ms_a_control_step", "simulation_steps",
    "first_5s", "10_to_20s", "30_to_60s",
)  # fmt: skip
WINDOWS = ((0, 5), (10, 20), (30, 60))
"""s, over which the speed is meant."""
Name = Literal["ilqr", "ddp", "mppi"]
Array = NDArray[np.float64]


class Planner(Protocol):
    """What is timed."""

    engine: SwimEngine

    def act(self, states: Array) -> Array:
        """Torques (N, q) at states (N, p), which follow on those of the last call."""
        ...


class Candidate(NamedTuple):
    """A planner, and what is tried of its settings."""

    make: Callable[[Swimming, Any, int], Planner]
    settings: Callable[..., Any]
    fixed: Mapping[str, Any]
    laws: Mapping[str, Any]


HORIZON = {"horizon": [20, 30, 40, 60], "hold": [2, 3, 4, 6]}
DERIVATIVES = HORIZON | {"iterations": [1, 2], "effort": log(1e-3, 0.1)}
PLANNERS: dict[Name, Candidate] = {
    "ilqr": Candidate(Ddp, DdpSettings, {"second_order": False}, DERIVATIVES),
    "ddp": Candidate(Ddp, DdpSettings, {"second_order": True}, DERIVATIVES),
    "mppi": Candidate(
        Mppi,
        MppiSettings,
        {},
        HORIZON
        | {
            "samples": [128, 256, 512], "iterations": [1, 2], "spread": [0.3, 0.5, 0.8], "keep": [0.0, 0.5, 0.8, 0.9],
            "temperature": log(3e-3, 0.1),
        },
    ),
}  # fmt: skip


def swim(planner: Planner, hold: int, starts: Array, seconds: float) -> tuple[Array, float]:
    """Speed along the way, (steps, N), m/s, a step an action, and processor time in all, s."""
    n, first = len(starts), iter(starts)
    swimmers = SwimmerVectorEnv("swim5", n, nthread=1, frame_skip=hold, initial_states=lambda _: next(first))
    speeds, spent = [], 0.0
    states, _ = swimmers.reset(seed=0)
    for _ in range(round(seconds / (CONTROL_TIMESTEP * hold))):
        begun = time.process_time()
        torques = planner.act(states)
        spent += time.process_time() - begun
        states, speed, *_ = swimmers.step(torques / PAPER.torque_limits)
        speeds.append(speed)
    swimmers.close()
    return np.array(speeds), spent


def run(name: Name, settings: Mapping[str, Any], seed: int, starts: Array, seconds: float) -> tuple[Any, ...]:
    """The last columns of a row."""
    candidate = PLANNERS[name]
    chosen = candidate.settings(**candidate.fixed, **settings)
    candidate.make(Swimming(), chosen, seed).act(starts)  # what is compiled, is compiled now
    planner = candidate.make(Swimming(), chosen, seed)
    speeds, spent = swim(planner, chosen.hold, starts, seconds)
    times = np.arange(len(speeds)) * CONTROL_TIMESTEP * chosen.hold
    shown = [
        f"{speeds[(times >= first) & (times < last)].mean():.4f}" if last <= seconds else ""
        for first, last in WINDOWS
    ]
    price = 1e3 * spent / (len(starts) * seconds / CONTROL_TIMESTEP)
    return (len(starts), seconds, f"{price:.3f}", planner.engine.simulation_steps, *shown)


def read(out: Path) -> list[dict[str, str]]:
    """All rows so far; an empty table is made where there is none."""
    if not out.exists():
        out.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    with out.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def fastest(rows: list[dict[str, str]], name: Name) -> tuple[int, dict[str, Any]]:
    """The sample that swam fastest from 10 to 20 s in the tuning, and its settings."""
    tuned = [row for row in rows if (row["stage"], row["planner"]) == ("tune", name)]
    if not tuned:
        raise SystemExit(f"{name} has not been tuned: run planners.py tune first")
    row = max(tuned, key=lambda row: float(row["10_to_20s"]))
    return int(row["sample"]), json.loads(row["settings"])


def main(
    stage: tyro.conf.Positional[Literal["tune", "final"]],
    planners: tuple[Name, ...] = ("ilqr", "ddp", "mppi"),
    samples: int = 8,
    seconds: float | None = None,
    out: Path = OUT,
) -> None:
    """Tune, or swim the final.

    Args:
        stage: Which.
        planners: Of whom.
        samples: Settings of each that are tried.
        seconds: For which each swims, from 16 starts; by default 20 in the tuning, 60 in the final.
        out: CSV to append rows to.
    """
    for number in range(samples if stage == "tune" else 1):
        for name in planners:
            rows = read(out)
            if stage == "tune":
                seed, starts = (
                    TUNING_SEED,
                    Swimming().initial_states(np.random.default_rng(TUNING_SEED), LANES),
                )
                sample, settings = (
                    number,
                    [{}, *random_search(PLANNERS[name].laws, samples - 1, seed=0)][number],
                )
            else:
                seed, starts = 0, evaluation_states(5)[:LANES]
                sample, settings = fastest(rows, name)
            key = (stage, name, str(sample), json.dumps(settings), str(seed))
            if any(tuple(row[column] for column in COLUMNS[:5]) == key for row in rows):
                continue
            found = run(name, settings, seed, starts, seconds or {"tune": 20.0, "final": 60.0}[stage])
            Console().print(*key, *found)
            with out.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow((*key, *found))
            note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
