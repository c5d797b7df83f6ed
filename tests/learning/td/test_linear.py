"""Linear value functions: their features, and that they learn the pendulum."""

import math

import numpy as np
import pytest

from swimmer_mj.learning.networks.policy import greedy_control, hamiltonian
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.features import Axis, RadialBasis, TileCoding
from swimmer_mj.learning.td.hamiltonian import hamiltonian_by_difference
from swimmer_mj.learning.td.linear import LinearTD
from swimmer_mj.learning.td.vario_eta import VarioEta

ANGLE = Axis(-math.pi, math.pi, 15, periodic=True)
RATE = Axis(-8.0, 8.0, 15)
RADIAL = RadialBasis((ANGLE, RATE))
TILES = TileCoding((ANGLE, RATE), n_tilings=8)


def learner_for(features, seed=0, **arguments):
    learner = LinearTD(Pendulum(), features, **arguments)
    learner.weight[:] = np.random.default_rng(seed).normal(size=features.size)
    return learner


def states(count, seed=0):
    return np.random.default_rng(seed).uniform([-10, -12], [10, 12], (count, 2))


@pytest.mark.parametrize("features", [RADIAL, RadialBasis((ANGLE, RATE), width=0.3), TILES])
def test_features_sum_to_one_even_beyond_the_grid(features):
    learner = LinearTD(Pendulum(), features)
    for x in [*states(200), np.array([0.0, 1e3])]:
        phi = learner.phi(x)
        assert phi.shape == (features.size,)
        assert phi.sum() == pytest.approx(1.0, abs=1e-12)
        assert (phi >= 0).all()


def test_radial_features_are_normalised_gaussians():
    """Against the definition, features over the whole grid at once, on two line axes."""
    axes = (Axis(-1.0, 2.0, 4), Axis(0.0, 1.0, 3))
    learner = LinearTD(Pendulum(), RadialBasis(axes, width=0.8))
    centres = np.stack(np.meshgrid(np.linspace(-1, 2, 4), np.linspace(0, 1, 3), indexing="ij"), -1)
    for x in np.random.default_rng(0).uniform([-1, 0], [2, 1], (20, 2)):
        a = np.exp(-0.5 * (((x - centres.reshape(-1, 2)) / (0.8 * np.array([1.0, 0.5]))) ** 2).sum(-1))
        assert learner.phi(x) == pytest.approx(a / a.sum(), rel=1e-12)


@pytest.mark.parametrize("features", [RADIAL, TILES])
def test_value_is_linear_in_the_features_and_periodic(features):
    learner = learner_for(features)
    for x in states(50):
        assert learner.value(x) == pytest.approx(learner.weight @ learner.phi(x), rel=1e-10, abs=1e-12)
        around = x + np.array([2 * math.pi, 0.0])
        assert learner.value(around) == pytest.approx(learner.value(x), abs=1e-9)


@pytest.mark.parametrize("period", [2 * math.pi, 3.0])
def test_slope_of_radial_features_by_finite_differences(period):
    learner, h = learner_for(RadialBasis((Axis(-1.0, period - 1.0, 9, periodic=True), RATE))), 1e-6
    for x in states(50):
        slope = learner.slope(x)
        for i, step in enumerate(h * np.eye(2)):
            expected = (learner.value(x + step) - learner.value(x - step)) / (2 * h)
            assert slope[i] == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("width", [1.0, 0.5])
def test_slope_of_tiles_is_that_of_the_average_of_V(width):
    """The average of V over an interval moves by (V(x + h) - V(x - h)) / 2h: here the average is by quadrature."""
    learner = learner_for(TileCoding((ANGLE, Axis(-8.0, 8.0, 12)), n_tilings=4, slope_width=width))
    h = width * 0.5 * np.array([2 * math.pi / 15, 16 / 12])
    for x in np.random.default_rng(3).uniform([-3, -6], [3, 6], (3, 2)):
        slope = learner.slope(x)
        for i in range(2):
            offsets = np.linspace(-h[i], h[i], 4001)[:-1] + h[i] / 4000

            def average(y, i=i, offsets=offsets):
                moved = np.repeat(y[None], len(offsets), axis=0)
                moved[:, i] += offsets
                return np.mean([learner.value(z) for z in moved])

            step = 0.02 * h[i] * np.eye(2)[i]
            difference = (average(x + step) - average(x - step)) / (0.04 * h[i])
            assert slope[i] == pytest.approx(difference, abs=0.002 / h[i])
            ends = [learner.value(x + sign * h[i] * np.eye(2)[i]) for sign in (1, -1)]
            assert slope[i] == pytest.approx((ends[0] - ends[1]) / (2 * h[i]), rel=1e-12, abs=1e-12)


