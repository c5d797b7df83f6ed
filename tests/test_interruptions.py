"""``train`` and ``sweep`` under SIGINT and SIGTERM: they finish their step, save, and say how to go on."""

import dataclasses
import shlex
import signal
import subprocess
import sys

import pytest
import torch

from swimmer_mj.cli import main
from swimmer_mj.cli.training import how_to_go_on
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences

SHORT = ["--problem", "pendulum", "--neurons", "10", "--evaluate-every", "20"]


def heed_interrupts():
    """A shell has what it starts in the background ignore SIGINT, and a process hands that on."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*arguments):
    """A command in a process of its own that has printed its first evaluation."""
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "swimmer_mj", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    assert process.stdout is not None
    while "<V>" not in (line := process.stdout.readline()):
        assert line, process.communicate()
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_saves_and_says_how_to_go_on(tmp_path, number):
    process = start("train", "--out", tmp_path / "a run", *SHORT, "--trials", 10**9)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    (line,) = err.splitlines()
    before, _, command = line.partition("; go on with: ")
    assert before == f"swimmer-mj: stopped by {number.name}; saved"
    run = TrainingRun(tmp_path / "a run", resume=True)
    assert run.trial >= 20
    arguments = shlex.split(command)
    assert arguments == [
        "swimmer-mj",
        "train",
        "--out",
        str(tmp_path / "a run"),
        "--resume",
        "--trials",
        "1000000000",
    ]
    arguments[-1] = str(trials := 20 * (run.trial // 20 + 1))
    assert main(arguments[1:]) == 0
    assert main(["train", "--out", str(tmp_path / "whole"), *SHORT, "--trials", str(trials)]) == 0
    one, other = (
        load_checkpoint(tmp_path / name / "checkpoint.safetensors")[0] for name in ("a run", "whole")
    )
    assert torch.equal(one["weight"], other["weight"])


def test_a_second_signal_stops_at_once(tmp_path):
    code = (
        "import os, signal, sys, time\n"
        "from swimmer_mj.cli.signals import asked_to_stop\n"
        "with asked_to_stop() as number:\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    assert number() == signal.SIGTERM\n"
        "    print('noted', flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(60)\n"
        "print('still here')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (-signal.SIGTERM, "noted\n")


def test_signals_that_are_ignored_stay_ignored():
    from swimmer_mj.cli.signals import asked_to_stop

    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with asked_to_stop():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@dataclasses.dataclass(frozen=True)
class OwnPendulum(Pendulum):
    """A problem that does not come with the package."""


def test_how_to_go_on_names_the_modules_that_must_be_trusted(tmp_path):
    run = TrainingRun(tmp_path / "own", RunConfig(OwnPendulum(), TemporalDifferences(TDSettings(), 4)))
    assert how_to_go_on([run], None).endswith(f"--resume --trust {__name__}")


def test_how_to_go_on_names_each_directory_once(tmp_path):
    config = RunConfig(Pendulum(), TemporalDifferences(TDSettings(), 4))
    seeds = [TrainingRun(tmp_path / f"seed-{s}", RunConfig(Pendulum(), config.method, s)) for s in (0, 1)]
    assert how_to_go_on(seeds, None) == f"swimmer-mj train --out {tmp_path} --resume"
    other = TrainingRun(tmp_path / "other", config)
    assert how_to_go_on([seeds[0], other], 7) == (
        f"swimmer-mj train --out {tmp_path / 'seed-0'} --resume --trials 7 && "
        f"swimmer-mj train --out {tmp_path / 'other'} --resume --trials 7"
    )
