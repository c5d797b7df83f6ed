"""What decides how fast value gradients swim: in which coordinates V is learned, and how torques are chosen.

    python benchmarks/swimmer_coordinates.py [--names "joints, held" ...] [--seeds 130 131 ...] [--seconds 120]

adds to benchmarks/results/swimmer-coordinates.csv, a row a look: value gradients with the settings that ``swimmer-mj
train --method value-gradient [--coordinates joints] [--held]`` has, with V of the state itself (absolute angles, centre
of mass) or of joints (angles between links, the head's velocity), and with torques for the instant or for the 10 ms for
which they are held; and with Huber's loss of the slope's errors in place of their squares. Judged on MuJoCo, from 64
initial states. One learner on one core; compilation and looks are not counted. A seed that is there already is not
learned again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
import tyro
from rich.console import Console
from yardstick import Row, fill, looks, swimming_and_steady_speed

from swimmer_mj.cli.training import changed, configured
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.method import ValueGradients

OUT = Path(__file__).parent / "results" / "swimmer-coordinates.csv"
LOOKS = (2.5, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0)
COLUMNS = ("name", "seed", "links", "cpu_seconds", "simulation_steps", "speed", "steady_speed")
VARIANTS: dict[str, tuple[dict[str, Any], float | None]] = {
    "state, instant": ({}, None),
    "state, held": ({"held": True}, None),
    "joints, instant": ({"coordinates": "joints"}, None),
    "joints, held": ({"coordinates": "joints", "held": True}, None),
    "state, instant, Huber": ({}, 1.0),
    "joints, held, Huber": ({"coordinates": "joints", "held": True}, 1.0),
    "joints, held, Huber, from the one before": ({"coordinates": "joints", "held": True}, 1.0),
}
"""Options of the problem, and ``huber``. All rows but the last one's are of before torques were found from the ones
before them, by two slopes of V in place of twelve; where they are not held that is no difference."""


def learn(name: str, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at one learner."""
    options, huber = VARIANTS[name]
    config = changed(configured("swim", "value-gradient", options, 1), [f"huber={json.dumps(huber)}"])
    problem, method = config.problem, config.method
    assert isinstance(problem, Swimming)
    assert isinstance(method, ValueGradients)
    learner = method.start(problem, seed).learner
    learner.step()  # compiles
    parameters, rows = problem.parameters, []
    for clock in looks(learner.step, LOOKS, seconds):
        speeds = (f"{speed:.4f}" for speed in swimming_and_steady_speed(learner.policy(), parameters))
        steps, at = learner.simulation_steps, clock.before[0]
        rows.append((name, seed, parameters.n_links, f"{at:.1f}", steps, *speeds))
        console.print(*rows[-1])
    return rows


def main(
    names: tuple[str, ...] = tuple(VARIANTS),
    seeds: Sequence[int] = tuple(range(130, 140)),
    seconds: float = 120.0,
    out: Path = OUT,
) -> None:
    """Learn each variant with each seed.

    Args:
        names: Which.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((name, seed) for seed in seeds for name in names)
    fill(out, COLUMNS, keys, lambda name, seed: learn(name, seed, seconds, console))


if __name__ == "__main__":
    tyro.cli(main)
