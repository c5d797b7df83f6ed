"""Swimmers whose links are solid, and those whose links are not."""

import csv

import numpy as np
import pytest
import solid_links


def test_initial_states_are_those_in_which_no_links_touch():
    solid = solid_links.model("solid")
    starts = solid_links.draw(np.random.default_rng(0), 50)
    assert not any(solid_links.touching(solid, qpos) for qpos in starts.qpos)
    assert np.abs(starts.qpos[:, 3:]).max() <= np.pi
    folded = np.array([0.0, 0.0, 0.0, 3.1, 0.0, 0.0, 0.0])
    assert solid_links.touching(solid, folded)
    once_around = 2 * np.pi * (np.arange(7) == 3)
    assert solid_links.touching(solid, folded - once_around), "the same posture"
    assert not solid_links.touching(solid, np.full(7, 0.1) + once_around)


@pytest.mark.filterwarnings("ignore::swimmer_mj.learning.problems.caution.CautionWarning")
def test_each_learner_swims_in_both_models_once(tmp_path, monkeypatch):
    monkeypatch.setattr(solid_links, "SPEED", (0.1, 0.3))
    monkeypatch.setattr(solid_links, "EPISODES", 2)
    for _ in range(2):
        solid_links.main(seeds=(1,), seconds=0.1, out=tmp_path / "log.csv")
    with (tmp_path / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["learned"], row["swims"]) for row in rows] == [
        ("passing", "passing"),
        ("passing", "solid"),
        ("solid", "passing"),
        ("solid", "solid"),
    ]


def test_speed_is_that_of_the_centre_of_mass(monkeypatch):
    """Without torques, over a time that is too short for friction to matter."""
    monkeypatch.setattr(solid_links, "SPEED", (0.0, 0.01))
    starts = solid_links.draw(np.random.default_rng(0), solid_links.EPISODES)
    speed, _ = solid_links.swim("passing", lambda now: np.zeros((len(now.qpos), 4)))
    problem = solid_links.problem("passing")
    expected = problem.reward(problem.states(starts)).mean()
    assert speed == pytest.approx(expected, abs=0.03)
