"""The reference learner against closed forms."""

import itertools

import numpy as np
import pytest
import torch
from torch import nn

from swimmer_mj.learning.networks.networks import Cascade, Multilayer, ValueNetwork
from swimmer_mj.learning.networks.policy import GreedyPolicy, greedy_control, hamiltonian
from swimmer_mj.learning.problems.forms import CostForm, TorchForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import (
    ContinuousTD,
    TDSettings,
    trace_derivative,
    value_and_gradients,
    weight_derivative,
)
from swimmer_mj.learning.td.method import PAPER_NEURONS, TemporalDifferences
from swimmer_mj.learning.td.vario_eta import VarioEta


class Decay:
    """dx/dt = -a x, r = x^2, nothing to control: V = x^2 / (s_gamma + 2 a)."""

    name, state_size, n_inputs = "decay", 1, 1
    control_limits = np.array([1.0])

    def __init__(self, a=0.5, s_gamma=1.0):
        self.a, self.s_gamma = a, s_gamma

    def drift_and_control_matrix(self, x):
        return -self.a * x, np.zeros((*x.shape, 1))

    def reward(self, x):
        return x[..., 0] ** 2

    def step(self, x, u, dt):
        return x + dt * self.drift_and_control_matrix(x)[0]

    def initial_states(self, rng, count):
        return rng.uniform(-2, 2, (count, 1))

    def inputs(self, x):
        return x

    def form(self, kind):
        return None


class Cart(Decay):
    """dx/dt = u, r = -x^2 - c u^2: V = -k x^2 with k^2 / c + s_gamma k = 1."""

    name, control_limits = "cart", np.array([10.0])

    def __init__(self, c):
        super().__init__()
        self.c = c

    def drift_and_control_matrix(self, x):
        return 0 * x, np.ones((*x.shape, 1))

    def reward(self, x):
        return -(x[..., 0] ** 2)

    def step(self, x, u, dt):
        return x + dt * u

    def form(self, kind):
        if kind is TorchForm:
            return TorchForm(
                torch.zeros_like, lambda x: torch.ones_like(x)[..., None], lambda x: -(x[:, 0] ** 2)
            )
        return CostForm(lambda x: np.full(x.shape, self.c)) if kind is CostForm else None


class Quadratic(ValueNetwork):
    """V = w x^2."""

    n_inputs = 1

    def __init__(self):
        super().__init__()
        self.w = nn.Parameter(torch.zeros((), dtype=torch.float64))

    def forward(self, z):
        return self.w * z[..., 0] ** 2

    def learning_rates(self, eta, output_scaling=True):
        return [torch.tensor(eta, dtype=torch.float64)]