def test_each_tiling_has_one_hit_tile_and_all_states_of_a_box_share_it():
    learner = LinearTD(Pendulum(), TileCoding((ANGLE, RATE), n_tilings=8))
    for x in states(50):
        assert np.count_nonzero(learner.phi(x)) == 8
        assert set(learner.phi(x)[learner.phi(x) > 0]) == {1 / 8}
    one = LinearTD(Pendulum(), TileCoding((Axis(0.0, 4.0, 4), Axis(0.0, 2.0, 2)), n_tilings=1))
    assert np.array_equal(one.phi(np.array([1.1, 0.1])), one.phi(np.array([1.9, 0.9])))
    assert not np.array_equal(one.phi(np.array([1.1, 0.1])), one.phi(np.array([2.1, 0.1])))


def test_tilings_are_displaced_differently():
    """Along one axis, 8 displaced grids of unit boxes tell 8 places within a box apart."""
    learner = LinearTD(Pendulum(), TileCoding((Axis(0.0, 4.0, 4), Axis(0.0, 4.0, 4)), n_tilings=8))
    along = [tuple(learner.phi(np.array([1.0 + (k + 0.5) / 8, 1.5]))) for k in range(8)]
    assert len(set(along)) == 8


def test_trace_of_a_constant_gradient_in_closed_form():
    """At a state that does not move, e_k = phi (1 - (1 - s dt)^k) / s, s = s_gamma + s_lambda."""
    problem = Pendulum(torque_limit=1e-15)
    upright = np.zeros((1, 2))  # an equilibrium
    for steps in (1, 7, 300):
        settings = TDSettings(eta=1e-300, s_lambda=0.4, trial_duration=steps * 0.01)
        learner = LinearTD(problem, RADIAL, settings)
        learner.train(upright)
        expected = learner.phi(upright[0]) * (1 - (1 - 1.4 * 0.01) ** steps) / 1.4
        assert learner.trace == pytest.approx(expected, rel=1e-11, abs=1e-16)


@pytest.mark.parametrize(
    ("features", "form"), [(RADIAL, "gradient"), (RADIAL, "difference"), (TILES, "difference")]
)
def test_a_trial_is_equation_2_written_out(features, form):
    problem, settings = Pendulum(), TDSettings(eta=3.0, s_lambda=2.0, trial_duration=0.2)
    learner = learner_for(features, settings=settings, hamiltonian=form)
    twin = learner_for(features)
    w, e, x = twin.weight, np.zeros(features.size), np.array([0.4, -1.0])
    statistics = learner.train(x[None])
    values = []
    for _ in range(20):
        a, B = problem.drift_and_control_matrix(x)
        dVdx, V, phi = twin.slope(x), twin.value(x), twin.phi(x)
        f = a + B @ greedy_control(B, dVdx, problem.control_limits)
        r = float(problem.reward(x))
        H = hamiltonian(r, V, dVdx, f, 1.0)
        if form == "difference":
            H = hamiltonian_by_difference(r, V, twin.value(x + 0.01 * f), 1.0, 0.01)
        w += 0.01 * 3.0 * H * e
        e += 0.01 * (-3.0 * e + phi)
        x = x + 0.01 * f
        values.append(V)
    assert np.abs(w - learner_for(features).weight).max() > 1e-3  # it did learn
    assert learner.weight == pytest.approx(w, rel=1e-9, abs=1e-11)
    assert learner.trace == pytest.approx(e, rel=1e-9, abs=1e-13)
    assert statistics.value[0] == pytest.approx(np.mean(values), rel=1e-9)


