"""Does every input that is not as it should be get one line, and no traceback, hang, or wrong success?

    python benchmarks/fuzz_inputs.py [--inputs 100000] [--seed 0] [--json FILE]

Files that are read (configurations, checkpoints, logs, trajectories, sweeps) are damaged: bits flipped, cut off,
emptied, pieces doubled, values replaced by odd ones. Options get such values too. Each input must be taken, or be
refused with ValueError, TypeError or OSError, whose text the command line prints as one line with exit status 2; within
:data:`SECONDS`; and it must change nothing on disk. A damaged checkpoint that is taken must have its tensors unchanged.
Exit status 1 if not.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch

from swimmer_mj.cli import main as command_line
from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.cli.training import OPTIONS, changed, configured, parse_seeds
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import RunConfig, read_config
from swimmer_mj.learning.runs.run import TrainingRun, load_policy
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.render.curves import read_metrics
from swimmer_mj.trajectory import Trajectory

SECONDS = 5.0
"""An input may take."""
REFUSED = (ValueError, TypeError, OSError)
ODD = (
    "NaN", "Infinity", "-Infinity", "nan", "inf", "-inf", "0", "-0", "-1", "1e308", "1e-308", "1e999", "1" + "0" * 30,
    "9" * 5000, "2147483648", "-9223372036854775809", "0.1", "2.5", "true", "null", '""', '"x"', "[]", "{}", "[[1]]",
    '{"name": 1}', "[" * 20000, '{"a":' * 3000, "", " ", "=", "\\u0000", "é", "../..", "os:system", "this:Zen", "-",
)  # fmt: skip
SWEEP = """
problem = "pendulum"
trials = 20
seeds = "0-3"
[set]
neurons = 6
[grid]
eta = [0.02, 0.08]
mass = [1.0, 2.0]
"""


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """``data`` with one thing wrong."""
    kind = int(rng.integers(7))
    at = int(rng.integers(max(len(data), 1)))
    to = min(len(data), at + int(rng.integers(1, 40)))
    if kind == 0 and data:
        flipped = bytearray(data)
        flipped[at] ^= 1 << int(rng.integers(8))
        return bytes(flipped)
    if kind == 1:
        return data[:at]
    if kind == 2:
        return data[:at] + data[to:]
    if kind == 3:
        return data[:to] + data[at:]
    if kind == 4:
        return data[:at] + rng.bytes(int(rng.integers(1, 20))) + data[to:]
    if kind == 5:
        return rng.bytes(int(rng.integers(0, 200)))
    return with_odd_value(data, rng)


def with_odd_value(data: bytes, rng: np.random.Generator) -> bytes:
    """A word or number of a text replaced."""
    marks = [i for i, byte in enumerate(data[:4000]) if byte in b' ,:="[]{}\n']
    if len(marks) < 2:
        return odd(rng).encode()
    k = int(rng.integers(len(marks) - 1))
    return data[: marks[k] + 1] + odd(rng).encode() + data[marks[k + 1] :]


def odd(rng: np.random.Generator) -> str:
    """A value that somebody might type, or should not."""
    return ODD[int(rng.integers(len(ODD)))]


class Fuzz:
    """The targets, over a run that has hardly learned."""

    def __init__(self, place: Path) -> None:
        self.place, self.run = place, place / "run"
        method = TemporalDifferences(TDSettings(trial_duration=0.5), 4)
        run = TrainingRun(self.run, RunConfig(Pendulum(), method, 0, 2))
        train_together([run], trials=2)
        times = np.arange(3) * 0.1
        zeros = np.zeros(3)
        recorded = Trajectory(
            SwimmerParameters(), times, np.zeros((3, 14)), np.zeros((2, 4)), zeros, zeros, zeros
        )
        recorded.save(place / "trajectory.npz")
        (place / "sweep.toml").write_text(SWEEP)
        self.targets: dict[str, Callable[[np.random.Generator], None]] = {
            "config.json": self.file("run/config.json", lambda path: read_config(path.parent)),
            "config.json of a policy": self.file("run/config.json", lambda path: load_policy(path.parent)),
            "config.json to resume": self.file(
                "run/config.json", lambda path: TrainingRun(path.parent, resume=True)
            ),
            "best.safetensors": self.file("run/best.safetensors", self.same_tensors),
            "checkpoint.safetensors": self.file(
                "run/checkpoint.safetensors", lambda path: TrainingRun(path.parent, resume=True)
            ),
            "metrics.csv": self.file("run/metrics.csv", read_metrics),
            "trajectory.npz": self.file("trajectory.npz", Trajectory.load),
            "sweep.toml": self.file("sweep.toml", read_jobs),
            "--seeds": lambda rng: parse_seeds(
                odd(rng) + "-,"[int(rng.integers(2))] * int(rng.integers(2)) + odd(rng)
            ),
            "--set": self.setting,
            "options": self.option,
            "command line": self.command,
        }

    def file(self, name: str, read: Callable[[Path], Any]) -> Callable[[np.random.Generator], None]:
        """Damage the file ``name``, read it, and put it back."""
        path = self.place / name
        whole = path.read_bytes()

        def attack(rng: np.random.Generator) -> None:
            path.write_bytes(damaged(whole, rng))
            try:
                read(path)
            finally:
                path.write_bytes(whole)

        return attack

    def same_tensors(self, path: Path) -> None:
        """A damaged checkpoint that is taken has to be what it was."""
        tensors, _ = load_checkpoint(path)
        reference, _ = load_checkpoint(path.with_name("checkpoint.safetensors"))
        assert torch.equal(tensors["weight"], reference["weight"]), "a wrong success"

    def setting(self, rng: np.random.Generator) -> None:
        """``--set name=value`` with a name that there is, or not."""
        names = [
            "mass",
            "eta",
            "dt",
            "trial_duration",
            "vario",
            "neurons",
            "engine",
            "dtype",
            "parameters",
            "",
            "x",
        ]
        changed(RunConfig(), [f"{names[int(rng.integers(len(names)))]}={odd(rng)}"])

    def option(self, rng: np.random.Generator) -> None:
        """Options as numbers, as the parser gives them."""
        name = OPTIONS[int(rng.integers(len(OPTIONS)))]
        values = [float("nan"), float("inf"), -1, 0, 1e308, 10**30, 2**31, 2.5, "x", None, (), True]
        value = values[int(rng.integers(len(values)))]
        methods, problems = (
            ["td", "value-gradient", "x", "os:system"],
            ["swim", "pendulum", "cart-pole", "x", ""],
        )
        configured(
            problems[int(rng.integers(len(problems)))],
            methods[int(rng.integers(len(methods)))],
            {name: value},
            1,
        )

    def command(self, rng: np.random.Generator) -> None:
        """The whole command line, where nothing is learned: exit status 0, or 2 with one line."""
        names = ["--seed", "--seeds", "--trials", "--seconds", "--links", "--neurons", "--eta", "--s-gamma", "--set",
                 "--evaluate-every", "--method", "--problem", "--out", "--on-divergence", "--x", "--dtype"]  # fmt: skip
        arguments = [
            "train",
            "--out",
            str(self.place / "new"),
            names[int(rng.integers(len(names)))],
            odd(rng),
        ]
        said, out = io.StringIO(), io.StringIO()
        with (
            mock.patch("swimmer_mj.cli.training.train_runs"),
            mock.patch("swimmer_mj.learning.runs.run.TrainingRun"),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(out),
        ):
            status = command_line([argument.replace("\0", "?") for argument in arguments])
        line = said.getvalue()
        assert status in (0, 2), f"exit status {status}"
        assert status == 0 or (line.startswith("swimmer-mj: ") and line.count("\n") == 1), line
        if status:
            raise ValueError(line)

    def tree(self) -> str:
        """A digest of all that is on disk."""
        digest = hashlib.sha256()
        for path in sorted(self.place.rglob("*")):
            digest.update(str(path).encode() + (path.read_bytes() if path.is_file() else b""))
        return digest.hexdigest()


def examine(attack: Fuzz, target: str, inputs: int, seed: int) -> dict[str, Any]:
    """So many inputs for one target: how many were taken and refused, and what went wrong."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    before = attack.tree()
    for number in range(inputs):
        rng = np.random.default_rng([seed, number])
        started = time.perf_counter()
        try:
            attack.targets[target](rng)
            counts["taken"] += 1
        except REFUSED as error:
            counts["refused"] += 1
            if not str(error).strip():
                wrong.append(f"input {number}: {type(error).__name__} says nothing")
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            wrong.append(f"input {number}: {type(error).__name__}: {str(error)[:200]}")
        if (took := time.perf_counter() - started) > SECONDS:
            wrong.append(f"input {number}: took {took:.1f} s")
        if number % 1000 == 0 and attack.tree() != before:
            wrong.append(f"by input {number}: something on disk has changed")
            shutil.rmtree(attack.place / "new", ignore_errors=True)
            before = attack.tree()
    if attack.tree() != before:
        wrong.append("at the end: something on disk has changed")
    return {"target": target, "seed": seed, "inputs": inputs, **counts, "wrong": wrong}


def main(arguments: Sequence[str] | None = None) -> int:
    """All targets in turn; a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--inputs", type=int, default=100_000, help="in all; of the whole command line, a hundredth"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="where to write the counts")
    options = parser.parse_args(arguments)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        attack = Fuzz(Path(folder) / "fuzz")
        slow = options.inputs // 100
        each = (options.inputs - slow) // (len(attack.targets) - 1)
        for target in attack.targets:
            results.append(examine(attack, target, slow if target == "command line" else each, options.seed))
            print(json.dumps(results[-1]), flush=True)
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")
    return 1 if any(result["wrong"] for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
