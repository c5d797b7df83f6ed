"""The array script for SLURM, run by bash with stand-ins for ``srun`` and ``scontrol``; the same bits as without it."""

import csv
import json
import os
import re
import signal
import subprocess
import time

import pytest
import torch

from swimmer_mj.cli import main
from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.engines.slurm import ranges
from swimmer_mj.learning.runs.jobs import part, state_of
from swimmer_mj.learning.runs.sweep import run_jobs

FILE = """
problem = "pendulum"
trials = 9_000
seeds = "0-1"
evaluate_every = 500

[set]
neurons = 6
trial_duration = 0.5
dtype = "float64"

[grid]
eta = [0.02, 0.04]
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "sweep.toml").write_text(FILE)
    return tmp_path / "sweep.toml"


class Queue:
    """What SLURM does of what the script asks: a job runs with its number, its step gets signals."""

    def __init__(self, place):
        self.place, self.requeued = place, place / "requeued"
        for name, text in {
            "srun": f'while [ "${{1#--}}" != "$1" ]; do shift; done\necho $$ > {place}/step\nexec "$@"\n',
            "scontrol": f'echo "$@" >> {self.requeued}\n',
        }.items():
            path = place / "bin" / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(f"#!/bin/sh\n{text}")
            path.chmod(0o755)

    def start(self, script, index):
        (self.place / "step").unlink(missing_ok=True)
        numbers = {"SLURM_ARRAY_JOB_ID": "100", "SLURM_JOB_ID": "100", "SLURM_ARRAY_TASK_ID": str(index)}
        path = f"{self.place / 'bin'}:{os.environ['PATH']}"
        return subprocess.Popen(["bash", script], env={**os.environ, **numbers, "PATH": path})

    def signal_step(self, number):
        os.kill(int((self.place / "step").read_text()), number)


def array_of(script):
    return re.search(r"^#SBATCH --array=(.*)$", script.read_text(), re.MULTILINE)[1]


def test_an_array_that_is_interrupted_and_requeued_computes_what_one_machine_computes(file, tmp_path, capsys):
    out, queue = tmp_path / "a sweep", Queue(tmp_path)
    command = ["sweep", str(file), "--out", str(out), "--engine", "slurm", "--parts", "2", "--json"]
    assert main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["done"], report["unfinished"]) == (0, 4)
    assert report["submit"] == f"sbatch '{out}/sweep.sbatch'"
    script = out / "sweep.sbatch"
    assert array_of(script) == "1-2"
    assert "\n#SBATCH --requeue\n" in script.read_text()
    assert "\n#SBATCH --signal=TERM@" in script.read_text()

    jobs, trials = read_jobs(file)
    first = part(jobs, 1, 2)
    file.write_text("an edit while the jobs wait")
    job = queue.start(script, 1)
    until = time.monotonic() + 300
    while not any((out / job.name / "checkpoint.safetensors").exists() for job in first):
        assert job.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    queue.signal_step(signal.SIGTERM)
    assert job.wait(timeout=120) == 143
    assert queue.requeued.read_text() == "requeue 100_1\n"
    assert {state_of(out / job.name, trials) for job in first} == {"unfinished"}
    assert queue.start(script, 1).wait(timeout=300) == 0
    assert {state_of(out / job.name, trials) for job in first} == {"done"}

    file.write_text(FILE)
    assert main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["done"], report["unfinished"]) == (2, 2)
    assert array_of(script) == "2"
    assert queue.start(script, 2).wait(timeout=300) == 0
    assert main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["done"], report["unfinished"]) == (4, 0)
    assert "submit" not in report
    assert queue.requeued.read_text() == "requeue 100_1\n"
    with open(out / "sweep.csv", newline="") as text:
        assert [(row["trials"], row["state"]) for row in csv.DictReader(text)] == [("9000", "done")] * 4

    run_jobs(jobs, tmp_path / "local", trials)
    for each in jobs:
        (one, info), (other, info2) = (
            load_checkpoint(where / each.name / "checkpoint.safetensors")
            for where in (out, tmp_path / "local")
        )
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) for name in one)
        assert [row[2:] for row in info["history"]] == [row[2:] for row in info2["history"]]


def test_a_step_that_fails_is_not_requeued(file, tmp_path):
    out, queue = tmp_path / "out", Queue(tmp_path)
    assert main(["sweep", str(file), "--out", str(out), "--engine", "slurm"]) == 0
    (copy,) = (out / "slurm").glob("*.toml")
    copy.unlink()
    assert queue.start(out / "sweep.sbatch", 1).wait(timeout=120) == 2
    assert not queue.requeued.exists()


def test_parts_share_all_jobs_and_stay_the_same(file):
    jobs, _ = read_jobs(file)
    for n in (1, 2, 4, 6, 9):
        parts = [part(jobs, k, n) for k in range(1, n + 1)]
        assert sorted(job.name for one in parts for job in one) == sorted(job.name for job in jobs)
        assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_indices_are_written_as_ranges():
    assert ranges([1, 2, 3, 7, 9, 10]) == "1-3,7,9-10"
    assert ranges([4]) == "4"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--part", "0/3"], "--part must be like 3/20, the third of twenty, got '0/3'"),
        (["--part", "4/3"], "got '4/3'"),
        (["--part", "x"], "got 'x'"),
        (["--part", "1/2", "--engine", "slurm"], "--part is of --engine local, got it with --engine slurm"),
        (["--parts", "2"], "--parts is of --engine slurm, got it with --engine local"),
        (["--parts", "0", "--engine", "slurm"], "parts must be from 1 to 1,000, got 0"),
        (["--address", "head:6379"], "--address is of --engine ray, got it with --engine local"),
    ],
)
def test_options_of_an_engine_are_refused_in_one_line(file, tmp_path, capsys, arguments, complaint):
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), *arguments]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()
