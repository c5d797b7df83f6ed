"""The report's checks at states and parameters that hypothesis looks for, with the tolerances they derive."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays

from swimmer_mj import state as st
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation import disagreement, measure_motion, statements, symmetry_errors
from swimmer_mj.validation.arbiter import LagrangianSwimmer

within = settings(deadline=None, max_examples=25)


def numbers(low, high):
    """Numbers of six decimals: what underflows is not physics."""
    return some.floats(low, high).map(lambda value: round(value, 6))


FRICTION = numbers(0, 50)


@some.composite
def swims(draw, friction=FRICTION):
    """A swimmer, a state and torques, as a batch of one."""
    n = draw(some.integers(1, 6))
    parameters = SwimmerParameters(
        n,
        mass=draw(some.lists(numbers(0.1, 10), min_size=n, max_size=n)),
        length=draw(some.lists(numbers(0.2, 5), min_size=n, max_size=n)),
        viscous_friction=draw(friction),
        torque_limit=draw(some.lists(numbers(0.1, 20), min_size=n - 1, max_size=n - 1)),
    )
    x = draw(arrays.arrays(np.float64, (1, 2 * n + 4), elements=numbers(-10, 10)))
    u = draw(arrays.arrays(np.float64, (1, n - 1), elements=numbers(-20, 20)))
    return parameters, x, u


@given(swims())
@within
def test_statements_and_arbiter_agree_pair_by_pair(swim):
    derivatives, matrices, tolerance = disagreement(*swim)
    for errors in (derivatives, matrices):
        for pair, error in errors.items():
            assert error[0] <= tolerance[0], pair


@given(swims(), numbers(-100, 100), numbers(-7, 7))
@within
def test_place_direction_handedness_and_naming_do_not_matter(swim, shift, angle):
    errors, tolerance = symmetry_errors(*swim, np.array([shift, -shift]), angle)
    for symmetry, by_statement in errors.items():
        for statement, error in by_statement.items():
            assert error[0] <= tolerance[0], (symmetry, statement)


@given(swims())
@within
def test_energy_changes_by_the_powers_alone_and_friction_only_takes(swim):
    motions, tolerance = measure_motion(*swim)
    for statement, m in motions.items():
        size = m.energy_rate_size - m.friction_power + abs(m.torque_power)
        balance = abs(m.energy_rate - m.friction_power - m.torque_power)
        assert balance[0] <= tolerance[0] * size[0], statement
        assert m.friction_power[0] <= 0
        assert m.energy[0] >= 0


@given(swims(friction=some.just(0.0)))
@within
def test_without_friction_no_torque_changes_a_momentum(swim):
    motions, tolerance = measure_motion(*swim)
    for statement, m in motions.items():
        assert np.abs(m.momentum_rate).max() <= tolerance[0] * m.momentum_rate_size[0], statement
        assert abs(m.angular_momentum_rate[0]) <= tolerance[0] * m.angular_momentum_rate_size[0], statement


@given(swims())
@within
def test_the_arbiter_measures_what_it_says(swim):
    """Its energy and momenta against sums over the links, of which it knows nothing."""
    p, x, u = swim
    m = LagrangianSwimmer(p).motion(x, np.zeros_like(x), u)
    state = st.split(x, p.n_links)
    link = (p.lengths * state.angular_velocities)[..., None] * st.link_normals(state.angles)
    velocities = state.velocity[..., None, :] + np.cumsum(link, axis=-2) - link / 2
    centers, spins = st.link_centers(p, x), p.masses * p.lengths**2 / 12 * state.angular_velocities
    energy = (p.masses * (velocities**2).sum(-1) / 2 + spins * state.angular_velocities / 2).sum(-1)
    momentum = (p.masses[:, None] * velocities).sum(-2)
    orbital = p.masses * (centers[..., 0] * velocities[..., 1] - centers[..., 1] * velocities[..., 0])
    np.testing.assert_allclose(m.energy, energy, rtol=1e-12)
    np.testing.assert_allclose(m.momentum, momentum, rtol=1e-12, atol=1e-12 * np.abs(velocities).max() * 60)
    size = np.abs(p.masses[:, None] * velocities).sum() * (np.abs(centers).max() + p.lengths.max())
    np.testing.assert_allclose(m.angular_momentum, (orbital + spins).sum(-1), atol=1e-12 * (size + 1))


@pytest.mark.parametrize("name", ["A.3", "MuJoCo + callback", "MuJoCo + actuators", "Lagrange"])
def test_a_swimmer_at_rest_without_torques_stays_there(name):
    p = SwimmerParameters(3, length=[1.0, 2.0, 0.5])
    x = st.join([1.0, 2.0], [0.1, 2.0, -3.0], [0.0, 0.0], np.zeros(3))
    np.testing.assert_array_equal(statements(p)[name].derivative(x, np.zeros(2)), 0)
