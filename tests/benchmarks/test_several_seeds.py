"""The command is run, judged and kept once; policies swim against a pull."""

import csv

import gait_shares
import numpy as np
import pytest
import several_seeds

from swimmer_mj.learning.pretrained import load_pretrained


@pytest.mark.filterwarnings("default")
def test_the_one_that_is_left_is_judged_and_not_learned_again(tmp_path, monkeypatch):
    out = tmp_path / "log.csv"
    swim, of_three = (
        gait_shares.swim,
        gait_shares.best_gaits(3),
    )  # of two links none is known, which learn sooner
    monkeypatch.setattr(several_seeds, "swim", lambda policy, pulls: swim(policy, pulls, 0.1, 0.2))
    monkeypatch.setattr(several_seeds, "best_gaits", lambda links: of_three)
    for _ in range(2):
        several_seeds.main(links=2, first=1, times=1, seconds=4.0, evaluate_every=20, out=out)
    with out.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["links"], row["seed"], row["seeds"]) == ("2", "1", "4")
    assert 1 <= int(row["left"]) <= 4
    assert len(row["bests"].split()) == 4
    assert abs(float(row["steady_speed"])) < 3
    assert -3 < float(row["against_2"]) < float(row["against_3"]) < 3  # the pull of 2 m/s is the stronger
    assert 0 <= float(row["folded"]) <= 1


def test_a_policy_swims_as_its_evaluation_says_and_slower_against_a_pull():
    swum = gait_shares.swim(load_pretrained("swim3-value-gradient").policy, np.array([0.0, 0.1]), 10.0, 12.0)
    assert swum.speed.shape == swum.folded.shape == (2, gait_shares.STARTS)
    free, pulled = swum.speed.mean(axis=1)
    assert free == pytest.approx(1.42, abs=0.25)
    assert 0.3 < pulled < free - 0.2


def test_who_folds_is_told_from_who_lies_stretched():
    stretched, folded = (
        gait_shares.swim(load_pretrained(name).policy, np.zeros(1), 3.0, 3.5).folded.mean()
        for name in ("swim5-joints", "swim5-value-gradient")
    )
    assert stretched < 0.3
    assert folded > 0.9
