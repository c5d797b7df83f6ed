"""Does every input that is not as it should be get one line, and no traceback, hang, or wrong success?

    python benchmarks/fuzz_inputs.py [--inputs 100000] [--seed 0] [--log FILE]

Files that are read (configurations, checkpoints, logs, trajectories, sweeps, models) are damaged: bits flipped, cut
off, emptied, pieces doubled, values replaced by odd ones; or they are of another kind, another swimmer, a later
schema. Options get such values too. Each input must be taken, or be refused with ValueError, TypeError or OSError,
whose text the command line prints as one line with exit status 2; within :data:`SECONDS`; and it must change nothing on
disk. A damaged checkpoint that is taken must have its tensors unchanged. Exit status 1 if not.

Where a command would begin to compute, it stops: the input counts as taken.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import inspect
import io
import json
import pkgutil
import shutil
import signal
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

from swimmer_mj.cli import COMMANDS
from swimmer_mj.cli import main as command_line
from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.cli.training import OPTIONS, changed, configured, parse_seeds
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.mujoco.starts import load_model
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import RunConfig, read_config
from swimmer_mj.learning.runs.run import TrainingRun, load_policy
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.render.curves import read_metrics
from swimmer_mj.trajectory import Trajectory

SECONDS = 5.0
"""An input may take."""
HANG = 60
"""s after which an input is given up."""
WORK = (
    "swimmer_mj.cli.training.train_runs",
    "swimmer_mj.learning.runs.run.TrainingRun._create",
    "swimmer_mj.learning.runs.evaluation.evaluate_run",
    "swimmer_mj.learning.runs.sweep.run_jobs",
    "swimmer_mj.learning.experiments.rates.run_benchmark",
    "swimmer_mj.cli.pictures.render_run",
    "swimmer_mj.cli.webpage.write_policy_page",
    "swimmer_mj.cli.viewing._open_viewer",
    "swimmer_mj.render.figures.save_figure",
    "swimmer_mj.render.backend.probe",
    "swimmer_mj.validation.full_report",
    "swimmer_mj.validation.physics_report",
)
"""Where commands begin to compute or to write."""
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


class BegunError(BaseException):
    """The command has taken its input, and would compute now."""


class HangError(BaseException):
    """An input has taken too long."""


def damaged(data: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """``data`` with one thing wrong, or one of the ``others`` in its place."""
    kind = int(rng.integers(8 if others else 7))
    if kind == 7:
        return others[int(rng.integers(len(others)))]
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
        self.place, self.run, self.scratch = place, place / "run", place / "scratch"
        method = TemporalDifferences(TDSettings(trial_duration=0.5), 4)
        config = RunConfig(Pendulum(), method, 0, 2)
        run = TrainingRun(self.run, config)
        train_together([run], trials=2)
        with run.held():
            run.learning.learn(1)
            run.trial += 1
            run.save_unfinished()
        times = np.arange(3) * 0.1
        zeros = np.zeros(3)
        recorded = Trajectory(
            SwimmerParameters(), times, np.zeros((3, 14)), np.zeros((2, 4)), zeros, zeros, zeros
        )
        recorded.save(place / "trajectory.npz")
        (place / "sweep.toml").write_text(SWEEP)
        (place / "model.xml").write_text(mjcf(SwimmerParameters(n_links=2), friction="actuators"))
        self.scratch.mkdir()
        other = RunConfig(Swimming(SwimmerParameters(n_links=3)), method, 0, 2)
        later = {**config.to_json(), "schema": 99}
        self.others = [path.read_bytes() for path in sorted(place.rglob("*")) if path.is_file()]
        for name in WORK:
            pkgutil.resolve_name(name)  # imports take longer than an input may
        self.others += [json.dumps(values).encode() for values in (other.to_json(), later)]
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
            "unfinished.safetensors": self.file(
                "run/unfinished.safetensors", lambda path: TrainingRun(path.parent, resume=True)
            ),
            "metrics.csv": self.file("run/metrics.csv", read_metrics),
            "trajectory.npz": self.file("trajectory.npz", Trajectory.load),
            "sweep.toml": self.file("sweep.toml", read_jobs),
            "model.xml": self.file("model.xml", lambda path: load_model(str(path))),
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
            path.write_bytes(damaged(whole, rng, self.others))
            try:
                read(path)
            finally:
                path.write_bytes(whole)

        return attack

    def same_tensors(self, path: Path) -> None:
        """A damaged checkpoint that is taken has to be what it was, or another one that is whole."""
        tensors, _ = load_checkpoint(path)
        reference, _ = load_checkpoint(path.with_name("checkpoint.safetensors"))
        same = torch.equal(tensors["weight"], reference["weight"])
        assert same or path.read_bytes() in self.others, "a wrong success"

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
        """A whole command line: exit status 2 with one line, and no new file; or its input is taken."""
        command = COMMANDS[int(rng.integers(len(COMMANDS)))]
        arguments = [command.__name__, *self.arguments(command, rng)]
        said, out = io.StringIO(), io.StringIO()
        with contextlib.ExitStack() as stack:
            for name in WORK:
                stack.enter_context(mock.patch(name, side_effect=BegunError))
            stack.enter_context(mock.patch("swimmer_mj.cli.viewing.lacks_screen", return_value=None))
            stack.enter_context(mock.patch("swimmer_mj.render.backend.use_backend"))
            stack.enter_context(contextlib.chdir(self.scratch))
            stack.enter_context(contextlib.redirect_stderr(said))
            stack.enter_context(contextlib.redirect_stdout(out))
            try:
                status = command_line(arguments)
            except BegunError:
                return
        line = said.getvalue()
        assert status in (0, 2), f"exit status {status} of {arguments}: {line}"
        assert status == 0 or (line.startswith("swimmer-mj: ") and line.count("\n") == 1), (arguments, line)
        if status:
            raise ValueError(line)

    def arguments(self, command: Callable[..., None], rng: np.random.Generator) -> list[str]:
        """What ``command`` needs, and one or two of its options with odd values."""
        given = {"train": ["--out", "new"], "sweep": [str(self.place / "sweep.toml"), "--out", "new"]}
        run = "swim3-value-gradient" if rng.random() < 0.5 else str(self.run)
        given |= {name: [run] for name in ("evaluate", "render", "report", "page", "info")}
        given |= {"view": ["swim3", run], "figures": ["section-3.3"]}
        arguments = given.get(command.__name__, [])
        parameters = inspect.signature(command).parameters
        options = [f"--{'set' if name == 'settings' else name.replace('_', '-')}" for name in parameters]
        if arguments and rng.random() < 0.1:
            arguments[int(rng.integers(len(arguments)))] = odd(rng)
        for _ in range(int(rng.integers(1, 3))):
            arguments += [options[int(rng.integers(len(options)))], odd(rng)]
        return [argument.replace("\0", "?") for argument in arguments]

    def tree(self) -> str:
        """A digest of all that is on disk."""
        digest = hashlib.sha256()
        for path in sorted(self.place.rglob("*")):
            digest.update(str(path).encode() + (path.read_bytes() if path.is_file() else b""))
        return digest.hexdigest()


def _hang(number: int, frame: Any) -> None:
    raise HangError(f"nothing for {HANG} s")


def examine(attack: Fuzz, target: str, inputs: int, seed: int) -> dict[str, Any]:
    """So many inputs for one target: how many were taken and refused, and what went wrong."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    before = attack.tree()
    signal.signal(signal.SIGALRM, _hang)
    for number in range(inputs):
        rng = np.random.default_rng([seed, number])
        started = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, HANG)
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
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        if (took := time.perf_counter() - started) > SECONDS:
            wrong.append(f"input {number}: took {took:.1f} s")
        if number % 100 == 0 and attack.tree() != before:
            wrong.append(f"by input {number}: something on disk has changed")
            shutil.rmtree(attack.scratch)
            attack.scratch.mkdir()
            before = attack.tree()
    if attack.tree() != before:
        wrong.append("at the end: something on disk has changed")
    return {"target": target, "seed": seed, "inputs": inputs, **counts, "wrong": wrong}


def main(arguments: Sequence[str] | None = None) -> int:
    """All targets in turn; a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--inputs", type=int, default=100_000, help="in all; whole command lines are a twentieth of them"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, help="where to write the counts")
    options = parser.parse_args(arguments)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        attack = Fuzz(Path(folder) / "fuzz")
        slow = options.inputs // 20
        each = -(-(options.inputs - slow) // (len(attack.targets) - 1))
        for target in attack.targets:
            results.append(examine(attack, target, slow if target == "command line" else each, options.seed))
            print(json.dumps(results[-1]), flush=True)
    if options.log:
        columns = ("target", "seed", "inputs", "taken", "refused")
        with replacing(options.log) as partial, open(partial, "w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow((*columns, "wrong"))
            writer.writerows([*(one.get(name, 0) for name in columns), len(one["wrong"])] for one in results)
        note_made(options.log)
    return 1 if any(result["wrong"] for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
