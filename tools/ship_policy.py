"""Put the best weights of a training run among the policies that come with the package.

    python tools/ship_policy.py RUN NAME --chosen "fastest of 8 seeds"

evaluates them in their environment on MuJoCo, and writes learning/pretrained/NAME.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import torch
import tyro

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.problems.forms import EnvironmentForm
from swimmer_mj.learning.problems.problem import N_EPISODES
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.config import CONFIG
from swimmer_mj.learning.runs.run import BEST, LOG, load_policy

PRETRAINED = Path(__file__).parent.parent / "learning" / "pretrained"
ON_THE_CARD = {"speed": ("swimming_speed", "episode_speeds"), "return": ("return", "episode_returns")}
"""What a mean and the episodes' values are called there, by the environment's measure."""


def main(run: tyro.conf.Positional[Path], name: tyro.conf.Positional[str], chosen: str) -> None:
    """Ship a policy.

    Args:
        run: Run directory of one seed.
        name: Of the policy.
        chosen: How it was chosen, for its card.
    """
    torch.set_num_threads(1)
    policy, config, _ = load_policy(run)
    environment = config.problem.form(EnvironmentForm)
    if environment is None:
        raise SystemExit(f"{run} learned {config.problem.name!r}, which has no environment to be judged in")
    values = environment.evaluate(policy, N_EPISODES, os.cpu_count() or 1)
    mean, ci95 = mean_and_interval(values)
    named, each = ON_THE_CARD[environment.measure]
    tensors, info = load_checkpoint(run / BEST)
    commit = subprocess.run(
        ["git", "rev-parse", "--short=12", "HEAD"], check=True, capture_output=True, text=True
    ).stdout.strip()
    card = {
        named: round(mean, 4),
        "ci95": [round(bound, 4) for bound in ci95],
        each: [round(value, 4) for value in values.tolist()],
        "seed": config.seed,
        "chosen": chosen,
        "commit": commit,
        **info,
    }
    target = PRETRAINED / name
    target.mkdir(parents=True, exist_ok=True)
    for file in (CONFIG, LOG):
        shutil.copyfile(run / file, target / file)
    save_checkpoint(target / BEST, tensors, card)
    print(f"{target}: {environment.measure} {mean:.3f} {environment.unit}")


if __name__ == "__main__":
    tyro.cli(main)
