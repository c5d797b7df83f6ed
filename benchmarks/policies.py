"""How fast are the policies that come with the package, by all measures of ``swimmer-mj evaluate``?

    python benchmarks/policies.py

writes benchmarks/results/policies.csv, a row a policy; docs/python.md has the table.
"""

from __future__ import annotations

from pathlib import Path

import torch
import tyro

from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.learning.pretrained import pretrained_directory, pretrained_swimmers
from swimmer_mj.learning.runs.config import read_config
from swimmer_mj.learning.runs.evaluation import evaluate_run

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "policies.csv"
MEASURES = ("speed", "steady_speed", "first_5s_speed", "discounted_return")
COLUMNS = ("policy", "seed", "trials", "s_gamma", "n_episodes", *MEASURES)


def main(out: Path = OUT) -> None:
    """Evaluate each.

    Args:
        out: CSV.
    """
    torch.set_num_threads(1)
    rows = []
    for name in pretrained_swimmers():
        directory = pretrained_directory(name)
        found = evaluate_run(directory)
        means = (found[f"{measure}_mean"] for measure in MEASURES)
        s_gamma = read_config(directory).problem.s_gamma
        rows.append((name, found["seed"], found["trials"], s_gamma, found["n_episodes"], *means))
    write_table(out, COLUMNS, rows, digits=5)
    note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
