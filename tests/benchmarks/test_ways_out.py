"""What is changed of a learner is what the comparison says."""

import csv

import numpy as np
import pytest
import torch
import ways_out

from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings


def learner():
    problem = Swimming(s_gamma=0.5)
    network = Multilayer(problem.n_inputs, (8, 8), generator=torch.Generator().manual_seed(0))
    settings = ValueGradientSettings(trajectories=512, steps=25, minibatch=256)
    return ValueGradientLearner(problem, network, settings, seed=0), problem


def test_flips_are_held_across_rounds():
    one, problem = learner()
    seen = []
    collect = one._engine.collect
    one._engine.collect = lambda weights, x, flips: (seen.append(flips.copy()), collect(weights, x, flips))[1]
    ways_out.held_flips(one, problem, 3)
    for _ in range(20):
        one.step()
    signs = np.concatenate(seen)  # (steps, trajectories, torques)
    assert {*np.unique(signs)} == {-1.0, 1.0}
    assert np.mean(signs[100:] < 0) == pytest.approx(ways_out.FLIPPED, abs=0.005)
    began = (signs[1:] < 0) & (signs[:-1] > 0)
    held = np.lib.stride_tricks.sliding_window_view(signs[1:], ways_out.HOLD, axis=0)
    assert (held[began[: len(held)]] < 0).all()


def test_the_horizon_grows_from_the_first_to_the_last():
    one, problem = learner()
    heed = ways_out.longer_horizon(one, problem, 0)
    found = []
    for steps in (0, ways_out.DURING // 2, ways_out.DURING, 10 * ways_out.DURING):
        heed(steps)
        found.append(one._engine.s_gamma)
    middle = np.sqrt(ways_out.FROM * ways_out.UNTIL)
    assert found == pytest.approx([ways_out.FROM, middle, ways_out.UNTIL, ways_out.UNTIL])


def test_half_of_the_trajectories_begin_near_the_gait():
    one, problem = learner()
    ways_out.gait_starts(one, problem, 0)
    states = one.problem.initial_states(np.random.default_rng(0), 400)
    gait = ways_out.best_gaits(5)[2.0].states
    distance = np.abs(states[:, None] - gait).max(axis=2).min(axis=1)
    assert np.mean(distance < 6 * ways_out.NOISE) == pytest.approx(ways_out.ON_A_GAIT, abs=0.1)
    one.step()


def test_a_learner_is_judged_once(tmp_path, monkeypatch):
    swim = ways_out.swim
    monkeypatch.setattr(ways_out, "swim", lambda policy, pulls: swim(policy, pulls, 0.1, 0.2))
    for _ in range(2):
        ways_out.main(("as train",), seeds=(1,), seconds=0.2, out=tmp_path / "ways-out.csv")
    with (tmp_path / "ways-out.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["name"], row["seed"]) == ("as train", "1")
    assert 0 <= float(row["folded"]) <= 1
