"""Controls that are chosen for where they lead to, against closed forms and a search."""

import numpy as np
import pytest
from scipy.optimize import minimize

from swimmer_mj.learning.problems.held import Memory, held_control, share_of_way


def bowl(minimum, curvature):
    """The slope of V = -sum curvature (x - minimum)^2 / 2."""
    return lambda x: -curvature[:, None] * (x - minimum[:, None])


def test_one_control_of_a_quadratic_value_ends_where_the_value_is_highest():
    """x = coast + gain u: the best u is (minimum - coast) / gain, or at its limit."""
    rng = np.random.default_rng(0)
    coast, gain = rng.normal(size=(1, 200)), rng.uniform(0.5, 2.0, (1, 1, 200))
    u = held_control(bowl(np.zeros(1), np.ones(1)), coast, gain, np.array([0.8]), np.zeros((1, 200)))
    wanted = np.clip(-coast / gain[0], -0.8, 0.8)
    np.testing.assert_allclose(u, wanted, rtol=0, atol=1e-12)
    assert 0 < np.count_nonzero(np.abs(wanted) < 0.8) < 200


@pytest.mark.parametrize("price", [0.0, 0.05, 3.0])
def test_what_it_costs_is_weighed_against_where_it_leads(price):
    """Against the best of many controls, for a quadratic V of two coordinates that one control moves together."""
    rng = np.random.default_rng(1)
    coast, gain = rng.normal(size=(2, 100)), rng.normal(size=(1, 2, 100))
    minimum, curvature = np.array([0.3, -0.1]), np.array([1.0, 4.0])
    u = held_control(bowl(minimum, curvature), coast, gain, np.array([1.0]), np.full((1, 100), price))
    tried = np.linspace(-1, 1, 20001)
    for n in range(100):
        x = coast[:, n, None] + gain[0, :, n, None] * tried
        worth = -(curvature[:, None] * (x - minimum[:, None]) ** 2).sum(axis=0) / 2 - price * tried**2
        assert abs(tried[worth.argmax()] - u[0, n]) < 2e-4


def test_a_control_that_cannot_overstep_is_bang_bang():
    rng = np.random.default_rng(2)
    slope, gain = rng.normal(size=(3, 50)), 1e-6 * rng.normal(size=(2, 3, 50))
    limits = np.array([1.0, 2.0])
    u = held_control(lambda x: slope - 0.1 * x, np.zeros((3, 50)), gain, limits, np.zeros((2, 50)))
    np.testing.assert_array_equal(u, limits[:, None] * np.sign((gain * slope).sum(axis=1)))


def test_several_controls_that_push_the_same_coordinate_do_not_overstep_together():
    coast, gain = np.full((1, 1), -0.1), np.ones((2, 1, 1))
    u = held_control(bowl(np.zeros(1), np.ones(1)), coast, gain, np.ones(2), np.zeros((2, 1)))
    np.testing.assert_allclose(u.sum(), 0.1)


def test_several_controls_of_a_quadratic_value_are_as_a_solver_finds_them():
    """Three controls of three coordinates, V quadratic, not along the axes; some end at their limits."""
    rng = np.random.default_rng(3)
    limits, price = np.array([0.5, 1.0, 2.0]), np.array([0.1, 0.0, 0.3])
    inside = 0
    for _ in range(30):
        root, coast, gain = (
            rng.normal(size=(3, 3)),
            rng.normal(size=3),
            np.eye(3) + 0.3 * rng.normal(size=(3, 3)),
        )
        bowl_at = root @ root.T + np.eye(3)

        def loss(u, bowl_at=bowl_at, coast=coast, gain=gain):
            y = coast + u @ gain
            return y @ bowl_at @ y / 2 + price @ u**2

        u = held_control(
            lambda x, bowl_at=bowl_at: -bowl_at @ x, coast[:, None], gain[:, :, None], limits, price[:, None]
        )[:, 0]
        best = minimize(loss, np.zeros(3), bounds=[(-U, U) for U in limits]).fun
        assert loss(u) - best < 0.01 * (loss(np.zeros(3)) - best)
        inside += np.count_nonzero(np.abs(u) < limits)
    assert 20 < inside < 70


