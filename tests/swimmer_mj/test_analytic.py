import numpy as np
import pytest

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation import random_parameters


@pytest.fixture
def rng():
    return np.random.default_rng(2002)


@pytest.fixture(params=[1, 2, 3, 5, 8])
def swimmer(request, rng):
    return AnalyticSwimmer(random_parameters(rng, request.param))


def random_states_and_torques(swimmer, rng, size=10):
    n = swimmer.parameters.n_links
    return rng.uniform(-3, 3, (size, 2 * n + 4)), rng.uniform(-5, 5, (size, n - 1))


def kinetic_energy(parameters, x):
    """From the velocities of the link centres and rods' inertias, not from A.3."""
    m, l = parameters.masses, parameters.lengths
    state = st.split(x, parameters.n_links)
    t, normal = st.link_directions(state.angles), st.link_normals(state.angles)
    link = (l * state.angular_velocities)[..., None] * normal
    velocities = state.velocity[..., None, :] + np.cumsum(link, axis=-2) - link / 2
    assert t.shape == velocities.shape
    return ((m * (velocities**2).sum(-1)).sum(-1) + (m * l**2 / 12 * state.angular_velocities**2).sum(-1)) / 2


def power(parameters, x, u):
    """Of friction, integrated point by point along the links (A.2's first sentence), and of the motors."""
    state = st.split(x, parameters.n_links)
    nodes, weights = np.polynomial.legendre.leggauss(3)  # exact: the integrand is quadratic
    normal = st.link_normals(state.angles)
    link = (parameters.lengths * state.angular_velocities)[..., None] * normal
    centers = state.velocity[..., None, :] + np.cumsum(link, axis=-2) - link / 2
    total = np.zeros(x.shape[:-1])
    for node, weight in zip(nodes, weights, strict=True):
        v = centers + node / 2 * link
        total -= (
            weight / 2 * parameters.lengths * parameters.viscous_friction * (v * normal).sum(-1) ** 2
        ).sum(-1)
    return total + (u * np.diff(state.angular_velocities, axis=-1)).sum(-1)


