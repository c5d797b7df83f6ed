"""Is anything lost when a run is killed, when the disk is full, or when memory ends?

    python benchmarks/kill_and_resume.py [--kills 100] [--seed 0] [--targets td ..] [--log FILE]

Runs of each method, one or several in one go, are killed with SIGKILL and resumed until they are done, again and again:
at random moments of learning; at random moments while everything is being saved all the time; and right before and
after each file takes its place, or with half of it written, one after the other. Then the disk is full (a small tmpfs
for root, else RLIMIT_FSIZE), and memory ends (RLIMIT_AS). Each time, tensors and metrics at the end must be those of
runs that nothing has happened to, bit for bit, and nothing may be left behind. Exit status 1 if not.

The log has a row for each kill: what the runs were doing, by what they left on disk, and how they ended when they had
gone on.

Processes are forked from one that has compiled everything, so Linux and macOS only.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from swimmer_mj import files
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs import together
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import CONFIG, RunConfig
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import SwimmerParameters

PERIODS = 2
KINDS = ("random", "files", "disk", "memory")
Act = Callable[[], None]


def _td(engine: str, seeds: int) -> list[RunConfig]:
    settings = TDSettings(eta=0.04, trial_duration=1.0)
    method = TemporalDifferences(settings, 10, engine=engine)  # pyright: ignore[reportArgumentType]
    return [RunConfig(Pendulum(), method, seed, 400) for seed in range(seeds)]


def _gradients(seeds: int) -> list[RunConfig]:
    settings = ValueGradientSettings(trajectories=32, steps=5, minibatch=32, dt=0.05)
    swimmer = Swimming(SwimmerParameters(n_links=3))  # which is compiled
    return [RunConfig(swimmer, ValueGradients(settings, (8,)), seed, 40) for seed in range(seeds)]


TARGETS: dict[str, list[RunConfig]] = {
    "td": _td("fused", 1),
    "td, 3 seeds": _td("fused", 3),
    "population": _td("population", 1),
    "population, 3 seeds": _td("population", 3),
    "value-gradient": _gradients(1),
    "value-gradient, 3 seeds": _gradients(3),
}


def learn(directory: Path, configs: Sequence[RunConfig]) -> None:
    """To the end, from wherever the runs are."""
    paths = [directory / f"seed-{config.seed}" for config in configs]
    runs = [
        TrainingRun(path, config, resume=(path / CONFIG).exists())
        for path, config in zip(paths, configs, strict=True)
    ]
    train_together(runs, trials=PERIODS * configs[0].evaluate_every, workers=2)


def in_a_child(act: Act, seconds: float | None = None) -> int:
    """Exit status of a forked process that does ``act``; negative: the signal, SIGKILL after so many ``seconds``."""
    child = os.fork()
    if child == 0:
        status = 3
        try:
            with open(os.devnull, "w") as nowhere, contextlib.redirect_stderr(nowhere):
                act()
            status = 0
        except (OSError, MemoryError):
            status = 2
        except RuntimeError as error:
            status = 2 if "allocate memory" in str(error) else 3
        finally:
            os._exit(status)
    if seconds is not None:
        ends = time.monotonic() + seconds
        while (left := ends - time.monotonic()) > 0:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status)
            time.sleep(min(left, 0.02))
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def saving_all_the_time() -> None:
    """In a child: save after each stretch, and make stretches short."""
    together.SAVE_SECONDS, together.STRETCH_SECONDS = 0.0, 1e-3


def dying_at(number: int, how: str) -> None:
    """In a child: SIGKILL at the ``number``-th file that takes its place; before, after, or with half of it written."""
    left = [number]

    def replace(source: Path, target: Path) -> None:
        left[0] -= 1
        if left[0] == 0:
            if how == "half":
                content = source.read_bytes()
                source.write_bytes(content[: len(content) // 2])
            if how == "after":
                os.rename(source, target)
            os.kill(os.getpid(), signal.SIGKILL)
        os.rename(source, target)

    files.os = type("os", (), {"replace": staticmethod(replace), "getpid": os.getpid, "fspath": os.fspath})  # pyright: ignore


def outcome(directory: Path, configs: Sequence[RunConfig]) -> dict[str, Any]:
    """All that must be the same: tensors as bytes, metrics without the column of wall-clock time, names of files."""
    found: dict[str, Any] = {}
    for path in (directory / f"seed-{config.seed}" for config in configs):
        for name in ("checkpoint", "best"):
            tensors, _ = load_checkpoint(path / f"{name}.safetensors")
            found |= {f"{path.name} {name} {key}": value.numpy().tobytes() for key, value in tensors.items()}
        with open(path / "metrics.csv", newline="") as file:
            found[f"{path.name} metrics"] = [row[:1] + row[2:] for row in csv.reader(file)]
        found |= {f"{path.name} file {file.name}": True for file in path.iterdir()}
    return found


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """What is not the same."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


