"""The compiled kernel against the torch reference."""

import copy
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from swimmer_mj.compiled.elementary import tanh_of_one
from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import CostForm, HoldForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings, value_and_gradients
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.population import PopulationTD
from swimmer_mj.learning.td.vario_eta import VarioEta
from swimmer_mj.parameters import PAPER, SwimmerParameters

UNEQUAL = SwimmerParameters(
    n_links=5,
    mass=[0.5, 1.0, 1.5, 0.7, 2.0],
    length=[1.2, 0.8, 1.0, 0.6, 1.4],
    viscous_friction=6.0,
    torque_limit=[5.0, 4.0, 3.0, 6.0],
)


class WithForm(Pendulum):
    """The compiled pendulum with a form that no compiled learner knows."""

    def __init__(self, kind):
        super().__init__()
        object.__setattr__(self, "kind", kind)

    def form(self, kind):
        return kind(None) if kind is self.kind else Pendulum().form(kind)


def network_for(problem, n_neurons=60, dtype=torch.float64, seed=0, output=0.3):
    generator = torch.Generator().manual_seed(seed)
    network = Cascade(problem.n_inputs, n_neurons, generator=generator, dtype=dtype)
    with torch.no_grad():
        row = network.weight[-1]
        row[:] = output * torch.randn(row.shape, generator=generator, dtype=torch.float64)
    return network


@pytest.mark.parametrize("parameters", [PAPER, UNEQUAL])
@pytest.mark.parametrize("s_lambda", [1.0, 0.0])
def test_agrees_with_the_reference_after_250_online_steps(parameters, s_lambda):
    problem = Swimming(parameters)
    network = network_for(problem)
    twin = copy.deepcopy(network)
    settings = TDSettings(eta=0.04, s_lambda=s_lambda, trial_duration=2.5)
    start = problem.initial_states(np.random.default_rng(0), 1)
    reference, compiled = ContinuousTD(problem, network, settings), FusedTD(problem, twin, settings)
    before = network.weight.detach().clone()
    moments = reference.run_trial(start[0])
    statistics = compiled.train(start)
    assert len(moments) == 250
    assert (network.weight - before).abs().max() > 1e-3  # it did learn
    assert (network.weight - twin.weight).abs().max() < 1e-9
    assert (reference.traces[0] - compiled.trace).abs().max() < 1e-9
    assert statistics.value[0] == pytest.approx(np.mean([m.value for m in moments]), rel=1e-9)
    squared = np.mean([m.hamiltonian**2 for m in moments])
    assert statistics.squared_hamiltonian[0] == pytest.approx(squared, rel=1e-9)


def test_agrees_with_the_reference_with_logistic_neurons_and_raw_angles():
    problem = Swimming(UNEQUAL, encoding="angle")
    assert problem.n_inputs == 12
    network = network_for(problem, 20)
    network.sigmoid = "logistic"
    twin, third = copy.deepcopy(network), copy.deepcopy(network)
    settings = TDSettings(eta=0.04, trial_duration=1.0)
    start = problem.initial_states(np.random.default_rng(0), 1)
    ContinuousTD(problem, network, settings).run_trial(start[0])
    FusedTD(problem, twin, settings).train(start)
    assert (network.weight - twin.weight).abs().max() < 1e-11
    population = PopulationTD([FusedTD(problem, third, settings)])
    population.train(start[:, None])
    assert (network.weight - third.weight).abs().max() < 1e-11
    assert not torch.equal(network.weight, network_for(problem, 20).weight)


def test_agrees_with_the_reference_under_vario_eta():
    problem = Pendulum()
    network = network_for(problem, 20)
    twin = copy.deepcopy(network)
    settings = TDSettings(eta=0.05, trial_duration=1.0, vario=VarioEta())
    starts = problem.initial_states(np.random.default_rng(0), 4)
    reference, compiled = ContinuousTD(problem, network, settings), FusedTD(problem, twin, settings)
    for start in starts:
        reference.run_trial(start)
    compiled.train(starts)
    assert (network.weight - twin.weight).abs().max() < 1e-12
    assert torch.allclose(reference.variances[0], compiled.variance, rtol=1e-12)
    assert torch.allclose(reference.rates[0], compiled.rate, rtol=1e-12)
    assert not torch.allclose(compiled.rate, settings.initial_rate * compiled.base_rate, rtol=1e-3)


