"""How quickly do the shipped policies turn, and what does it cost them (docs/reproduction.md, figure 3)?

    python benchmarks/turning.py

writes benchmarks/results/turning.csv, a row for each policy, turn and start. A swimmer swims towards +x for 20 s; then
its target is turned by 90 or 180 degrees, to the left or to the right, or, to compare with, not at all, and it swims on
for 15 s. By A.3 and RK4 at 0.01 s, from the first 16 initial states of the evaluation. A policy is given the state in
the frame of its target, as everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.summaries import Summary
from swimmer_mj.learning.experiments.tables import Table, read_table, rows_where, write_table
from swimmer_mj.learning.pretrained import load_pretrained, pretrained_swimmers
from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.parameters import SwimmerParameters

OUT = Path(__file__).parent / "results" / "turning.csv"
COLUMNS = (
    "policy",
    "turn",
    "start",
    "speed",
    "turned_after",
    "at_speed_after",
    "metres_lost",
    "speed_in_the_end",
)
TURNS = (0, 90, -90, 180)
"""Degrees, the one that is no turn first."""
DT, SETTLED, AFTER, END = 0.01, 20.0, 15.0, 5.0
"""s; the speed in the end is that of the last END."""
STROKE = 1.0
"""s, over which velocities are averaged: a stroke, or some."""
HEADED = 20.0
"""Degrees from the new direction within which the mean velocity points when a swimmer has turned."""
AT_SPEED = 0.9
"""Share of the speed without a turn."""
STARTS = 16

Array = NDArray[np.float64]


class Turn(NamedTuple):
    """What a turn took, of each start; times are nan where it does not come to that."""

    turned_after: Array
    """s, until the mean velocity over the last second points along the new direction to 20 degrees."""
    at_speed_after: Array
    """s, until that velocity along the new direction is 90 % of the speed without a turn."""
    metres_lost: Array
    """By how much less far it has come along the new direction than it would have come along the old one."""
    speed_in_the_end: Array
    """m/s, along the new direction, in the last 5 s."""


def measure(way: Array, unturned: Array) -> Turn:
    """What turns took, from the ways with and without, along the target's direction and across (steps, starts, 2)."""
    stroke, end = round(STROKE / DT), round(END / DT)
    speed = (unturned[-1, :, 0] - unturned[0, :, 0]) / (DT * (len(unturned) - 1))
    velocity = (way[stroke:] - way[:-stroke]) / STROKE
    heading = np.abs(np.arctan2(velocity[..., 1], velocity[..., 0]))
    lost = (unturned[-1] - unturned[0]) - (way[-1] - way[0])
    return Turn(
        _first(heading <= math.radians(HEADED)),
        _first(velocity[..., 0] >= AT_SPEED * speed),
        lost[:, 0],
        (way[-1] - way[-1 - end])[:, 0] / END,
    )


def _first(true: NDArray[np.bool_]) -> Array:
    """When each column is true first, s, the first row being STROKE; nan if never."""
    return np.where(true.any(axis=0), true.argmax(axis=0) * DT + STROKE, math.nan)


def ways(policy: Policy, parameters: SwimmerParameters, starts: Array) -> Array:
    """Way of the centre of mass after each turn, along the new direction and across (turns, steps, starts, 2)."""
    n, swimmer = parameters.n_links, AnalyticSwimmer(parameters)
    z = starts
    for _ in range(round(SETTLED / DT)):
        z, _ = _step(policy, swimmer, z)
    # The target stays, the swimmer turns
    z = np.concatenate([_turned(z, n, -math.radians(turn)) for turn in TURNS])
    way = np.zeros((round(AFTER / DT) + 1, len(z), 2))
    for t in range(len(way) - 1):
        z, moved = _step(policy, swimmer, z)
        way[t + 1] = way[t] + moved
    return way.reshape(len(way), len(TURNS), len(starts), 2).swapaxes(0, 1)


def _turned(z: Array, n: int, angle: float) -> Array:
    """Reduced states of n links, turned by an angle (rad)."""
    parts = st.split_reduced(z, n)
    return st.join_reduced(parts.angles + angle, parts.angular_velocities, st.rotate(parts.velocity, angle))


def _step(policy: Policy, swimmer: AnalyticSwimmer, z: Array) -> tuple[Array, Array]:
    """The state after a control timestep, and how far the centre of mass has come, (N, 2), m."""
    u = policy.judge(z).control
    x = rk4_step(lambda y: swimmer.derivative(y, u), st.expand(swimmer.parameters, z), DT)
    return st.reduce(swimmer.parameters, x), st.center_of_mass(swimmer.parameters, x)


def summary(log: Path = OUT) -> Summary:
    """Means over starts with 95 % intervals; of the turns to the left and to the right, one mean for each start."""
    table = read_table(log)
    rows = []
    for name in dict.fromkeys(table["policy"].tolist()):
        for turns in ((90, -90), (180,)):
            taken = [rows_where(table, policy=name, turn=turn) for turn in turns]
            never = np.isnan(np.concatenate([one["turned_after"] for one in taken]))
            cells = (_mean(taken, column) for column in COLUMNS[3:])
            rows.append((f"`{name}`", f"{turns[0]}°", f"{never.sum()} of {never.size}", *cells))
    header = (
        "policy",
        "turn",
        "do not turn",
        "speed before, m/s",
        "points along the new direction after, s",
        "at 90 % of its speed after, s",
        "lost, m",
        "speed in the end, m/s",
    )
    return Summary("", header, rows)


def _mean(taken: Sequence[Table], column: str) -> str:
    """Over starts; where some do not come to it, over those that do, and how many."""
    values = np.concatenate([one[column] for one in taken]).reshape(len(taken), -1)
    there = np.isfinite(values).all(axis=0)
    if not there.any():
        return "none"
    text = mean_and_interval_text(values[:, there].mean(axis=0), ".2f")
    return text if there.all() else f"{text}; {there.sum()} of {there.size}"


def main(policies: tuple[str, ...] = pretrained_swimmers(), starts: int = STARTS, out: Path = OUT) -> None:
    """Turn each.

    Args:
        policies: Their names.
        starts: Initial states.
        out: CSV.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    rows: list[tuple[str | float, ...]] = []
    for name in policies:
        policy = load_pretrained(name).policy
        parameters = policy.problem.parameters
        found = ways(policy, parameters, evaluation_states(parameters.n_links)[:starts])
        speeds = (found[0, -1] - found[0, 0])[:, 0] / AFTER
        for turn, way in zip(TURNS[1:], found[1:], strict=True):
            taken = measure(way, found[0])
            rows += [(name, turn, k, speeds[k], *(float(y[k]) for y in taken)) for k in range(starts)]
            console.print(name, turn, "lost, m:", *(f"{y:.2f}" for y in taken.metres_lost))
    write_table(out, COLUMNS, rows)
    note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
