"""The compiled equations, their pullback and the compiled networks, each against another statement of the same."""

import math

import numpy as np
import pytest
import torch
from numba import njit

from swimmer_mj.compiled.elementary import cos_sin_of_lanes, tanh_of_many
from swimmer_mj.compiled.vectors import LANES, load, sign, store
from swimmer_mj.learning.networks.batched import BatchedNetwork
from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.problems.differentiable import transition, transition_pullback
from swimmer_mj.learning.problems.forms import BatchForm, TorchForm
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.batched_costates import pullback
from swimmer_mj.learning.problems.swim.batched_equations import greedy_rk4, greedy_step, step, workspace
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.value_gradient.equations import value_and_gradient_loss
from swimmer_mj.parameters import PAPER, SwimmerParameters

UNEQUAL = SwimmerParameters(
    n_links=5,
    mass=[0.5, 1.0, 1.5, 0.7, 2.0],
    length=[1.2, 0.8, 1.0, 0.6, 1.4],
    viscous_friction=6.0,
    torque_limit=[5.0, 4.0, 3.0, 6.0],
)
THREE = SwimmerParameters(n_links=3, mass=[1.0, 2.0, 0.5])
N = 4 * LANES


def states_and_slopes(problem, seed=0):
    rng = np.random.default_rng(seed)
    x = problem.initial_states(rng, N)
    n = problem.parameters.n_links
    x[:, :n] *= 10  # several turns
    x[:, n:] *= 3
    return x, rng.normal(size=x.shape), rng.choice([-1.0, 1.0], (N, n - 1))