def test_energy_changes_by_the_power_of_friction_and_motors(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    dx = swimmer.derivative(x, u)
    h = 1e-6
    p = swimmer.parameters
    rate = (kinetic_energy(p, x + h * dx) - kinetic_energy(p, x - h * dx)) / (2 * h)
    np.testing.assert_allclose(rate, power(p, x, u), rtol=1e-6, atol=1e-5)


def test_momentum_changes_by_the_friction_alone(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    p = swimmer.parameters
    acceleration = st.split_reduced(st.reduce_derivative(p, x, swimmer.derivative(x, u)), p.n_links).velocity
    state = st.split(x, p.n_links)
    normal = st.link_normals(state.angles)
    link = (p.lengths * state.angular_velocities)[..., None] * normal
    centers = state.velocity[..., None, :] + np.cumsum(link, axis=-2) - link / 2
    normal_velocities = (centers * normal).sum(-1)
    force = (-p.viscous_friction * p.lengths * normal_velocities)[..., None] * normal
    np.testing.assert_allclose(p.masses.sum() * acceleration, force.sum(-2), atol=1e-9)


def test_a_rod_decays_exponentially():
    p = SwimmerParameters(1, mass=2.0, length=0.5, viscous_friction=10.0)
    swimmer = AnalyticSwimmer(p)
    # x along, y across the rod, about its centre: m v' = -k l v across, (m l^2/12) w' = -k l^3/12 w
    x = st.join([0.0, 0.0], [0.0], [1.0, 2.0 - 3.0 * 0.25], [3.0])
    state = st.split(swimmer.drift(x), 1)
    rate = 10.0 * 0.5 / 2.0
    angular_acceleration = -rate * 3.0
    np.testing.assert_allclose(state.angular_velocities, [angular_acceleration], rtol=1e-14)
    center_acceleration = np.array([0.0, -rate * 2.0])
    lever = np.array([-(3.0**2) * 0.25, angular_acceleration * 0.25])
    np.testing.assert_allclose(state.velocity, center_acceleration - lever, rtol=1e-14)


def turned(x, n, angle):
    state = st.split(x, n)
    return st.join(
        st.rotate(state.position, angle),
        state.angles + angle,
        st.rotate(state.velocity, angle),
        state.angular_velocities,
    )


def test_turning_the_world_turns_the_motion(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    n = swimmer.parameters.n_links
    expected = st.split(swimmer.derivative(x, u), n)
    actual = st.split(swimmer.derivative(turned(x, n, 0.7), u), n)
    np.testing.assert_allclose(actual.velocity, st.rotate(expected.velocity, 0.7), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(actual.angular_velocities, expected.angular_velocities, rtol=1e-9, atol=1e-9)


def test_a_mirror_image_moves_as_the_mirror_image(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    n = swimmer.parameters.n_links
    mirror = st.join([1, -1], np.full(n, -1), [1, -1], np.full(n, -1))
    np.testing.assert_allclose(
        swimmer.derivative(mirror * x, -u), mirror * swimmer.derivative(x, u), rtol=1e-9, atol=1e-9
    )


def test_place_does_not_matter(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    moved = x.copy()
    moved[:, :2] += [100, -50]
    np.testing.assert_array_equal(swimmer.derivative(moved, u), swimmer.derivative(x, u))


def test_naming_the_links_from_the_other_end_changes_nothing(rng):
    p = random_parameters(rng, 4)
    other = SwimmerParameters(4, p.mass[::-1], p.length[::-1], p.viscous_friction, p.torque_limit[::-1])
    x, u = rng.uniform(-3, 3, 12), rng.uniform(-5, 5, 3)
    state = st.split(x, 4)
    end = st.joint_positions(p, x)[-1]
    end_velocity = state.velocity + (
        (p.lengths * state.angular_velocities)[:, None] * st.link_normals(state.angles)
    ).sum(0)
    y = st.join(end, state.angles[::-1] + np.pi, end_velocity, state.angular_velocities[::-1])
    expected = st.split(AnalyticSwimmer(p).derivative(x, u), 4).angular_velocities
    # u_i acts as +u_i on the link after joint i: from the other end that is the link before it
    actual = st.split(AnalyticSwimmer(other).derivative(y, -u[::-1]), 4).angular_velocities
    np.testing.assert_allclose(actual[::-1], expected, rtol=1e-10)


def test_control_matrix_is_the_derivative_by_the_torques(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng)
    drift, B = swimmer.drift_and_control_matrix(x)
    np.testing.assert_allclose(
        drift + np.einsum("bij,bj->bi", B, u), swimmer.derivative(x, u), rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(drift, swimmer.drift(x), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(B, swimmer.control_matrix(x))


def test_a_torque_turns_the_next_link_forward_and_its_own_back():
    B = AnalyticSwimmer(PAPER).control_matrix(np.zeros(14))
    angular = B[9:]
    for joint in range(4):
        assert angular[joint, joint] < 0 < angular[joint + 1, joint]


def test_a_batch_is_a_loop(swimmer, rng):
    x, u = random_states_and_torques(swimmer, rng, 6)
    n = swimmer.parameters.n_links
    batch = swimmer.derivative(x.reshape(2, 3, -1), u.reshape(2, 3, n - 1))
    one_by_one = [swimmer.derivative(a, b) for a, b in zip(x, u, strict=True)]
    np.testing.assert_allclose(batch.reshape(6, -1), one_by_one, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        swimmer.derivative(x[0], u), swimmer.derivative(np.tile(x[0], (6, 1)), u), rtol=1e-12
    )


@pytest.mark.parametrize(("step", "order"), [("euler_step", 1), ("rk4_step", 4)])
def test_steps_converge_with_their_order(step, order, rng):
    swimmer = AnalyticSwimmer(PAPER)
    x0 = st.expand(PAPER, rng.uniform(-1, 1, 12))
    u = np.array([3.0, -2.0, 1.0, -4.0])

    def final_state(n_steps):
        x = x0
        for _ in range(n_steps):
            x = getattr(swimmer, step)(x, u, 0.4 / n_steps)
        return x

    coarse, fine, finer = (final_state(n) for n in (40, 80, 160))
    measured = np.log2(np.linalg.norm(fine - coarse) / np.linalg.norm(finer - fine))
    assert measured == pytest.approx(order, abs=0.15)


def test_refuses_torques_of_the_wrong_size():
    with pytest.raises(ValueError, match="the torques u of 5 links must have 4 values on the last axis"):
        AnalyticSwimmer(PAPER).derivative(np.zeros(14), np.zeros(5))
