"""The coordinates in which V is compared: one the other's inverse, slopes as differences say, steps as MuJoCo moves."""

import csv

import numpy as np
import pytest
import swimmer_coordinates as compared

from swimmer_mj import state as st
from swimmer_mj.dynamics import to_qpos_qvel
from swimmer_mj.learning.problems.forms import BatchForm
from swimmer_mj.parameters import PAPER


@pytest.fixture
def states():
    rng = np.random.default_rng(0)
    return rng.normal(size=(2 * PAPER.n_links + 2, 32))


def test_there_and_back(states):
    np.testing.assert_allclose(compared.to_absolute(compared.to_joints(states)), states, atol=1e-12)


def test_they_are_mujocos(states):
    """Angles and velocities as MuJoCo has them, the place left out."""
    qpos, qvel = to_qpos_qvel(st.expand(PAPER, states.T), PAPER.n_links)
    n, joints = PAPER.n_links, compared.to_joints(states).T
    np.testing.assert_allclose(np.sin(joints[:, :n] - qpos[:, 2:]), 0, atol=1e-12)
    np.testing.assert_allclose(joints[:, n : 2 * n], qvel[:, 2:], atol=1e-12)
    np.testing.assert_allclose(joints[:, 2 * n :], qvel[:, :2], atol=1e-12)


def test_slopes_are_those_of_differences(states):
    """Of a function of MuJoCo's coordinates, in the built-in state; and back."""
    weights = np.random.default_rng(1).normal(size=len(states))[:, None]

    def value(x):
        return (weights * np.sin(compared.to_joints(x))).sum(axis=0)

    slope = weights * np.cos(compared.to_joints(states))
    found = compared.slope_in_absolute(states, slope)
    for i, push in enumerate(1e-6 * np.eye(len(states))):
        difference = (value(states + push[:, None]) - value(states - push[:, None])) / 2e-6
        np.testing.assert_allclose(found[i], difference, atol=1e-7)
    np.testing.assert_allclose(compared.slope_in_joints(states, found), slope, atol=1e-12)


@pytest.mark.parametrize("held", [False, True])
def test_targets_are_the_same_function_in_either_coordinates(states, held):
    """With V = 0 at the end, g in one is g in the other by the chain rule; so are the trajectories."""
    n, T = PAPER.n_links, 3
    results = {}
    for joints in (False, True):
        problem = compared.ComparedSwimming(compared.Variant(joints, held, 0.5))
        form = problem.form(BatchForm)
        direction = np.random.default_rng(2).normal(size=len(states))[:, None]

        def slope_at(x, joints=joints, direction=direction):
            """Of a value that is linear in the built-in state."""
            slope = np.broadcast_to(direction, x.shape)
            return np.ascontiguousarray(
                compared.slope_in_joints(compared.to_absolute(x), slope) if joints else slope
            )

        x = np.empty((T + 1, *states.shape))
        x[0] = compared.to_joints(states) if joints else states
        u = np.empty((T, n - 1, states.shape[1]))
        for t in range(T):
            form.greedy_step(slope_at, x[t], slope_at(x[t]), np.ones_like(u[t]), 0.01, u[t], x[t + 1])
        V, dVdx = np.zeros((T + 1, states.shape[1])), np.stack([slope_at(y) for y in x])
        out = np.empty((T, len(states) + 1, states.shape[1]))
        form.targets(x, u, V, dVdx, 0.01, 0.5, 1.0, out)
        at = compared.to_absolute(x) if joints else x
        g = compared.slope_in_absolute(at[:-1], out[:, :-1]) if joints else out[:, :-1]
        results[joints] = (at, u, g, out[:, -1])
    for one, other in zip(results[False], results[True], strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_what_is_there_is_not_learned_again(tmp_path):
    out = tmp_path / "looks.csv"
    for _ in range(2):
        compared.main(("joints, held",), seeds=(1,), seconds=0.2, out=out)
    with out.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["algorithm"], row["seed"]) == ("joints, held", "1")
    assert -1 < float(row["ci95_low"]) <= float(row["speed"]) <= float(row["ci95_high"]) < 4
