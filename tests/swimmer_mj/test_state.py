import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from hypothesis.extra import numpy as some_arrays

from swimmer_mj import state as st
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation import random_parameters

sizes = some.integers(1, 8)
seeds = some.integers(0, 2**32 - 1)


def random_state(n, seed, batch=()):
    rng = np.random.default_rng(seed)
    return random_parameters(rng, n), rng.uniform(-4, 4, (*batch, 2 * n + 4))


@given(sizes, seeds)
def test_join_undoes_split(n, seed):
    _, x = random_state(n, seed, (2, 3))
    parts = st.split(x, n)
    assert [part.shape[-1] for part in parts] == [2, n, 2, n]
    np.testing.assert_array_equal(st.join(*parts), x)
    z = x[..., :-2]
    np.testing.assert_array_equal(st.join_reduced(*st.split_reduced(z, n)), z)


@given(sizes, seeds)
def test_reduce_undoes_expand_and_expand_centres(n, seed):
    parameters, x = random_state(n, seed, (3,))
    z = st.reduce(parameters, x)
    centred = st.expand(parameters, z)
    np.testing.assert_allclose(st.reduce(parameters, centred), z, atol=1e-12)
    np.testing.assert_allclose(st.center_of_mass(parameters, centred), 0, atol=1e-12)
    shift = np.concatenate([st.center_of_mass(parameters, x), np.zeros((3, 2 * n + 2))], axis=-1)
    np.testing.assert_allclose(centred + shift, x, atol=1e-12)


@given(sizes, seeds)
def test_links_join_and_have_their_lengths(n, seed):
    parameters, x = random_state(n, seed)
    ends = st.joint_positions(parameters, x)
    np.testing.assert_array_equal(ends[0], x[:2])
    np.testing.assert_allclose(np.linalg.norm(np.diff(ends, axis=0), axis=1), parameters.lengths, rtol=1e-12)


def test_a_chain_by_hand():
    """Links of 2, 1 and 4 m, to the right, up and to the left, from (1, 2)."""
    parameters = SwimmerParameters(3, length=[2.0, 1.0, 4.0])
    x = st.join([1.0, 2.0], [0.0, np.pi / 2, np.pi], [0.0, 0.0], np.zeros(3))
    joints = [[1, 2], [3, 2], [3, 3], [-1, 3]]
    np.testing.assert_allclose(st.joint_positions(parameters, x), joints, atol=1e-15)
    np.testing.assert_allclose(st.link_centers(parameters, x), [[2, 2], [3, 2.5], [1, 3]], atol=1e-15)


@given(sizes, seeds)
def test_velocity_of_the_centre_of_mass_is_its_rate(n, seed):
    parameters, x = random_state(n, seed)
    state = st.split(x, n)
    rate = st.join(state.velocity, state.angular_velocities, np.zeros(2), np.zeros(n))
    h = 1e-6
    after, before = st.center_of_mass(parameters, x + h * rate), st.center_of_mass(parameters, x - h * rate)
    velocity = st.split_reduced(st.reduce(parameters, x), n).velocity
    np.testing.assert_allclose((after - before) / (2 * h), velocity, atol=1e-7)


@given(sizes, seeds)
def test_reduce_derivative_is_the_rate_of_reduce(n, seed):
    parameters, x = random_state(n, seed)
    _, dx = random_state(n, seed + 1)
    state = st.split(x, n)
    dx[: n + 2] = np.concatenate([state.velocity, state.angular_velocities])  # positions move with velocities
    h = 1e-6
    difference = (st.reduce(parameters, x + h * dx) - st.reduce(parameters, x - h * dx)) / (2 * h)
    np.testing.assert_allclose(st.reduce_derivative(parameters, x, dx), difference, atol=1e-6)


@given(some_arrays.arrays(float, (4, 2), elements=some.floats(-5, 5)), some.floats(-10, 10))
def test_rotation_turns_and_turns_back(vectors, angle):
    turned = st.rotate(vectors, angle)
    np.testing.assert_allclose(
        turned[:, 0] + 1j * turned[:, 1], (vectors @ [1, 1j]) * np.exp(1j * angle), atol=1e-12
    )
    np.testing.assert_allclose(st.rotate(turned, -angle), vectors, atol=1e-12)


@pytest.mark.parametrize("shape", [(), (13,), (3, 15)])
def test_refuses_states_of_the_wrong_size(shape):
    with pytest.raises(ValueError, match="must have 14 values on the last axis"):
        st.split(np.zeros(shape), 5)
