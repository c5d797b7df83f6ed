"""The command is run, judged and kept once."""

import csv

import pytest
import several_seeds


@pytest.mark.filterwarnings("default")
def test_the_one_that_is_left_is_judged_and_not_learned_again(tmp_path):
    out = tmp_path / "log.csv"
    for _ in range(2):
        several_seeds.main(links=2, first=1, times=1, seconds=6.0, evaluate_every=20, out=out)
    with out.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["links"], row["seed"], row["seeds"]) == ("2", "1", "4")
    assert 1 <= int(row["left"]) <= 4
    assert len(row["bests"].split()) == 4
    assert abs(float(row["steady_speed"])) < 3