class Kill(NamedTuple):
    """A row of the log."""

    target: str
    learners: int
    seed: int
    """Of the moments."""
    kind: str
    moment: str
    where: str
    result: str = ""


def where(directory: Path) -> str:
    """What the runs of a directory were doing when they were killed, by what they left."""
    if partial := sorted(directory.rglob(".*.partial*")):
        return f"writing {partial[0].name[1:].partition('.')[0]}{partial[0].suffix}"
    if not list(directory.rglob(CONFIG)):
        return "before config.json"
    rows = sum(len(path.read_text().splitlines()) - 1 for path in directory.rglob("metrics.csv"))
    return f"learning after {rows} evaluations"


class Bench:
    """One target, its reference, and what was found."""

    def __init__(self, name: str, place: Path, seed: int) -> None:
        self.name, self.configs, self.place, self.seed = name, TARGETS[name], place, seed
        self.log: list[Kill] = []
        learn(place / "warm", self.configs)  # compiles
        self.seconds = min(self._whole(place / f"whole-{k}") for k in range(3))
        self.whole = outcome(place / "whole-0", self.configs)
        self.wrong: list[str] = []

    def _whole(self, directory: Path) -> float:
        """Seconds of runs that nothing happens to."""
        started = time.perf_counter()
        assert in_a_child(lambda: learn(directory, self.configs)) == 0
        return time.perf_counter() - started

    def note(self, kind: str, moment: str, directory: Path) -> None:
        """A row; how it ends is known when the runs are at their end."""
        self.log.append(Kill(self.name, len(self.configs), self.seed, kind, moment, where(directory)))

    def finish(self, directory: Path, what: str) -> None:
        """Let the runs go to their end, compare with the reference, and remove the directory."""
        if (status := in_a_child(lambda: learn(directory, self.configs))) != 0:
            found = [f"did not go on, status {status}"]
        else:
            found = differences(outcome(directory, self.configs), self.whole)
        self.wrong += [f"{what}: {difference}" for difference in found]
        result = "; ".join(found) or "same bits"
        self.log = [row if row.result else row._replace(result=result) for row in self.log]
        shutil.rmtree(directory, ignore_errors=True)

    def kill_at_random(self, kills: int, rng: np.random.Generator, all_the_time: bool) -> int:
        """Kill and resume until so many kills have hit; every run goes to its end. How many hit."""
        hits, round_number = 0, 0
        kind = "while saving all the time" if all_the_time else "while learning"
        while hits < kills:
            directory = self.place / f"killed-{round_number}"
            round_number += 1
            for _ in range(6):  # kills of one run; then it may finish

                def act(directory: Path = directory) -> None:
                    if all_the_time:
                        saving_all_the_time()
                    learn(directory, self.configs)

                seconds = float(rng.uniform(0, 1.2 * self.seconds))
                status = in_a_child(act, seconds)
                if status == -signal.SIGKILL:
                    hits += 1
                    self.note(kind, f"{seconds:.4f} s", directory)
                if status not in (0, -signal.SIGKILL):
                    self.wrong.append(f"kill {hits}: status {status}")
                if status == 0 or hits >= kills:
                    break
            self.finish(directory, f"run {round_number} with kills up to number {hits}")
        return hits

    def kill_at_each_file(self) -> int:
        """Before and after each file takes its place, and with half of it written."""
        count = 0
        for how in ("before", "half", "after"):
            for number in range(1, 1000):
                directory = self.place / f"{how}-{number}"

                def act(directory: Path = directory, how: str = how, number: int = number) -> None:
                    dying_at(number, how)
                    learn(directory, self.configs)

                status = in_a_child(act)
                if status == 0:  # there are no more files
                    shutil.rmtree(directory)
                    break
                count += 1
                self.note("at a file", f"{how} file {number}", directory)
                self.finish(directory, f"{how} file {number}")
        return count

    def fill_the_disk(self, full_disk: Callable[[Path, int], Any]) -> int:
        """No room at some moment; go on when there is."""
        count = 0
        for kilobytes in (4, 16, 32, 48, 64):
            directory = self.place / f"full-{kilobytes}"
            directory.mkdir()
            with full_disk(directory, kilobytes) as (limit, make_room):

                def act(limit: Act = limit, directory: Path = directory) -> None:
                    limit()
                    learn(directory / "runs", self.configs)

                status = in_a_child(act)
                if status == 2:
                    count += 1
                    self.note("full disk", f"{kilobytes} kB, {full_disk.__name__}", directory)
                elif status != 0:
                    self.wrong.append(f"disk of {kilobytes} kB: status {status}")
                make_room()
                self.finish(directory / "runs", f"disk of {kilobytes} kB")
            shutil.rmtree(directory)
        return count

    def exhaust_memory(self) -> int:
        """Fewer and fewer bytes more than now; go on without the limit."""
        count = 0
        for megabytes in (0, 1, 2, 4, 8, 16, 32, 64):
            directory = self.place / f"memory-{megabytes}"

            def act(megabytes: int = megabytes, directory: Path = directory) -> None:
                now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                signal.alarm(30)  # Python itself waits for ever for a thread that had no memory to start
                resource.setrlimit(resource.RLIMIT_AS, (now + megabytes * 2**20,) * 2)
                learn(directory, self.configs)

            if in_a_child(act) != 0:
                count += 1
                self.note("out of memory", f"{megabytes} MB", directory)
            self.finish(directory, f"{megabytes} MB of memory")
        return count


