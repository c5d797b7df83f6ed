"""Put the best weights of a training run among the policies that come with the package.

    python tools/ship_policy.py RUN NAME --chosen "fastest of 8 seeds"

evaluates them on MuJoCo through dm_control, and writes learning/pretrained/NAME.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import torch
import tyro

from swimmer_mj.learning.problems.forms import SwimmerForm
from swimmer_mj.learning.problems.swim.environment import SwimmingPolicy, evaluate_swimming
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.config import CONFIG
from swimmer_mj.learning.runs.run import BEST, LOG, load_policy

PRETRAINED = Path(__file__).parent.parent / "learning" / "pretrained"


def main(run: tyro.conf.Positional[Path], name: tyro.conf.Positional[str], chosen: str) -> None:
    """Ship a policy.

    Args:
        run: Run directory of one seed.
        name: Of the policy.
        chosen: How it was chosen, for its card.
    """
    torch.set_num_threads(1)
    policy, config, _ = load_policy(run)
    swimmer = config.problem.form(SwimmerForm)
    if swimmer is None:
        raise SystemExit(f"{run} learned {config.problem.name!r}; only swimmers are shipped")
    speed = evaluate_swimming(SwimmingPolicy(policy, batches=True), swimmer.parameters)
    tensors, info = load_checkpoint(run / BEST)
    commit = subprocess.run(
        ["git", "rev-parse", "--short=12", "HEAD"], check=True, capture_output=True, text=True
    ).stdout.strip()
    card = {
        "swimming_speed": round(speed.mean, 4),
        "ci95": [round(bound, 4) for bound in speed.ci95],
        "episode_speeds": [round(v, 4) for v in speed.speeds.tolist()],
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
    print(f"{target}: {speed.mean:.3f} m/s")


if __name__ == "__main__":
    tyro.cli(main)