def test_where_value_has_no_top_the_better_limit_is_taken():
    """A saddle: V = x^2 - y^2 with a control for each."""
    coast, gain = np.array([[0.1], [0.2]]), np.eye(2)[:, :, None]
    saddle = np.array([[2.0], [-2.0]])
    u = held_control(lambda x: saddle * x, coast, gain, np.ones(2), np.zeros((2, 1)))
    np.testing.assert_allclose(u, [[1.0], [-0.2]])


@pytest.mark.parametrize(("q", "share"), [(1, 0.001), (2, 0.1), (4, 0.1)])
def test_a_value_that_is_not_quadratic_is_climbed_nearly_to_its_top(q, share):
    """V = -sum_i y_i^4 / 4 - sum_{i<j} y_i y_j / 4: what is lost against a search, of what can be won; flat saddles."""
    rng = np.random.default_rng(4)
    coast, gain = 0.6 * rng.normal(size=(q, 300)), np.tile(np.eye(q)[:, :, None], 300)
    coupling = 0.25 * (1 - np.eye(q))

    def value(y):
        return -(y**4).sum(axis=0) / 4 - (y * np.tensordot(coupling, y, 1)).sum(axis=0) / 2

    def slope(y):
        return -(y**3) - np.tensordot(coupling, y, 1)

    u = held_control(slope, coast, gain, np.ones(q), np.zeros((q, 300)))
    line = np.linspace(-1, 1, 81 if q < 3 else 9)
    tried = np.stack(np.meshgrid(*[line] * q)).reshape(q, -1)
    best = value(coast[:, :, None] + tried[:, None]).max(axis=-1)
    assert (np.abs(u) <= 1).all()
    lost = best - value(coast + u)
    assert lost.max() < 0.15
    assert lost.sum() < share * (best - value(coast)).sum()


def test_a_way_is_gone_to_its_end_or_to_its_top():
    """Along one control from 0 to 1: up at the end, over the top at 1/4, and down from the beginning."""
    way, start = np.ones((1, 3)), np.array([[1.0, 1.0, -1.0]])
    np.testing.assert_allclose(share_of_way(start, np.array([[0.5, -3.0, -2.0]]), way), [1.0, 0.25, 0.0])


def test_a_state_that_has_run_away_says_nothing_and_harms_no_other():
    coast, gain = np.array([[-0.3, np.inf, np.nan]]), np.ones((1, 1, 3))
    u = held_control(bowl(np.zeros(1), np.ones(1)), coast, gain, np.ones(1), np.zeros((1, 3)))
    assert abs(u[0, 0] - 0.3) < 1e-12


def counted(slope):
    """The slope, and how often it was asked for."""
    calls = []

    def ask(x):
        calls.append(x.shape)
        return slope(x)

    return ask, calls