@contextlib.contextmanager
def small_disk(directory: Path, kilobytes: int) -> Iterator[tuple[Act, Act]]:
    """A tmpfs of so many kB: nothing to limit in the child, and how to make room."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", directory], check=True)
    try:
        yield (
            lambda: None,
            lambda: subprocess.run(["mount", "-o", "remount,size=64m", directory], check=True) and None,
        )
    finally:
        subprocess.run(["umount", directory], check=True)


@contextlib.contextmanager
def small_files(directory: Path, kilobytes: int) -> Iterator[tuple[Act, Act]]:
    """The same without root: files of at most so many kB."""
    yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes * 256, -1)), lambda: None


def full_disk_for_me(place: Path) -> Any:
    """A small tmpfs where it can be mounted, else small files."""
    probe = place / "probe"
    probe.mkdir()
    with contextlib.suppress(subprocess.CalledProcessError, FileNotFoundError), small_disk(probe, 64):
        return small_disk
    return small_files


def examine(
    name: str, kills: int, seed: int, kinds: Sequence[str] = KINDS
) -> tuple[dict[str, Any], list[Kill]]:
    """What is asked for, of one target: counts, and a row for each kill."""
    rng = np.random.default_rng([seed, list(TARGETS).index(name)])
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        bench, counts = Bench(name, place, seed), {}
        if "random" in kinds:
            counts["kills while learning"] = bench.kill_at_random(kills, rng, False)
            counts["kills while saving all the time"] = bench.kill_at_random(kills, rng, True)
        if "files" in kinds:
            counts["kills at a file"] = bench.kill_at_each_file()
        if "disk" in kinds:
            counts["full disks"] = bench.fill_the_disk(full_disk_for_me(place))
        if "memory" in kinds:
            counts["ends of memory"] = bench.exhaust_memory()
    return {"target": name, "seed": seed, "seconds": bench.seconds, **counts, "wrong": bench.wrong}, bench.log


def main() -> int:
    """Examine the targets; print a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100, help="of each kind, of each target")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--targets", nargs="+", choices=list(TARGETS), default=list(TARGETS))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--log", type=Path, help="where to write a row for each kill")
    options = parser.parse_args()
    torch.set_num_threads(1)
    failed, log = False, []
    for name in options.targets:
        counts, rows = examine(name, options.kills, options.seed, options.kinds)
        print(json.dumps(counts), flush=True)
        failed |= bool(counts["wrong"])
        log += rows
        if options.log:
            with files.replacing(options.log) as partial, open(partial, "w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([Kill._fields, *log])
            note_made(options.log)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
