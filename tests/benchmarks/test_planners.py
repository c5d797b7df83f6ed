"""Planners: their derivatives against autograd and differences, their box against SciPy's, their plans get better."""

import numpy as np
import planners
import pytest
import torch
from peers.ddp import Ddp, DdpSettings, backward, convex, least_in_box
from peers.mppi import Mppi, MppiSettings, softmax
from scipy.optimize import lsq_linear

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.problems.differentiable import transition
from swimmer_mj.learning.problems.forms import TorchForm
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.parameters import SwimmerParameters

UNEQUAL = Swimming(SwimmerParameters(4, mass=[0.5, 1.0, 1.5, 0.7], length=[1.2, 0.8, 1.0, 0.6]))
T, P, Q = 5, 10, 3


def ddp(**settings):
    """A planner with plans well inside their limits, and the states that it starts from."""
    planner = Ddp(UNEQUAL, DdpSettings(horizon=T, hold=2, effort=0.5, **settings), seed=0)
    rng = np.random.default_rng(0)
    states = UNEQUAL.initial_states(rng, LANES)
    planner.plans, planner.damping = rng.uniform(-0.5, 0.5, (T, Q, LANES)), np.full(LANES, 1e-3)
    return planner, states


def test_the_slope_of_a_plans_cost():
    planner, states = ddp()
    assert planner.plans is not None
    x, _ = planner.follow(states.T, planner.plans)
    expansion, costate, slopes = planner.expand(x, planner.plans), np.zeros((LANES, P)), []
    for t in range(T - 1, -1, -1):
        slopes.insert(0, expansion.gradient[t, :, P:] + np.einsum("nij,ni->nj", expansion.B[t], costate))
        costate = expansion.gradient[t, :, :P] + np.einsum("nij,ni->nj", expansion.A[t], costate)
    h = 1e-5
    for t, k in ((0, 1), (2, 2), (T - 1, 0)):
        costs = []
        for sign in (1, -1):
            varied = planner.plans.copy()
            varied[t, k] += sign * h
            costs.append(planner.follow(states.T, varied)[1])
        np.testing.assert_allclose((costs[0] - costs[1]) / (2 * h), slopes[t][:, k], rtol=1e-6, atol=1e-9)