@pytest.mark.parametrize("n_neurons", [2, 14, 15, 16, 17, 31, 60])
def test_gradients_agree_with_autograd(n_neurons):
    problem = Swimming(UNEQUAL)
    network = network_for(problem, n_neurons, seed=n_neurons)
    learner = FusedTD(problem, network)
    for x in problem.initial_states(np.random.default_rng(1), 20):
        V, dVdx, (dVdw,) = value_and_gradients(network, problem, x)
        assert learner.sample(x[None]).value[0] == pytest.approx(V, rel=1e-13, abs=1e-14)
        ws = learner._ws
        assert ws.dVdx == pytest.approx(dVdx, rel=1e-12, abs=1e-14)
        now = ws.now[0]
        sources = np.concatenate([ws.z[now], ws.y[now, : n_neurons - 1]])
        outer = np.outer(ws.delta[now, :n_neurons], sources)
        connected = network.connected.numpy()
        assert outer[connected] == pytest.approx(dVdw.numpy()[connected], rel=1e-12, abs=1e-14)


def test_weights_without_a_connection_stay_zero():
    problem = Pendulum()
    network = network_for(problem, 20)
    FusedTD(problem, network, TDSettings(eta=0.1)).train(problem.initial_states(np.random.default_rng(0), 3))
    assert (network.weight[~network.connected] == 0).all()


def test_learning_step_by_step_is_learning_a_trial():
    problem = Swimming(PAPER)
    network = network_for(problem, 20)
    twin = copy.deepcopy(network)
    settings = TDSettings(eta=0.04, trial_duration=1.0)
    start = problem.initial_states(np.random.default_rng(3), 1)
    FusedTD(problem, network, settings).train(start)
    learner = FusedTD(problem, twin, settings)
    learner.start_trial()
    x = start[0]
    for _ in range(100):
        moment = learner.learn_at(x)
        x = problem.step(x, moment.control, settings.dt)
    learner.end_trial()
    assert (network.weight - twin.weight).abs().max() < 1e-11


def test_sample_is_what_the_policy_judges():
    problem = Swimming(UNEQUAL)
    network = network_for(problem)
    states = problem.initial_states(np.random.default_rng(2), 50)
    judged = GreedyPolicy(problem, network).judge(states)
    sample = FusedTD(problem, network).sample(states)
    assert sample.value == pytest.approx(judged.value, rel=1e-11, abs=1e-12)
    assert sample.hamiltonian == pytest.approx(judged.hamiltonian, rel=1e-9, abs=1e-10)


def test_nothing_but_training_changes_the_weights():
    problem = Pendulum()
    network = network_for(problem, 20)
    before = network.weight.detach().clone()
    learner = FusedTD(problem, network)
    learner.sample(problem.initial_states(np.random.default_rng(0), 5))
    learner.rollout(problem.initial_states(np.random.default_rng(0), 5), 1.0)
    assert torch.equal(network.weight, before)


def test_single_precision_follows_double_precision():
    problem = Pendulum()
    double, single = network_for(problem, 20), network_for(problem, 20, torch.float32)
    start = problem.initial_states(np.random.default_rng(5), 1)
    settings = TDSettings(eta=0.05, trial_duration=0.5)
    FusedTD(problem, double, settings).train(start)
    FusedTD(problem, single, settings).train(start)
    assert single.weight.dtype == torch.float32
    assert (double.weight - single.weight.double()).abs().max() < 1e-5


def test_rational_tanh_is_as_exact_as_it_says():
    x = np.concatenate([np.linspace(-12, 12, 200_001), np.geomspace(1e-30, 1, 1001)]).astype(np.float32)
    error = np.array([float(tanh_of_one(v)) for v in x]) - np.tanh(x.astype(np.float64))
    assert np.abs(error).max() < 5e-7  # 3.1e-7; 3.7e-7 on a processor that does not multiply and add at once


