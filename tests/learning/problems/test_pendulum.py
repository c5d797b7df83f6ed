"""The smallest task: its equations, and that the learner learns it from scratch."""

import numpy as np
import pytest
import torch

from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD


def test_conserves_energy_without_damping():
    pendulum = Pendulum(mass=0.7, length=1.3, damping=0.0)
    inertia, weight_moment, _ = pendulum.constants
    assert (inertia, weight_moment) == pytest.approx((0.7 * 1.3**2, 0.7 * 9.8 * 1.3))

    def energy(x):
        return inertia * x[..., 1] ** 2 / 2 + weight_moment * np.cos(x[..., 0])

    x = pendulum.initial_states(np.random.default_rng(0), 20)
    before = energy(x)
    for _ in range(200):
        x = rk4_step(lambda y: pendulum.drift_and_control_matrix(y)[0], x, 0.005)
    assert energy(x) == pytest.approx(before, abs=1e-6)


def test_small_oscillations_about_hanging_have_the_textbook_period():
    pendulum = Pendulum(damping=0.0)
    x, dt = np.array([np.pi - 1e-3, 0.0]), 0.001
    period = 2 * np.pi * np.sqrt(1 / 9.8)
    for _ in range(round(period / dt)):
        x = rk4_step(lambda y: pendulum.drift_and_control_matrix(y)[0], x, dt)
    assert x[0] == pytest.approx(np.pi - 1e-3, abs=1e-7)


def test_the_motor_cannot_lift_it_straight_up():
    pendulum = Pendulum()
    a, B = pendulum.drift_and_control_matrix(np.array([np.pi / 2, 0.0]))
    assert a[1] == pytest.approx(9.8)
    assert abs(B[1, 0]) * pendulum.control_limits[0] < a[1]


def test_compiled_form_agrees():
    pendulum = Pendulum(mass=0.7, length=1.3, damping=0.2)
    compiled = pendulum.form(CompiledForm)
    for x in pendulum.initial_states(np.random.default_rng(0), 20):
        a, B = np.zeros(2), np.zeros((2, 1))
        compiled.dynamics(compiled.constants, x, a, B)
        expected_a, expected_B = pendulum.drift_and_control_matrix(x)
        assert a == pytest.approx(expected_a, rel=1e-14)
        assert B == pytest.approx(expected_B, rel=1e-14)
        assert compiled.reward(compiled.constants, x) == pytest.approx(pendulum.reward(x))
        z = np.zeros(3)
        compiled.inputs(x, z)
        state = torch.tensor(x, requires_grad=True)
        expected_z = pendulum.inputs(state)
        assert z == pytest.approx(expected_z.detach().numpy(), rel=1e-14)
        dVdz, dVdx = np.array([0.3, -1.2, 0.7]), np.zeros(2)
        compiled.input_pullback(z, dVdz, dVdx)
        (expected_dVdx,) = torch.autograd.grad(expected_z @ torch.tensor(dVdz), state)
        assert dVdx == pytest.approx(expected_dVdx.numpy(), rel=1e-13)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_learns_to_swing_up_and_hold(seed):
    """From hanging and from 64 random states, upright (cos > 0.95 on average) for the last 10 of 20 s.

    Of 16 seeds one needed 8,000 trials, one 6,500, all others 4,000 or less.
    """
    pendulum = Pendulum()
    network = Cascade(3, 20, generator=torch.Generator().manual_seed(seed))
    learner = FusedTD(pendulum, network, TDSettings(eta=0.04))
    rng = np.random.default_rng(seed)
    hanging = np.array([[np.pi, 0.0]])
    starts = np.concatenate([hanging, pendulum.initial_states(np.random.default_rng(100), 64)])
    assert learner.rollout(starts, 20.0, skip=10.0).reward.min() < 0  # not before it has learned
    for _ in range(80):
        learner.train(pendulum.initial_states(rng, 500))
        if learner.rollout(starts, 20.0, skip=10.0).reward.min() > 0.95:
            return
    pytest.fail("did not learn in 40,000 trials")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mass": 0.0}, "mass must be positive and finite, got 0.0"),
        ({"length": float("nan")}, "length must be positive and finite, got nan"),
        ({"torque_limit": -5.0}, "torque_limit must be positive and finite, got -5.0"),
        ({"s_gamma": 0.0}, "s_gamma must be positive and finite, got 0.0"),
        ({"damping": -0.01}, "damping must be finite and not negative, got -0.01"),
        ({"gravity": float("inf")}, "gravity must be finite and not negative, got inf"),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        Pendulum(**arguments)
