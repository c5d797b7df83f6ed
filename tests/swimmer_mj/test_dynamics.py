import gc

import mujoco
import numpy as np
import pytest

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import Dynamics, MujocoSwimmer, from_qpos_qvel, to_qpos_qvel
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation import random_parameters, relative_error

TOLERANCE = 1e-11


@pytest.mark.parametrize("friction", ["callback", "actuators"])
@pytest.mark.parametrize("n_links", [1, 2, 3, 5, 8])
def test_two_independent_solvers_agree_at_a_thousand_states(n_links, friction):
    rng = np.random.default_rng(n_links)
    for _ in range(20):
        parameters = random_parameters(rng, n_links)
        analytic: Dynamics = AnalyticSwimmer(parameters)
        with_mujoco: Dynamics = MujocoSwimmer(parameters, friction)
        x = rng.uniform(-3, 3, (50, 2 * n_links + 4))
        u = rng.uniform(-1, 1, (50, n_links - 1)) * parameters.torque_limits
        error = relative_error(with_mujoco.derivative(x, u), analytic.derivative(x, u))
        assert error.max() < TOLERANCE
        if n_links > 1:
            error = relative_error(with_mujoco.control_matrix(x), analytic.control_matrix(x), n_axes=2)
            assert error.max() < TOLERANCE


@pytest.fixture(params=["callback", "actuators"])
def swimmer(request):
    parameters = SwimmerParameters(3, mass=[1, 2, 3], length=[0.5, 1, 1.5], torque_limit=[2, 3])
    return MujocoSwimmer(parameters, request.param)


def test_coordinates_survive_there_and_back_unwrapped():
    x = np.random.default_rng(0).uniform(-20, 20, (4, 3, 14))
    np.testing.assert_allclose(from_qpos_qvel(*to_qpos_qvel(x, 5)), x, atol=1e-13)


def test_coordinates_are_mujocos():
    """The points that MuJoCo's kinematics computes are those of the state."""
    parameters = SwimmerParameters(3, length=[0.5, 1.0, 1.5])
    with_mujoco = MujocoSwimmer(parameters)
    x = np.random.default_rng(0).uniform(-20, 20, 10)
    with_mujoco.drift(x)
    data, model = with_mujoco._data, with_mujoco._model
    centers = [data.body(f"link_{i}").xipos[:2] for i in (1, 2, 3)]
    np.testing.assert_allclose(centers, st.link_centers(parameters, x), atol=1e-12)
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, model.body("link_3").id, velocity, 0)
    np.testing.assert_allclose(velocity[2], x[9], atol=1e-12)


def test_torques_are_newton_metres_and_not_clamped(swimmer):
    x = np.random.default_rng(0).uniform(-3, 3, 10)
    u = np.array([30.0, -40.0])  # ten times the limits
    drift, B = swimmer.drift_and_control_matrix(x)
    np.testing.assert_allclose(swimmer.derivative(x, u), drift + B @ u, rtol=1e-11)


def test_batches_broadcast_and_are_loops(swimmer):
    rng = np.random.default_rng(0)
    x, u = rng.uniform(-3, 3, (4, 1, 10)), rng.uniform(-2, 2, (3, 2))
    batch = swimmer.derivative(x, u)
    assert batch.shape == (4, 3, 10)
    for i, j in np.ndindex(4, 3):
        np.testing.assert_allclose(batch[i, j], swimmer.derivative(x[i, 0], u[j]), rtol=1e-12, atol=1e-12)
    drift, B = swimmer.drift_and_control_matrix(x)
    assert drift.shape == (4, 1, 10)
    assert B.shape == (4, 1, 10, 2)
    np.testing.assert_allclose(B[2, 0], swimmer.control_matrix(x[2, 0]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(drift, swimmer.drift(x), rtol=1e-12, atol=1e-12)


def test_friction_by_actuators_never_touches_mujocos_callback(monkeypatch):
    monkeypatch.setattr(mujoco, "set_mjcb_passive", lambda callback: pytest.fail("it was set"))
    swimmer = MujocoSwimmer(PAPER, "actuators")
    assert np.abs(swimmer.drift(np.ones(14))[7:]).max() > 1


def test_a_call_leaves_no_callback(swimmer):
    gc.collect()  # environments that other tests dropped hold the friction until they are collected
    assert mujoco.get_mjcb_passive() is None
    swimmer.drift(np.zeros(10))
    assert mujoco.get_mjcb_passive() is None


@pytest.mark.parametrize(("x", "u"), [((11,), (2,)), ((10,), (3,)), ((10,), ())])
def test_refuses_wrong_shapes(swimmer, x, u):
    with pytest.raises(ValueError, match="on the last axis"):
        swimmer.derivative(np.zeros(x), np.zeros(u))


@pytest.mark.parametrize("step", ["euler_step", "rk4_step"])
def test_steps_are_those_of_the_analytic_swimmer(step):
    rng = np.random.default_rng(0)
    x, u = rng.uniform(-1, 1, 14), rng.uniform(-5, 5, 4)
    y = x
    analytic, with_mujoco = AnalyticSwimmer(PAPER), MujocoSwimmer(PAPER)
    for _ in range(20):
        x, y = getattr(analytic, step)(x, u, 0.01), getattr(with_mujoco, step)(y, u, 0.01)
    np.testing.assert_allclose(y, x, rtol=1e-11, atol=1e-11)
