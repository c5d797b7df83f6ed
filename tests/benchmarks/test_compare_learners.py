"""Ratios of learning times where some seeds never got there."""

import compare_learners as compare
import numpy as np
import pytest
import robustness


def learner(*times, given=100.0):
    """Seeds that reach 1 m/s after so many seconds; None: never."""
    curves = []
    for time in times:
        at = np.array([0.0, given / 2 if time is None else time, given])
        speed = np.array([0.0, 0.5 if time is None else 1.0, 0.7])
        curves.append(compare.Curve(at, 100 * at, speed))
    return compare.reached(curves, 1.0, "cpu_seconds")


def test_seeds_that_never_got_there_count_as_later_than_all_they_were_given():
    ours, all_there = learner(2.0, 4.0, 6.0), learner(40.0, 60.0, 20.0)
    most, one, none = learner(40.0, None, 60.0), learner(None, 40.0, None), learner(None, None, given=300.0)
    assert (ours.median, ours.known, ours.got_there) == (4.0, True, "3 of 3")
    assert (most.median, most.known, most.got_there) == (60.0, True, "2 of 3")
    assert (one.median, one.known, one.got_there) == (100.0, False, "1 of 3")
    assert (none.median, none.known, none.got_there) == (300.0, False, "0 of 2")
    assert compare.ratio_words(ours, "sac", all_there, "s").endswith("sac median 40 s (3 of 3): 1/10")
    assert compare.ratio_words(ours, "sac", one, "s") == (
        "median 4 s (3 of 3), sac median > 100 s (1 of 3): less than 1/25"
    )
    assert compare.ratio_words(one, "sac", ours, "s").endswith("(3 of 3)")  # nothing is known of the ratio
    assert compare.words(one, "s", 1.0) == "median > 100 s; 1 of 3"
    assert compare.words(ours, "s", 1.0) == "median 4 s; each 2, 4, 6 s; 3 of 3"
    many = learner(2.0, 4.0, 6.0, 3.0, 5.0)
    assert compare.words(many, "s", 1.0).startswith("median 4 s; mean 4 s [2.")


def test_who_was_there_at_the_first_look_may_have_been_there_before():
    looks, speed = np.array([1.0, 2.0]), np.array([1.1, 1.2])
    early = compare.reached([compare.Curve(looks, looks, speed), compare.Curve(looks, looks, speed - 0.2)], 1.0,
                            "cpu_seconds")  # fmt: skip
    assert early.spent.tolist() == [1.0, 2.0]
    assert early.got_there == "2 of 2, 1 by the first look"


def test_top_speed_is_that_of_the_fastest_seed_when_it_was_first_seen():
    looks = np.array([30.0, 60.0, 90.0])
    slow, fast = (compare.Curve(looks, looks, np.array(v)) for v in ([1.0, 1.2, 1.1], [0.9, 1.5, 1.5]))
    assert compare.top_speed_words([slow, fast, slow]) == "1.50 m/s after 60 s"


@pytest.mark.parametrize("path", [compare.RESULTS, compare.PLOT, robustness.OUT], ids=lambda path: path.name)
def test_results_are_in_the_repository_wherever_one_stands(path):
    assert path.is_absolute()
    assert path.stat().st_size > 1000


def test_the_results_are_those_of_ten_seeds_of_each_learner():
    curves = compare.read(compare.RESULTS)
    seeds = dict.fromkeys(("value-gradient", "value-gradient-joints", "td"), 10)
    assert {name: len(of_name) for name, of_name in curves.items()} == seeds
