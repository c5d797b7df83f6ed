"""Of several runs the faster go on."""

from types import SimpleNamespace

import pytest

from swimmer_mj.cli import main
from swimmer_mj.learning.runs.halving import train_halving
from swimmer_mj.learning.runs.run import TrainingRun


def halved(bests):
    """Who learned when and for how long, if run k shows its best as soon as it has learned; and who was left."""
    runs = [SimpleNamespace(name=k, best_speed=-float("inf")) for k in range(len(bests))]
    stages = []

    def train(going, seconds):
        stages.append(([run.name for run in going], seconds))
        for run in going:
            run.best_speed = bests[run.name]

    return train_halving(runs, 120.0, train).name, stages


def test_of_four_runs_two_and_one_are_left():
    left, stages = halved([1.0, 3.0, 4.0, 2.0])
    assert stages == [([0, 1, 2, 3], 40.0), ([2, 1], 40.0), ([2], 40.0)]
    assert left == 2


def test_of_an_odd_number_the_larger_half_goes_on_and_a_run_without_a_best_is_slowest():
    left, stages = halved([-float("inf"), 1.0, 0.5])
    assert stages == [([0, 1, 2], 40.0), ([1, 2], 40.0), ([1], 40.0)]
    assert left == 1


def test_the_command_leaves_runs_that_can_be_read_and_names_the_fastest(tmp_path, capsys):
    arguments = ["train", "--method", "value-gradient", "--problem", "pendulum", "--evaluate-every", "10"]
    more = ["--seeds", "0-1", "--halve", "--seconds", "6", "--out", str(tmp_path / "runs")]
    assert main([*arguments, *more]) == 0
    said = capsys.readouterr().out.replace("\n", "")
    runs = [TrainingRun(tmp_path / "runs" / f"seed-{k}", resume=True) for k in (0, 1)]
    (fastest,) = (run.directory for run in runs if f"these go on: {run.directory.name}" in said)
    assert f"the fastest in the end: {fastest}" in said
    assert all(run.history for run in runs)


@pytest.mark.parametrize(
    "more", [["--seconds", "5"], ["--seeds", "0-3"], ["--seeds", "0-3", "--seconds", "5", "--trials", "9"]]
)
def test_without_seeds_and_seconds_it_is_refused(more, tmp_path, capsys):
    assert main(["train", "--out", str(tmp_path / "run"), "--halve", *more]) == 2
    assert "--halve needs several --seeds, and --seconds without --trials" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