@pytest.mark.parametrize("parameters", [PAPER, UNEQUAL, THREE], ids=["paper", "unequal", "three links"])
def test_torch_form_agrees_with_the_equations_of_the_paper(parameters):
    problem = Swimming(parameters)
    x, _, _ = states_and_slopes(problem)
    a, B = problem.drift_and_control_matrix(x)
    form, states = problem.form(TorchForm), torch.from_numpy(x)
    found = form.drift(states).numpy(), form.control_matrix(states).numpy()
    assert found[0] == pytest.approx(a, rel=1e-10, abs=1e-11)
    assert found[1] == pytest.approx(B, rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("parameters", [PAPER, UNEQUAL, THREE], ids=["paper", "unequal", "three links"])
def test_greedy_steps(parameters):
    problem, dt = Swimming(parameters), 0.01
    x, dVdx, flips = states_and_slopes(problem)
    _, B = problem.drift_and_control_matrix(x)
    u = flips * parameters.torque_limits * np.sign(np.einsum("npq,np->nq", B, dVdx))
    ws, constants = workspace(parameters.n_links), reduced_constants(parameters)
    columns = [np.ascontiguousarray(y.T) for y in (x, dVdx, flips)]
    torques, after = np.empty_like(columns[2]), np.empty_like(columns[0])
    greedy_step(ws, constants, parameters.torque_limits, *columns, dt, torques, after)
    assert (torques.T == u).all()
    assert after.T == pytest.approx(problem.step(x, u, dt), rel=1e-11, abs=1e-12)
    greedy_rk4(ws, constants, parameters.torque_limits, *columns, 1e-3, torques, after)
    assert after.T == pytest.approx(
        Swimming(parameters, integrator="rk4").step(x, u, 1e-3), rel=1e-8, abs=1e-8
    )


@pytest.mark.parametrize("parameters", [PAPER, UNEQUAL, THREE], ids=["paper", "unequal", "three links"])
def test_pullback_is_the_transposed_jacobian(parameters):
    problem, dt = Swimming(parameters), 0.03
    x, costate, signs = states_and_slopes(problem)
    u = signs * parameters.torque_limits
    expected = transition_pullback(
        problem.form(TorchForm), *map(torch.tensor, (x, u)), dt, torch.tensor(costate)
    )
    columns = [np.ascontiguousarray(y.T) for y in (x, u, costate)]
    found, of_torques = np.empty_like(columns[0]), np.empty_like(columns[1])
    ws, constants = workspace(parameters.n_links), reduced_constants(parameters)
    pullback(ws, constants, columns[0], columns[1], dt, columns[2], found, of_torques)
    assert found.T == pytest.approx(expected.numpy(), rel=1e-9, abs=1e-10)
    _, B = problem.drift_and_control_matrix(x)
    assert of_torques.T == pytest.approx(dt * np.einsum("npq,np->nq", B, costate), rel=1e-9, abs=1e-10)
    step(ws, constants, columns[0], columns[1], dt, columns[0])
    assert columns[0].T == pytest.approx(problem.step(x, u, dt), rel=1e-11, abs=1e-12)
    # and torch's is the transposed Jacobian, by central differences
    y, h = torch.tensor(x), 1e-6
    for i in range(x.shape[1]):
        e = torch.zeros(x.shape[1], dtype=torch.float64)
        e[i] = h
        torques = torch.tensor(u)
        column = (
            transition(problem.form(TorchForm), y + e, torques, dt)
            - transition(problem.form(TorchForm), y - e, torques, dt)
        ) / (2 * h)
        assert expected[:, i].numpy() == pytest.approx((column.numpy() * costate).sum(1), rel=1e-5, abs=1e-5)


NETWORKS = {
    "layers": lambda g: Multilayer(17, (16, 8, 5), generator=g, dtype=torch.float64),
    "one layer": lambda g: Multilayer(17, (7,), generator=g, dtype=torch.float64),
    "cascade": lambda g: Cascade(17, 22, generator=g, dtype=torch.float64),
    "cascade of whole groups": lambda g: Cascade(17, 9, generator=g, dtype=torch.float64),
}


@pytest.mark.parametrize("kind", NETWORKS)
def test_network_its_slope_and_the_gradient_of_a_loss_in_both(kind):
    problem, generator = Swimming(), torch.Generator().manual_seed(0)
    network = NETWORKS[kind](generator)
    with torch.no_grad():
        for w in network.parameters():
            w += 0.3 * torch.randn(w.shape, generator=generator, dtype=torch.float64)
        if isinstance(network, Cascade):
            network.weight *= network.connected
    x, g, _ = states_and_slopes(problem)
    G, slope_weights = np.random.default_rng(1).normal(size=N), np.linspace(0.5, 2.0, 12)
    state = torch.tensor(x, requires_grad=True)
    V = network(problem.inputs(state))
    (dVdx,) = torch.autograd.grad(V.sum(), state, create_graph=True)
    loss, *errors = value_and_gradient_loss(
        V, torch.tensor(G), dVdx, torch.tensor(g), 1.3, torch.tensor(slope_weights)
    )
    expected = torch.cat([y.flatten() for y in torch.autograd.grad(loss, list(network.parameters()))])

    compiled = BatchedNetwork(network, Swimming().form(BatchForm).encoding, 12)
    weights = torch.cat([w.detach().flatten() for w in network.parameters()])
    z, found_V, found_slope = np.empty((17, N)), np.empty(N), np.empty((12, N))
    compiled.judge(weights, np.ascontiguousarray(x.T), z, found_V, found_slope)
    assert z.T == pytest.approx(problem.inputs(state).detach().numpy(), rel=1e-13, abs=1e-15)
    assert found_V == pytest.approx(V.detach().numpy(), rel=1e-12, abs=1e-13)
    assert found_slope.T == pytest.approx(dVdx.detach().numpy(), rel=1e-11, abs=1e-13)
    data = np.concatenate([z, g.T, G[None]])
    gradient = torch.empty_like(weights)
    found = compiled.loss_gradient(weights, data, 0, N, 1.3, slope_weights, gradient)
    assert found == pytest.approx([float(e.detach()) for e in errors], rel=1e-12)
    assert gradient.numpy() == pytest.approx(expected.numpy(), rel=1e-10, abs=1e-12)


def test_vector_functions():
    @njit
    def apply(x, c, s, signs):
        a, b = cos_sin_of_lanes(load(x, 0))
        store(c, 0, a)
        store(s, 0, b)
        store(signs, 0, sign(load(x, 0)))

    @njit
    def apply_tanh(x, y):
        store(y, 0, tanh_of_many(load(x, 0)))

    for scale in (1.0, 30.0, 1e4):
        x = np.random.default_rng(0).uniform(-scale, scale, LANES)
        x[0] = 0.0
        c, s, signs = np.empty(LANES), np.empty(LANES), np.empty(LANES)
        apply(x, c, s, signs)
        assert np.abs(c - np.cos(x)).max() < 1e-15 * max(1, scale / 1e3)
        assert np.abs(s - np.sin(x)).max() < 1e-15 * max(1, scale / 1e3)
        assert (signs == np.sign(x)).all()
    for limit in (0.1, 1.0, 20.0):
        x = np.linspace(-limit, limit, LANES).astype(np.float32)
        y = np.empty_like(x)
        apply_tanh(x, y)
        assert np.abs(y - [math.tanh(v) for v in x]).max() < 5e-7