@pytest.mark.parametrize("features", [RADIAL, TILES])
def test_traces_begin_anew_in_each_trial(features):
    starts = np.array([[0.4, -1.0], [-2.0, 1.0], [0.5, -1.0]])
    at_once, one_by_one = learner_for(features), learner_for(features)
    at_once.train(starts)
    for start in starts:
        one_by_one.train(start[None])
    assert np.array_equal(at_once.weight, one_by_one.weight)
    assert np.array_equal(at_once.trace, one_by_one.trace)


def test_rollout_is_the_integral_of_the_reward():
    """From equilibrium with V = 0 nothing moves: the reward is cos(0) and the return that of a constant."""
    rollout = LinearTD(Pendulum(), RADIAL).rollout(np.zeros((1, 2)), 2.0, skip=1.0)
    assert rollout.reward[0] == pytest.approx(1.0, rel=1e-12)
    assert rollout.discounted_return[0] == pytest.approx(1 - math.exp(-2), rel=1e-9)


@pytest.mark.parametrize(
    ("features", "eta", "trials"),
    [
        (RADIAL, 10.0, 1000),
        (TileCoding((Axis(-math.pi, math.pi, 12, True), Axis(-8.0, 8.0, 12)), 32), 30.0, 6000),
    ],
    ids=["radial", "tiles"],
)
def test_learns_to_swing_up_and_hold(features, eta, trials):
    """The criterion of the cascade's test: from hanging and from random states, upright for the last 10 of 20 s.

    Each of 16 seeds needed 250 trials with radial features, and 500 to 1,750 with tiles.
    """
    pendulum = Pendulum()
    learner = LinearTD(pendulum, features, TDSettings(eta=eta))
    rng = np.random.default_rng(0)
    starts = np.concatenate([[[np.pi, 0.0]], pendulum.initial_states(np.random.default_rng(100), 31)])
    assert learner.rollout(starts, 20.0, skip=10.0).reward.min() < 0
    for _ in range(trials // 250):
        learner.train(pendulum.initial_states(rng, 250))
        if learner.rollout(starts, 20.0, skip=10.0).reward.min() > 0.95:
            return
    pytest.fail(f"did not learn in {trials} trials")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Axis(1.0, 1.0, 3), "low must be below high and both finite, got 1.0 and 1.0"),
        (lambda: Axis(0.0, 1.0, 1), "count must be at least 2, got 1"),
        (lambda: RadialBasis(()), "axes must have at least one axis, got none"),
        (lambda: RadialBasis((ANGLE,), width=0.0), "width must be positive and finite, got 0.0"),
        (lambda: TileCoding((ANGLE,), n_tilings=0), "n_tilings must be at least 1, got 0"),
        (lambda: TileCoding((ANGLE,), slope_width=-1.0), "slope_width must be positive and finite, got -1.0"),
        (lambda: LinearTD(Swimming(), RADIAL), "swim5 has 12 state variables, the features 2"),
        (
            lambda: LinearTD(Swimming(held=True), RADIAL),
            "problem 'swim5' has no compiled form; use SteppedTD",
        ),
        (lambda: LinearTD(Pendulum(), TILES, hamiltonian="gradient"), "hamiltonian must be 'difference'"),
        (
            lambda: LinearTD(Pendulum(), TILES).train(np.zeros((1, 3))),
            r"must have shape \(count, 2\), got \(1, 3\)",
        ),
        (
            lambda: LinearTD(Pendulum(), TILES).sample(np.zeros(2)),
            r"must have shape \(count, 2\), got \(2,\)",
        ),
        (
            lambda: LinearTD(Pendulum(), TILES).value(np.zeros(3)),
            r"must have shape \(count, 2\), got \(1, 3\)",
        ),
        (
            lambda: LinearTD(Pendulum(), TILES).rollout(np.zeros((1, 2)), 1.0, 0.999),
            "got skip 0.999 and duration 1.0",
        ),
        (lambda: LinearTD(Pendulum(), RADIAL, TDSettings(vario=VarioEta())), "settings.vario must be None"),
    ],
)
def test_refuses(make, message):
    with pytest.raises(ValueError, match=message):
        make()
