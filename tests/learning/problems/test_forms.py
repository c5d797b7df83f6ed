"""All forms of a problem state the same problem: each is held against its functions in NumPy."""

import numpy as np
import pytest
import torch

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.networks.batched import BLOCK
from swimmer_mj.learning.problems.cart_pole import CartPole
from swimmer_mj.learning.problems.forms import (
    BatchForm,
    CompiledForm,
    EnvironmentForm,
    LanesForm,
    SwimmerForm,
    TorchForm,
    TrialsForm,
)
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.parameters import SwimmerParameters

UNEQUAL = SwimmerParameters(4, [1, 2, 0.5, 1.5], [0.6, 1.2, 0.9, 1.0], 6.0, [3.0, 5.0, 2.0])
FORMS = {TorchForm, CompiledForm, LanesForm, BatchForm}
PROBLEMS = {
    "swim5": (Swimming(), FORMS),
    "unequal": (Swimming(UNEQUAL), FORMS),
    "raw angles": (Swimming(UNEQUAL, encoding="angle"), {TorchForm, CompiledForm, LanesForm}),
    "unwrapped angles": (Swimming(UNEQUAL, encoding="unwrapped"), {TorchForm, CompiledForm, LanesForm}),
    "pendulum": (Pendulum(mass=1.3, length=0.8, damping=0.2), {TorchForm, CompiledForm}),
    "cart-pole": (CartPole(cart_mass=2.0, pole_mass=0.4), {TorchForm}),
}


def every(kind):
    """All problems that offer a form."""
    offered = [pytest.param(problem, id=name) for name, (problem, forms) in PROBLEMS.items() if kind in forms]
    return pytest.mark.parametrize("problem", offered)


@pytest.fixture
def states(problem):
    """Initial ones, the angles of swimmers after some turns."""
    rng = np.random.default_rng(0)
    x = problem.initial_states(rng, BLOCK)
    if isinstance(problem, Swimming):
        n = problem.parameters.n_links
        x[:, :n] += 2 * np.pi * rng.integers(-2, 3, (BLOCK, n))
    return x


@pytest.fixture
def slopes(states):
    return np.random.default_rng(1).normal(size=states.shape)


def close(found, expected, rtol=1e-10):
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def greedy(problem, x, dVdx):
    a, B = problem.drift_and_control_matrix(x)
    u = problem.control_limits * np.sign(np.einsum("npq,np->nq", B, dVdx))
    return u, a + np.einsum("npq,nq->np", B, u)


@pytest.mark.parametrize("name", PROBLEMS)
def test_offers_what_it_has(name):
    problem, offered = PROBLEMS[name]
    assert {kind for kind in FORMS if problem.form(kind) is not None} == offered


def test_only_swimmers_have_an_environment():
    for name, (problem, _) in PROBLEMS.items():
        swims = name in ("swim5", "unequal", "raw angles", "unwrapped angles")
        assert (problem.form(EnvironmentForm) is not None) == swims
        assert (problem.form(SwimmerForm) is not None) == swims
        assert problem.form(TrialsForm) is None
    assert Swimming(physics="mujoco").form(TrialsForm) is not None


@every(TorchForm)
def test_torch_form(problem, states):
    form, x = problem.form(TorchForm), torch.from_numpy(states)
    a, B = problem.drift_and_control_matrix(states)
    close(form.drift(x).numpy(), a)
    close(form.control_matrix(x).numpy(), B)
    close(form.reward_rate(x).numpy(), problem.reward(states))


@every(CompiledForm)
def test_compiled_form(problem, states):
    form = problem.form(CompiledForm)
    a, B = problem.drift_and_control_matrix(states)
    inputs = torch.from_numpy(states).requires_grad_()
    z = problem.inputs(inputs)
    dVdz = np.random.default_rng(2).normal(size=z.shape)
    (dVdx,) = torch.autograd.grad((z * torch.from_numpy(dVdz)).sum(), inputs)
    for i, x in enumerate(states):
        found_a, found_B = np.zeros_like(a[i]), np.zeros_like(B[i])
        form.dynamics(form.constants, x, found_a, found_B)
        close(found_a, a[i])
        close(found_B, B[i])
        assert form.reward(form.constants, x) == pytest.approx(problem.reward(x), rel=1e-12)
        found_z, found_dVdx = np.zeros(z.shape[1]), np.zeros_like(x)
        form.inputs(x, found_z)
        close(found_z, z[i].detach().numpy(), 1e-12)
        form.input_pullback(found_z, dVdz[i], found_dVdx)
        close(found_dVdx, dVdx[i].numpy(), 1e-11)


@every(LanesForm)
def test_lanes_form(problem, states, slopes):
    form = problem.form(LanesForm)
    states, slopes = states[:LANES], slopes[:LANES]
    p, q, m = problem.state_size, len(problem.control_limits), problem.n_inputs
    x, dVdx = states.T.ravel().copy(), slopes.T.ravel().copy()
    u, f, r = np.zeros(q * LANES), np.zeros(p * LANES), np.zeros(LANES)
    form.greedy(form.constants, problem.control_limits, x, dVdx, u, f, r)
    expected_u, expected_f = greedy(problem, states, slopes)
    np.testing.assert_array_equal(u.reshape(q, LANES).T, expected_u)
    close(f.reshape(p, LANES).T, expected_f)
    close(r, problem.reward(states))
    z, back = np.zeros((1, m, LANES)), np.zeros(p * LANES)
    form.encode(form.constants, x, z, 0)
    inputs = torch.from_numpy(states).requires_grad_()
    expected_z = problem.inputs(inputs)
    close(z[0].T, expected_z.detach().numpy(), 1e-12)
    dVdz = np.random.default_rng(2).normal(size=(m, LANES))
    (expected,) = torch.autograd.grad((expected_z * torch.from_numpy(dVdz.T)).sum(), inputs)
    form.pull_back(form.constants, z, 0, dVdz, back)
    close(back.reshape(p, LANES).T, expected.numpy(), 1e-11)


@every(BatchForm)
def test_batch_form(problem, states, slopes):
    form = problem.form(BatchForm)
    dt, q = 0.01, len(problem.control_limits)
    flips = np.random.default_rng(3).choice([-1.0, 1.0], (BLOCK, q))
    expected_u, _ = greedy(problem, states, slopes)
    expected_u = expected_u * flips
    x, dVdx, turned = (np.ascontiguousarray(y.T) for y in (states, slopes, flips))
    u, y = np.zeros((q, BLOCK)), np.zeros_like(x)
    form.greedy_step(None, x, dVdx, turned, dt, u, y)
    np.testing.assert_array_equal(u.T, expected_u)
    close(y.T, problem.step(states, expected_u, dt))
    form.greedy_rk4(None, x, dVdx, turned, 1e-3, u, y)
    by_rk4 = Swimming(problem.parameters, integrator="rk4").step(states, expected_u, 1e-3)
    close(y.T, by_rk4, 1e-8)  # RK4 of the full state is not that of the reduced one
    close(form.reward(x, u), problem.reward(states))


def test_a_subclass_with_equations_of_its_own_hands_on_no_form():
    class Windy(Swimming):
        def reward(self, x):
            return super().reward(x) - 1.0

    class Heavy(Pendulum):
        def reward(self, x):
            return 2 * super().reward(x)

    for problem in (Windy(), Heavy()):
        for kind in FORMS | {EnvironmentForm, SwimmerForm, TrialsForm}:
            assert problem.form(kind) is None
