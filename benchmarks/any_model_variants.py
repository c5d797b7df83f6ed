"""What do the learner's step, Huber's loss and what is particular to Swimmer-v5 do to what is learned of a task?

    python benchmarks/any_model_variants.py [--seeds 0 1 2]

adds to benchmarks/results/any-model-variants.csv, a row a look, as any_model.py does: tasks learned with other settings
than those that ``train`` has for them. A step that is longer or shorter than the environment's control step looks ahead
for as long, and acts for that control step. A learner that is there already is not learned again.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import swimmer_v5_rewards  # noqa: F401 - a variant names it
import torch
import tyro
from any_model import COLUMNS as LOOKED
from any_model import learn
from rich.console import Console
from yardstick import Row, fill

OUT = Path(__file__).parent / "results" / "any-model-variants.csv"
COLUMNS = (LOOKED[0], "settings", *LOOKED[1:])
OF_THE_CENTRE = "swimmer_v5_rewards:centre_of_mass_velocity"
"""In place of what Swimmer-v5 pays, the velocity of a point of its first link."""
VARIANTS: dict[str, tuple[float, tuple[str, ...]]] = {
    "dm_control/pendulum/swingup": (60.0, ("", "huber=null")),
    "gymnasium/InvertedDoublePendulum-v5": (60.0, ("", "huber=null")),
    "dm_control/cartpole/swingup": (
        40.0,
        ("", "dt=0.0025 steps=100", "dt=0.005 steps=50", "dt=0.02 steps=12"),
    ),
    "gymnasium/Swimmer-v5": (
        80.0,
        (
            "",
            "dt=0.02 steps=50",
            f"reward_function={OF_THE_CENTRE}",
            "s_gamma=0.5",
            "held=false",
            "layers=[64,64]",
        ),
    ),
    "dm_control/acrobot/swingup": (100.0, ("", "huber=null", "dt=0.01 steps=50 trajectories=256")),
}
"""By task: processor time, s, and the settings, of which the first are those of ``train``."""


def main(tasks: tuple[str, ...] = tuple(VARIANTS), seeds: Sequence[int] = (0, 1, 2), out: Path = OUT) -> None:
    """Learn each variant of each task with each seed.

    Args:
        tasks: Which, by name.
        seeds: Of the learners.
        out: The table that rows are added to.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    torch.set_num_threads(1)
    console = Console(highlight=False)

    def variant(task: str, settings: str, seed: int) -> list[Row]:
        console.print(settings or "as train", "...")
        rows = learn(task, seed, VARIANTS[task][0], console, ("threads=1", *settings.split()))
        return [(row[0], settings, *row[1:]) for row in rows]

    keys = [(task, settings, seed) for seed in seeds for task in tasks for settings in VARIANTS[task][1]]
    fill(out, COLUMNS, keys, variant)


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
