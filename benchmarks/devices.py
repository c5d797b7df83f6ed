"""Rounds of value gradients in a second: compiled, in torch on the processor, in torch on a GPU.

    python benchmarks/devices.py

needs a CUDA device and takes two minutes. A round is N trajectories of 25 steps of the 5-link swimmer and a pass over
their states, in the network of 64 and 64 neurons. Writes benchmarks/results/devices.csv.
"""

from __future__ import annotations

import csv
import os
import time
from pathlib import Path

import torch

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parent / "results" / "devices.csv"
SECONDS = 12.0
CASES = (
    ("compiled", "cpu", "float32", 512),
    ("torch", "cpu", "float32", 512),
    ("torch", "cuda", "float32", 512),
    ("torch", "cuda", "float64", 512),
    ("torch", "cpu", "float32", 4096),
    ("torch", "cuda", "float32", 4096),
)
"""Engine, device, the network's type, N."""


def rate(engine: str, device: str, dtype: str, trajectories: int) -> float:
    """Rounds/s after the first, which may compile."""
    problem = Swimming(PAPER)
    generator = torch.Generator().manual_seed(0)
    network = Multilayer(problem.n_inputs, (64, 64), generator=generator, dtype=getattr(torch, dtype)).to(
        device
    )
    learner = ValueGradientLearner(
        problem, network, ValueGradientSettings(trajectories=trajectories), engine=engine
    )
    learner.step()
    start, rounds = time.perf_counter(), 0
    while time.perf_counter() - start < SECONDS:
        learner.step()
        rounds += 1
    if device == "cuda":
        torch.cuda.synchronize()
    return rounds / (time.perf_counter() - start)


def main() -> None:
    """Measure all cases in turn and write the log."""
    names = {"cpu": f"{os.cpu_count()} cores", "cuda": torch.cuda.get_device_name()}
    rows = [(*case, round(rate(*case), 3)) for case in CASES]
    with replacing(OUT) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("engine", "device", "dtype", "trajectories", "rounds_per_second"))
        for engine, device, *rest in rows:
            writer.writerow((engine, names[device], *rest))
    note_made(OUT)
    print(OUT.read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    main()
