"""What the log of the killed node says was compared."""

import shutil

import killed_node
import pytest

from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.sweep import run_jobs

STUDY = """
problem = "pendulum"
trials = 4
seeds = "0-1"
evaluate_every = 2

[set]
neurons = 4
dtype = "float64"
"""


@pytest.fixture
def twice(tmp_path):
    """Runs, and a copy of them."""
    (tmp_path / "study.toml").write_text(STUDY)
    jobs, trials = read_jobs(tmp_path / "study.toml")
    run_jobs(jobs, tmp_path / "one", trials)
    shutil.copytree(tmp_path / "one", tmp_path / "other")
    return jobs, tmp_path / "one", tmp_path / "other"


def test_what_differs_is_counted(twice):
    jobs, one, other = twice
    compared, *different = killed_node.differing(*twice)
    assert compared > 100
    assert different == [0, 0]
    path = other / jobs[1].name / "checkpoint.safetensors"
    tensors, info = load_checkpoint(path)
    name = max(tensors, key=lambda name: tensors[name].numel())
    tensors[name].view(-1)[0] += 1
    save_checkpoint(path, tensors, info)
    log = other / jobs[0].name / "metrics.csv"
    log.write_text(log.read_text().replace("\n4,", "\n5,"))
    assert killed_node.differing(jobs, one, other) == (compared, 1, 1)
    assert killed_node.metrics(one / "nowhere") == []


def test_what_ray_says_of_itself_is_left_out():
    log = killed_node.Log()
    printed = [
        "node 10.0.0.7 was lost\n",
        "\x1b[33m(raylet)\x1b[0m terminated\n",
        "    [state-dump]\n",
        " \n",
    ]
    killed_node.follow(printed, "10.0.0.7", log)
    assert [line.partition(" s  ")[2] for line in log.lines] == ["sweep: node HOST was lost"]


def test_in_the_log_a_node_was_lost_and_no_bit_with_it():
    text = killed_node.OUT.read_text(encoding="utf-8")
    assert "was lost; its runs go on from their last checkpoints" in text
    assert "checkpoints compared: 0 differ" in text
    assert "evaluations of 6 runs compared: those of 0 differ" in text
