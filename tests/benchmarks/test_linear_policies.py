"""The rival without a model: a linear feedback, searched."""

import csv

import numpy as np
import pytest

pytest.importorskip("gymnasium")
import gymnasium
import linear_policies

CUT = np.array([[0.0, 0.0, 0.0, 0.0, 50.0]])
"""Gains that ask for a force of 50 whatever is seen, of a cart that has 3."""


def test_an_episode_is_that_of_the_environment_to_its_end():
    K = np.array([[0.5, 6.0, 0.9, 1.2, 0.01]])
    env = gymnasium.make("InvertedPendulum-v5")
    seen, _ = env.reset(seed=3)
    total, steps, over = 0.0, 0, False
    while not over:
        seen, reward, fell, late, _ = env.step(np.clip(K[:, :4] @ seen + K[:, 4], -3, 3))
        total, steps, over = total + reward, steps + 1, fell or late
    assert steps > 5
    assert linear_policies.play(env, K, 3) == (total, steps)
    fallen, at = linear_policies.play(env, CUT, 3)
    assert at < steps
    assert fallen < total


def test_the_law_moves_to_where_returns_are_high():
    best = np.array([[1.0, -2.0, 0.5]])
    for seed in range(5):
        rng, mean, deviation = np.random.default_rng(seed), np.zeros((1, 3)), np.ones((1, 3))
        for _ in range(30):
            gains = mean + deviation * rng.normal(size=(linear_policies.POPULATION, 1, 3))
            returns = -np.square(gains - best).sum(axis=(1, 2))
            mean, deviation = linear_policies.refit(gains, returns, 0.02)
        assert np.abs(mean - best).max() < 0.1
        assert deviation.min() >= 0.02


def test_a_search_that_is_in_the_table_is_not_done_again(tmp_path):
    out = tmp_path / "new" / "rows.csv"
    for _ in range(2):
        linear_policies.main(("InvertedPendulum-v5",), (0, 1), 0.01, out)
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["task"], row["seed"]) for row in rows if row["look"] == "best"] == [
        ("gymnasium/InvertedPendulum-v5", "0"),
        ("gymnasium/InvertedPendulum-v5", "1"),
    ]
    for row in rows:
        assert float(row["return_min"]) <= float(row["return_mean"]) <= float(row["return_max"])
        assert int(row["simulation_steps"]) >= linear_policies.POPULATION