def cascade(seed=0, n_neurons=10, n_inputs=3):
    generator = torch.Generator().manual_seed(seed)
    network = Cascade(n_inputs, n_neurons, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        network.weight[-1] = torch.randn(network.weight.shape[1], generator=generator, dtype=torch.float64)
    return network


def test_hamiltonian_of_the_true_value_is_zero():
    problem = Decay(a=0.7, s_gamma=0.3)
    w = 1 / (problem.s_gamma + 2 * problem.a)
    for x in np.linspace(-2, 2, 9):
        f = problem.drift_and_control_matrix(np.array([x]))[0]
        H = hamiltonian(x**2, w * x**2, np.array([2 * w * x]), f, problem.s_gamma)
        assert H == pytest.approx(0.0, abs=1e-14)  # of terms up to 4


def test_greedy_control_maximises_the_hamiltonian():
    rng = np.random.default_rng(0)
    limits = np.array([1.0, 0.5, 2.0])
    for _ in range(50):
        B, dVdx, a = rng.normal(size=(6, 3)), rng.normal(size=6), rng.normal(size=6)
        u = greedy_control(B, dVdx, limits)
        best = max(dVdx @ (a + B @ (limits * s)) for s in itertools.product([-1, 0, 1], repeat=3))
        assert dVdx @ (a + B @ u) == pytest.approx(best, rel=1e-12)
        assert set(np.abs(u / limits)) == {1.0}


def test_greedy_control_of_a_batch_and_of_no_preference():
    B = np.random.default_rng(0).normal(size=(7, 4, 2))
    dVdx = np.random.default_rng(1).normal(size=(7, 4))
    u = greedy_control(B, dVdx, np.array([1.0, 3.0]))
    assert all((u[k] == greedy_control(B[k], dVdx[k], np.array([1.0, 3.0]))).all() for k in range(7))
    assert (greedy_control(B, 0 * dVdx, np.array([1.0, 3.0])) == 0).all()


def test_defaults_are_the_papers():
    """Section 4: 60 neurons, eta 0.01, steps of 0.01 s, trials of 5 s, a rate of the output unit of its own."""
    settings, method = TDSettings(), TemporalDifferences()
    assert (settings.eta, settings.dt, settings.trial_duration, settings.output_scaling) == (
        0.01,
        0.01,
        5.0,
        True,
    )
    assert settings.steps_per_trial == 500
    network = method.network(Swimming(), 0)
    assert method.neurons == PAPER_NEURONS == network.n_neurons == 60
    assert network.n_inputs == 17  # here: cosines and sines; the paper's 12 are the state itself


def test_trace_of_a_constant_gradient():
    """e_k = g (1 - (1 - s dt)^k) / s, with s = s_gamma + s_lambda; its limit is g / s."""
    s_gamma, s_lambda, dt = 0.6, 1.4, 0.01
    g = np.array([1.0, -2.0, 0.5])
    e = np.zeros(3)
    for k in range(1, 1001):
        e = e + dt * trace_derivative(e, g, s_gamma, s_lambda)
        assert e == pytest.approx(g * (1 - (1 - 2.0 * dt) ** k) / 2.0, rel=1e-12)
    assert e == pytest.approx(g / 2.0, rel=1e-8)


def test_weight_derivative_is_eta_H_e():
    assert weight_derivative(np.array([0.1, 0.2]), -3.0, np.array([1.0, 2.0])) == pytest.approx([-0.3, -1.2])


def multilayer():
    return Multilayer(3, (8, 8), generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("network", [cascade(), multilayer()])
def test_gradients_by_finite_differences(network):
    with torch.no_grad():
        for parameter in network.parameters():
            parameter += 0.1
    problem = Pendulum()
    x, h = np.array([0.7, -1.3]), 1e-6

    def value(y):
        return network(problem.inputs(torch.tensor(y))).item()

    V, dVdx, dVdw = value_and_gradients(network, problem, x)
    assert value(x) == pytest.approx(V, rel=1e-13)
    for i in range(2):
        step = h * np.eye(2)[i]
        assert dVdx[i] == pytest.approx((value(x + step) - value(x - step)) / (2 * h), rel=1e-7, abs=1e-9)
    for w, gradient in zip(network.parameters(), dVdw, strict=True):
        flat, expected = w.data.view(-1), gradient.reshape(-1)
        for i in range(0, len(flat), 7):
            flat[i] += h
            above = value(x)
            flat[i] -= 2 * h
            below = value(x)
            flat[i] += h
            connected = network.connected.view(-1)[i] if isinstance(network, Cascade) else True
            if connected:
                assert expected[i].item() == pytest.approx((above - below) / (2 * h), rel=1e-6, abs=1e-9)


def test_the_total_derivative_of_V_is_what_the_trajectory_shows():
    problem, network = Pendulum(), cascade()
    x, dt = np.array([0.4, 1.1]), 1e-6
    V, dVdx, _ = value_and_gradients(network, problem, x)
    a, B = problem.drift_and_control_matrix(x)
    u = greedy_control(B, dVdx, problem.control_limits)
    later = value_and_gradients(network, problem, problem.step(x, u, dt))[0]
    assert dVdx @ (a + B @ u) == pytest.approx((later - V) / dt, rel=1e-4)


@pytest.mark.parametrize("s_lambda", [0.0, 1.0, 20.0])
def test_learns_the_value_of_a_linear_system(s_lambda):
    """Eligibility only changes the way to V = x^2 / (s_gamma + 2 a), not the end of it."""
    problem, network = Decay(a=0.5, s_gamma=1.0), Quadratic()
    settings = TDSettings(eta=0.3 * (1 + s_lambda), s_lambda=s_lambda, trial_duration=2.0)
    learner = ContinuousTD(problem, network, settings)
    for x in problem.initial_states(np.random.default_rng(0), 60):
        learner.run_trial(x)
    assert network.w.item() == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("c", [0.3, 1.0])
def test_learns_the_value_of_a_linear_system_whose_control_costs(c):
    problem, network = Cart(c), Quadratic()
    learner = ContinuousTD(problem, network, TDSettings(eta=0.3, trial_duration=2.0))
    for x in problem.initial_states(np.random.default_rng(0), 100):
        learner.run_trial(x)
    k = (c / 2) * ((1 + 4 / c) ** 0.5 - 1)
    assert network.w.item() == pytest.approx(-k, rel=1e-3)


def test_an_episode_pays_for_its_control():
    """With V = -x^2 and c = 2, u = -x / 2: of x after k steps, x (1 - dt / 2)^k, an episode has -3/2 x^2 a second."""
    network = Quadratic()
    network.w.data -= 1
    x, dt = np.array([[0.5], [-2.0]]), 0.1
    found = GreedyPolicy(Cart(2.0), network).episodes(x, np.full(7, dt), dt)
    assert found == pytest.approx(-1.5 * dt * x[:, 0] ** 2 * sum((1 - dt / 2) ** (2 * k) for k in range(7)))


@pytest.mark.parametrize(
    "problem", [Pendulum(), Cart(0.3), Swimming(held=True), Swimming(held=True, encoding="angle")]
)
def test_what_is_done_while_learning_is_what_the_policy_does(problem):
    """Of the instant, with a cost, and for the 0.01 s for which a control is held: the same u and H."""
    network = cascade(n_inputs=problem.n_inputs)
    network.weight.data *= 2
    policy, learner = GreedyPolicy(problem, network), ContinuousTD(problem, network, TDSettings(eta=0.1))
    learner.start_trial()
    others = 0  # than bang-bang control of the instant
    for x in problem.initial_states(np.random.default_rng(1), 20):
        instant = greedy_control(
            problem.drift_and_control_matrix(x)[1],
            value_and_gradients(network, problem, x)[1],
            problem.control_limits,
        )
        judged, moment = policy.judge(x), learner.learn_at(x)
        assert moment.control == pytest.approx(judged.control, rel=1e-9)
        assert moment.hamiltonian == pytest.approx(judged.hamiltonian, rel=1e-9)
        others += int((moment.control != instant).sum())
    assert (others == 0) == isinstance(problem, Pendulum)


def test_one_step_is_an_euler_step_of_equation_2():
    problem, network = Pendulum(), cascade()
    settings = TDSettings(eta=0.2, s_lambda=3.0, output_scaling=False)
    learner = ContinuousTD(problem, network, settings)
    noise = torch.Generator().manual_seed(1)
    learner.traces[0].copy_(torch.randn(network.weight.shape, generator=noise, dtype=torch.float64))
    x = np.array([0.5, -2.0])
    w, e = network.weight.detach().clone(), learner.traces[0].clone()
    V, dVdx, (dVdw,) = value_and_gradients(network, problem, x)
    a, B = problem.drift_and_control_matrix(x)
    u = 5.0 * np.sign(dVdx[1:])
    H = np.cos(x[0]) - V + dVdx @ (a + B @ u)

    moment = learner.learn_at(x)
    assert moment.value == pytest.approx(V, rel=1e-13)
    assert moment.hamiltonian == pytest.approx(H, rel=1e-14)
    assert (moment.control == u).all()
    expected_w = w + 0.01 * 0.2 * H * e * network.connected
    assert torch.allclose(network.weight, expected_w, rtol=1e-13, atol=1e-15)
    assert torch.allclose(learner.traces[0], e + 0.01 * (-4.0 * e + dVdw), rtol=1e-13, atol=1e-15)


def test_vario_eta_follows_its_recursion_from_trial_to_trial():
    problem, network, vario = Pendulum(), cascade(), VarioEta(beta=0.1, epsilon=0.5, initial_variance=4.0)
    learner = ContinuousTD(problem, network, TDSettings(eta=0.1, trial_duration=0.1, vario=vario))
    connected = network.connected
    scale = torch.ones_like(network.weight)
    scale[-1] /= 10**0.5
    v = torch.full_like(network.weight, 4.0)
    rate = scale * 0.1 / (2.0 + 0.5)
    for x in problem.initial_states(np.random.default_rng(0), 5):
        before = network.weight.detach().clone()
        assert torch.allclose(learner.rates[0][connected], rate[connected], rtol=1e-12)
        learner.run_trial(x)
        v = 0.9 * v + 0.1 * ((network.weight.detach() - before) / rate) ** 2
        rate = scale * 0.1 / (v.sqrt() + 0.5)
        assert torch.allclose(learner.variances[0][connected], v[connected], rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"eta": 0.0}, "eta must be positive and finite, got 0.0"),
        ({"dt": float("nan")}, "dt must be positive and finite, got nan"),
        ({"s_lambda": -1.0}, "s_lambda must be finite and not negative, got -1.0"),
        ({"dt": 0.1, "trial_duration": 0.05}, "trial_duration must be at least dt = 0.1, got 0.05"),
    ],
)
def test_settings_refuse(arguments, message):
    with pytest.raises(ValueError, match=message):
        TDSettings(**arguments)