def test_second_derivatives_of_a_held_step():
    planner, states = ddp()
    rng = np.random.default_rng(1)
    w, costates = rng.uniform(-0.5, 0.5, (Q, LANES)), rng.standard_normal((P, LANES))
    found = planner.curvature(states.T.copy(), w, costates, 1)[0]
    form, U = UNEQUAL.form(TorchForm), torch.from_numpy(planner.limits.copy())
    for i in (0, LANES - 1):

        def value(z, i=i):
            x, seen = z[None, :P], []
            for _ in range(2):
                x = transition(form, x, (z[P:] * U)[None], 0.01)
                seen.append(x[0, 8])
            return (torch.from_numpy(costates[:, i].copy()) * x[0]).sum() - torch.stack(seen).mean()

        z = torch.from_numpy(np.concatenate([states[i], w[:, i]]))
        expected = torch.autograd.functional.hessian(value, z).numpy()
        np.testing.assert_allclose(found[i], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_least_in_a_box_is_scipys():
    rng = np.random.default_rng(0)
    roots = rng.standard_normal((50, 4, 4)) + 2 * np.eye(4)
    H, g = roots.swapaxes(1, 2) @ roots, 3 * rng.standard_normal((50, 4))
    low, high = -rng.random((50, 4)), rng.random((50, 4))
    d, free = least_in_box(H, g, low, high, iterations=50)
    for i in range(50):
        expected = lsq_linear(roots[i], -np.linalg.solve(roots[i].T, g[i]), (low[i], high[i]), "bvls").x
        np.testing.assert_allclose(d[i], expected, atol=1e-6)
    inside = (d > low + 1e-9) & (d < high - 1e-9)
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_array_equal(free, inside)


def test_the_convex_part_of_a_matrix():
    H = np.diag([2.0, -3.0, 0.5])
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    np.testing.assert_allclose(
        convex(turn @ H @ turn.T), turn @ np.diag([2.0, 0.0, 0.5]) @ turn.T, atol=1e-12
    )


@pytest.mark.parametrize("second_order", [False, True])
def test_far_from_its_limits_a_plan_is_newtons(second_order):
    """The backward pass gives the step of the whole quadratic model, solved at once."""
    planner, states = ddp(second_order=second_order)
    assert planner.plans is not None
    x, _ = planner.follow(states.T, planner.plans)
    e = planner.expand(x, planner.plans)
    k, K = backward(e, np.zeros_like(planner.plans), np.zeros(LANES))
    i, change, found = 0, np.zeros(P), []
    for t in range(T):
        found.append(k[t, i] + K[t, i] @ change)
        change = e.A[t, i] @ change + e.B[t, i] @ found[-1]
    assert np.abs(found).max() < 1, "no limit is met"
    # x_t = S_t w, all actions in one vector
    S, H, g = np.zeros((P, T * Q)), np.zeros((T * Q, T * Q)), np.zeros(T * Q)
    for t in range(T):
        w = np.zeros((Q, T * Q))
        w[:, t * Q : (t + 1) * Q] = np.eye(Q)
        z = np.concatenate([S, w])
        H += z.T @ e.hessian[t, i] @ z
        g += z.T @ e.gradient[t, i]
        S = e.A[t, i] @ S + e.B[t, i] @ w
    np.testing.assert_allclose(np.ravel(found), -np.linalg.solve(H, g), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("second_order", [False, True])
def test_no_plan_gets_worse_and_all_get_better(second_order):
    planner, states = ddp(second_order=second_order)
    assert planner.plans is not None
    costs = [planner.follow(states.T, planner.plans)[1]] + [planner.improve(states) for _ in range(10)]
    assert (np.diff(costs, axis=0) <= 1e-12).all()
    assert (costs[-1] < costs[0] - 1e-3).all()
    assert np.abs(planner.plans).max() <= 1.0
    np.testing.assert_allclose(planner.follow(states.T, planner.plans)[1], costs[-1], atol=1e-12)


def test_samples_make_plans_better():
    planner = Mppi(UNEQUAL, MppiSettings(samples=64, horizon=10, hold=2), seed=0)
    states = UNEQUAL.initial_states(np.random.default_rng(0), 3)

    def swum(plans):
        x, total = states.T.repeat(LANES, axis=1), 0.0
        for w in plans:
            u = (w * planner.limits[:, None]).repeat(LANES, axis=1)
            reached, velocity = planner.engine.forward(x, u)
            x, total = reached[-1], total + velocity[::LANES] / len(plans)
        return total

    plans = np.zeros((10, Q, 3))
    before = swum(plans)
    for _ in range(20):
        planner._improve(states, plans)
    assert (swum(plans) > before + 0.05).all()
    assert np.abs(plans).max() <= 1.0


def test_weights_of_samples():
    weights = softmax(np.array([[0.0, np.log(3.0)], [1e4, 0.0]]))
    np.testing.assert_allclose(weights, [[0.25, 0.75], [1.0, 0.0]])


def test_a_log_is_gone_on_with_and_the_fastest_swims_the_final(tmp_path, monkeypatch):
    out = tmp_path / "log.csv"
    monkeypatch.setattr(planners, "WINDOWS", ((0, 0.1), (0.1, 0.2), (0.2, 60)))
    for _ in range(2):
        planners.main("tune", ("mppi",), samples=2, seconds=0.24, out=out)
    rows = planners.read(out)
    assert [row["sample"] for row in rows] == ["0", "1"]
    assert rows[0]["30_to_60s"] == ""
    assert float(rows[0]["first_5s"]) != float(rows[1]["first_5s"])
    monkeypatch.setattr(planners, "fastest", lambda rows, name: (1, {"samples": 16, "horizon": 2}))
    planners.main("final", ("mppi",), seconds=0.24, out=out)
    assert planners.read(out)[-1]["stage"] == "final"
