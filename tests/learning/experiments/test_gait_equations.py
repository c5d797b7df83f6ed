"""The equations in CasADi, and what is made of them; they need the extra ``gaits``."""

import numpy as np
import pytest

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.parameters import SwimmerParameters

ca = pytest.importorskip("casadi")

from swimmer_mj.learning.experiments.gaits import transcription  # noqa: E402
from swimmer_mj.learning.experiments.gaits.equations import residual  # noqa: E402
from swimmer_mj.learning.experiments.gaits.gait import Gait  # noqa: E402


def derivative(R, z, u):
    """dz/dt with R(z, dz/dt, u) = 0."""
    dz = ca.SX.sym("dz", z.size)
    slope = ca.Function("slope", [dz], [ca.jacobian(R(z, dz, u), dz)])
    return -np.linalg.solve(np.array(slope(0)), np.array(R(z, np.zeros(z.size), u)).ravel())


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_they_are_those_of_the_analytic_swimmer(n):
    rng = np.random.default_rng(n)
    for _ in range(5):
        p = SwimmerParameters(
            n, rng.uniform(0.5, 2, n), rng.uniform(0.5, 2, n), float(rng.uniform(0, 20)), 5.0
        )
        z, u = rng.normal(size=2 * n + 2), rng.uniform(-5, 5, n - 1)
        x = st.expand(p, z)
        expected = st.reduce_derivative(p, x, AnalyticSwimmer(p).derivative(x, u))
        np.testing.assert_allclose(derivative(residual(p), z, u), expected, rtol=1e-10, atol=1e-10)


def test_the_collocation_is_of_order_6():
    """Its row sums are its points, and its quadratures are exact as Gauss's are."""
    A, b, c = transcription.STAGES, transcription.WEIGHTS, transcription.POINTS
    np.testing.assert_allclose(A.sum(axis=1), c)
    for power in range(6):
        assert b @ c**power == pytest.approx(1 / (power + 1))
    np.testing.assert_allclose(A @ c, c**2 / 2)


def test_a_wave_becomes_a_gait_that_swims_against_a_pull():
    """From a start of no dynamics at all; coarse, to be quick."""
    p = SwimmerParameters(n_links=3)
    phase = 2 * np.pi * np.arange(24)[:, None] / 24 - 1.5 * np.arange(3)
    states = st.join_reduced(0.6 * np.sin(phase), 0.6 * np.pi * np.cos(phase), np.tile([1.0, 0.0], (24, 1)))
    start = Gait(p, 2.0, states, np.zeros((24, 2)), np.zeros(3))
    solution = transcription.Program(p, 24).solve(start, 1.0)
    gait = solution.gait
    assert solution.kkt_residual < 1e-6
    assert np.abs(gait.controls).max() <= 5.0
    assert gait.speed == pytest.approx(1.0, abs=1e-4)
    assert np.abs(gait.fine[1]).max() < 1e-4
    assert gait.pull > -1e-6