def test_rollout_is_rk4_under_the_greedy_policy():
    problem = Pendulum(damping=0.3)
    network = network_for(problem, 12)
    policy = GreedyPolicy(problem, network)
    starts = problem.initial_states(np.random.default_rng(7), 3)
    result = FusedTD(problem, network).rollout(starts, 1.0, skip=0.4)

    def rate(x, u):
        a, B = problem.drift_and_control_matrix(x)
        return a + B @ u

    for start, mean_reward, discounted in zip(starts, *result, strict=True):
        x, gain, total, dt = start, 0.0, 0.0, 0.01
        for t in range(100):
            u = policy(x)
            k1 = rate(x, u)
            k2 = rate(x + dt / 2 * k1, u)
            k3 = rate(x + dt / 2 * k2, u)
            k4 = rate(x + dt * k3, u)
            points = [x, x + dt / 2 * k1, x + dt / 2 * k2, x + dt * k3]
            times = dt * (t + np.array([0, 0.5, 0.5, 1]))
            r = np.array([problem.reward(y) for y in points]) * np.array([1, 2, 2, 1]) / 6
            total += dt * (np.exp(-problem.s_gamma * times) * r).sum()
            gain += r.sum() if t >= 40 else 0.0
            x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        assert mean_reward == pytest.approx(gain / 60, rel=1e-9)
        assert discounted == pytest.approx(total, rel=1e-9)


def test_learners_in_threads_compute_what_they_compute_alone():
    problem = Pendulum()
    starts = problem.initial_states(np.random.default_rng(0), 40)

    def learn(seed):
        network = network_for(problem, 60, torch.float32, seed)
        FusedTD(problem, network, TDSettings(eta=0.04)).train(starts)
        return network.weight.detach().clone()

    alone = [learn(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(learn, range(4)))
    assert all(torch.equal(a, b) for a, b in zip(alone, together, strict=True))


def test_refuses():
    problem = Pendulum()
    with pytest.raises(TypeError, match="learns Cascade networks, got Multilayer"):
        FusedTD(problem, Multilayer(3))
    with pytest.raises(ValueError, match="pendulum has 3 inputs, the network 4"):
        FusedTD(problem, Cascade(4, 10))
    with pytest.raises(TypeError, match=r"must be float32 or float64, got torch\.float16"):
        FusedTD(problem, Cascade(3, 10, dtype=torch.float16))
    learner = FusedTD(problem, Cascade(3, 10))
    for skip in (1.0, 0.999):  # the second is as many steps as the whole
        with pytest.raises(ValueError, match=f"by a step of 0.01 at least; got skip {skip} and duration 1.0"):
            learner.rollout(np.zeros((1, 2)), 1.0, skip=skip)
    for states in (np.zeros(2), np.zeros((3, 4)), np.zeros((1, 3, 2))):
        for use in (learner.train, learner.sample, lambda states: learner.rollout(states, 1.0)):
            with pytest.raises(
                ValueError, match=rf"states must have shape \(count, 2\), got \({states.shape[0]},"
            ):
                use(states)
    by_rk4 = FusedTD(Swimming(PAPER, integrator="rk4"), Cascade(17, 3))
    for use in (lambda: by_rk4.train(np.zeros((1, 12))), lambda: PopulationTD([by_rk4])):
        with pytest.raises(ValueError, match="by Euler's method, got integrator 'rk4'; use SteppedTD"):
            use()
    for kind, why in ((CostForm, "has controls that cost"), (HoldForm, "chooses controls to be held")):
        with pytest.raises(ValueError, match=f"problem 'pendulum' {why}; use SteppedTD"):
            FusedTD(WithForm(kind), Cascade(3, 10))
    with pytest.raises(ValueError, match=r"vario-eta is not available one step at a time; use train\(\)"):
        FusedTD(problem, Cascade(3, 10), TDSettings(vario=VarioEta())).start_trial()
