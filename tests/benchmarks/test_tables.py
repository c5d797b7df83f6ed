"""The tables of the benchmarks' results."""

import interval_coverage
import numpy as np
import pytest
import tables
from compare_learners import Curve

from swimmer_mj.learning.pretrained import pretrained_card, pretrained_swimmers


def curve(seconds, speeds):
    seconds = np.array(seconds, dtype=float)
    return Curve(seconds, 1000 * seconds, np.array(speeds))


LEARNERS = [curve([1, 2, 4, 8], [0.5, 1.2, 1.6, 1.4]), curve([1, 3, 5], [0.2, 0.9, 1.1])]


def test_learners_are_compared_in_the_time_that_all_had():
    assert tables.budget(LEARNERS) == 5
    equal = [tables.within(one, 5) for one in LEARNERS]
    assert [one.cpu_seconds[-1] for one in equal] == [4, 5]


def test_times_to_a_speed():
    assert tables.time_words(LEARNERS, 2.0) == "none"
    assert tables.time_words(LEARNERS, 1.5) == "> 4.5; 1 seed"
    assert tables.time_words(LEARNERS, 1.0).startswith("3.5; 3.5 [")


def test_the_deepest_fall():
    assert tables.deepest_fall(LEARNERS[0]) == "1.60 to 1.40, at 8.0 s"


def test_students_interval_covers_better_than_the_bootstrap():
    """Of 300 samples of 8 normal values; standard error 0.013 for t."""
    t, percentile, bca, *widths = interval_coverage.coverage("normal", 8, 300, 1)
    assert t == pytest.approx(0.95, abs=0.05)
    assert t > max(percentile, bca)
    assert widths[0] > max(widths[1:])


def test_every_shipped_policy_is_in_the_table_with_the_speed_of_its_card():
    rows = tables.policies().rows
    assert [row[0] for row in rows] == [f"`{name}`" for name in pretrained_swimmers()]
    for row, name in zip(rows, pretrained_swimmers(), strict=True):
        assert float(row[1]) == pytest.approx(pretrained_card(name)["swimming_speed"], abs=0.02)