@pytest.mark.parametrize("q", [1, 3])
def test_along_a_trajectory_two_slopes_do(q):
    """A quadratic V whose top moves: what is chosen from memory ends as high as what is chosen from nothing."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(q, q))
    bowl_at, gain = root @ root.T + np.eye(q), np.tile(np.eye(q)[:, :, None], 200)
    start, way = rng.normal(size=(2, q, 200))
    memory, price = Memory(), np.zeros((q, 200))
    slope, calls = counted(lambda x: -bowl_at @ x)
    short = lost = 0.0
    for t in range(30):
        coast = start + 0.03 * t * way
        calls.clear()
        u = held_control(slope, coast, gain, np.ones(q), price, memory)
        assert len(calls) == (2 if t else 2 * q + 4)
        assert (np.abs(u) <= 1).all()
        afresh = held_control(slope, coast, gain, np.ones(q), price)
        heights = [-np.einsum("in,ij,jn->n", y, bowl_at, y) / 2 for y in (coast, coast + u, coast + afresh)]
        short += (heights[2] - heights[1]).sum()
        lost += (heights[2] - heights[0]).sum()
    assert short < 0.001 * lost


def test_a_memory_learns_the_curvature():
    """V = -y^2 (1 + k) / 2 with k of the second choice on: the third is exact again, and the memory knows 1 + k."""
    coast, gain, memory = np.array([[-0.3, 0.2]]), np.ones((1, 1, 2)), Memory()
    for k in (0.0, 3.0, 3.0):
        slope = bowl(np.zeros(1), np.array([1.0 + k]))
        u = held_control(slope, coast, gain, np.ones(1), np.zeros((1, 2)), memory)
        coast = coast + 0.1
    np.testing.assert_allclose(u, -(coast - 0.1), rtol=0, atol=1e-12)
    np.testing.assert_allclose(memory.curvature, np.full((1, 1, 2), -4.0), rtol=1e-12)


def test_what_was_chosen_is_left_where_the_other_limit_becomes_better():
    """V = y^2 / 2, no top: from 0.5 to -0.5 the better limit changes sides, though V rises towards either."""
    memory, gain, price = Memory(), np.ones((1, 1, 1)), np.zeros((1, 1))
    for coast, wanted in ((0.5, 1.0), (0.1, 1.0), (-0.1, -1.0), (-0.5, -1.0)):
        u = held_control(lambda x: x, np.full((1, 1), coast), gain, np.ones(1), price, memory)
        assert u[0, 0] == wanted


def test_trajectories_do_not_share_what_they_remember():
    """One that has run away, and what another was, change nothing for the third."""
    rng = np.random.default_rng(6)
    coast, gain = rng.normal(size=(5, 2, 3)), np.tile(np.eye(2)[:, :, None], 3)
    slope = bowl(np.zeros(2), np.array([1.0, 3.0]))
    alone, together = Memory(), Memory()
    for t in range(5):
        others = coast[t].copy()
        others[:, 1] = np.nan
        u = held_control(slope, others, gain, np.ones(2), np.zeros((2, 3)), together)
        one = held_control(slope, coast[t][:, 2:], gain[..., 2:], np.ones(2), np.zeros((2, 1)), alone)
        np.testing.assert_allclose(u[:, 2:], one, rtol=0, atol=1e-9)


def test_a_choice_begins_at_the_one_before_and_climbs_from_it():
    """V = -sum y^4 / 4 at one state again and again: slopes are asked for at what was chosen, and V never falls."""
    rng = np.random.default_rng(7)
    coast, gain, memory = 0.6 * rng.normal(size=(2, 300)), np.tile(np.eye(2)[:, :, None], 300), Memory()
    asked = []

    def slope(x):
        asked.append(x.copy())
        return -(x**3)

    heights = []
    for _ in range(6):
        asked.clear()
        before = memory.u
        u = held_control(slope, coast, gain, np.ones(2), np.zeros((2, 300)), memory)
        if before is not None:
            np.testing.assert_allclose(asked[0], coast + before, rtol=0, atol=1e-12)
        heights.append(-((coast + u) ** 4).sum(axis=0) / 4)
    rises = np.diff(heights, axis=0)
    assert rises.min() > -1e-6
    assert rises.max() > 1e-5


def test_rounding_teaches_a_memory_nothing():
    rng = np.random.default_rng(8)
    coast, gain, memory = rng.uniform(-0.5, 0.5, (2, 200)), np.tile(np.eye(2)[:, :, None], 200), Memory()
    for _ in range(20):
        held_control(
            lambda x: -x + 1e-9 * rng.normal(size=x.shape),
            coast,
            gain,
            np.ones(2),
            np.zeros((2, 200)),
            memory,
        )
    np.testing.assert_allclose(memory.curvature, np.tile(-np.eye(2)[:, :, None], 200), rtol=0, atol=1e-3)


def test_the_way_from_the_choice_before_is_not_gone_over_the_top():
    """V = -log cosh(8 y) / 8, whose slope changes at its top alone: what the curvature says is mostly too much."""
    rng = np.random.default_rng(9)
    gain, price, memory = np.ones((1, 1, 300)), np.zeros((1, 300)), Memory()
    start, way = 0.6 * rng.normal(size=(2, 1, 300))
    lost = 0.0
    for t in range(20):
        coast = start + 0.05 * t * way
        u = held_control(lambda x: -np.tanh(8 * x), coast, gain, np.ones(1), price, memory)
        best = np.clip(-coast, -1, 1)
        height = [np.log(np.cosh(8 * (coast + v))).mean() / 8 for v in (u, best, 0 * u)]
        lost += (height[0] - height[1]) / (height[2] - height[1]) / 20
    assert lost < 0.03
