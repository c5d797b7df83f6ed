"""Learners side by side against each of them alone."""

import copy

import numpy as np
import pytest
import torch
from numba import njit

from swimmer_mj.compiled.elementary import tanh_of_lanes, tanh_of_one
from swimmer_mj.compiled.vectors import LANES, load, store
from swimmer_mj.learning.networks.layered import Layered
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.population import PopulationTD
from swimmer_mj.learning.td.vario_eta import VarioEta
from swimmer_mj.parameters import PAPER

N_NEURONS = 12
SWIMMING = Swimming(PAPER, encoding="angle")
"""Learned by logistic neurons here, so that the compiler's work is that of test_fused.py."""


def network_for(problem, seed, n_neurons=N_NEURONS, dtype=torch.float64, sigmoid=None):
    sigmoid = sigmoid or ("logistic" if isinstance(problem, Swimming) else "tanh")
    generator = torch.Generator().manual_seed(seed)
    network = Cascade(problem.n_inputs, n_neurons, generator=generator, dtype=dtype, sigmoid=sigmoid)
    with torch.no_grad():
        row = network.weight[-1]
        row[:] = 0.3 * torch.randn(row.shape, generator=generator, dtype=torch.float64)
    return network


def learner_for(problem, seed, dtype=torch.float64, **settings):
    settings = {"eta": 0.04, "trial_duration": 0.5, **settings}
    return FusedTD(problem, network_for(problem, seed, dtype=dtype), TDSettings(**settings))


def starts_for(problem, trials, learners, seed=0):
    states = problem.initial_states(np.random.default_rng(seed), trials * learners)
    return states.reshape(trials, learners, -1)


def test_swimmers_are_their_single_runs():
    problem = SWIMMING
    settings = [
        {"eta": 0.01 * (1 + lane), "s_lambda": 0.5 * lane, "output_scaling": lane % 2 == 0}
        for lane in range(5)
    ]
    pack, alone = ([learner_for(problem, lane, **s) for lane, s in enumerate(settings)] for _ in range(2))
    starts = starts_for(problem, 3, len(pack))
    before = [learner.weight.clone() for learner in pack]
    together = PopulationTD(pack).train(starts)
    for lane, learner in enumerate(alone):
        statistics = learner.train(starts[:, lane])
        assert (learner.weight - before[lane]).abs().max() > 1e-3  # it did learn
        assert (learner.weight - pack[lane].weight).abs().max() < 1e-12
        for mine, single in zip(together, statistics, strict=True):
            assert mine[:, lane] == pytest.approx(single, rel=1e-11, abs=1e-13)


COMPANIES = {
    "other lanes": list(reversed(range(LANES))),
    "other companions": [*range(LANES, LANES + 9), 3, *range(LANES + 9, 2 * LANES - 2), 8],
    "idle lanes": [5, 2, 15],
    "alone": [7],
}
"""Seeds, from the first lane on."""


@pytest.mark.parametrize(
    ("problem", "dtype"),
    [(SWIMMING, torch.float64), (Pendulum(), torch.float32)],
    ids=["swimmer", "pendulum"],
)
def test_a_learner_depends_on_no_lane_and_no_companion_bit_for_bit(problem, dtype):
    starts = starts_for(problem, 2, 2 * LANES)

    def run(seeds):
        """Weights and statistics of each seed's learner."""
        learners = [
            learner_for(problem, seed, dtype, eta=0.01 + 0.005 * seed, s_lambda=0.1 * seed) for seed in seeds
        ]
        statistics = np.stack(PopulationTD(learners).train(starts[:, seeds]), axis=-1)
        return {
            seed: (learner.weight, statistics[:, lane])
            for lane, (seed, learner) in enumerate(zip(seeds, learners, strict=True))
        }

    sixteen = run(list(range(LANES)))
    for seed, (weight, _) in sixteen.items():
        first = network_for(problem, seed, dtype=dtype).weight
        assert (weight - first).abs().max() > 1e-4  # it did learn
    for company, seeds in COMPANIES.items():
        result = run(seeds)
        common = [seed for seed in seeds if seed in sixteen]
        assert common
        for seed in common:
            assert torch.equal(result[seed][0], sixteen[seed][0]), company
            assert (result[seed][1] == sixteen[seed][1]).all(), company


class Uneven(Cascade):
    """Rates that differ from weight to weight."""

    def learning_rates(self, eta, output_scaling=True):
        (rates,) = super().learning_rates(eta, output_scaling)
        return [rates * torch.linspace(0.5, 2.0, rates.numel(), dtype=rates.dtype).reshape(rates.shape)]


def test_pendulums_are_the_reference_with_rates_of_each_weight():
    """Vario-eta, rates of each weight and rates of each neuron in one pack, against the torch reference itself."""
    problem = Pendulum()
    settings = [
        {"vario": VarioEta(epsilon=0.01, initial_variance=100.0), "eta": 0.4},
        {"vario": VarioEta(beta=0.3, initial_variance=1.0), "s_lambda": 0.2, "output_scaling": False},
        {"eta": 0.1, "s_lambda": 3.0},
        {"eta": 0.03, "output_scaling": False},
        {"eta": 0.05, "s_lambda": 0.0},
    ]
    pack = [learner_for(problem, lane, trial_duration=0.3, **s) for lane, s in enumerate(settings)]
    uneven = Uneven(problem.n_inputs, N_NEURONS, dtype=torch.float64)
    uneven.load_state_dict(pack[-1].network.state_dict())
    pack[-1] = FusedTD(problem, uneven, pack[-1].settings)
    assert {learner.rate_each for learner in pack} == {True, False}
    references = [ContinuousTD(problem, copy.deepcopy(one.network), one.settings) for one in pack]
    before = [learner.weight.clone() for learner in pack]
    starts = starts_for(problem, 3, len(pack))
    population = PopulationTD(pack)
    calls = [population.train(part) for part in (starts[:1], starts[1:1], starts[1:])]  # several are as one
    value, squared_hamiltonian, _ = (np.concatenate(parts) for parts in zip(*calls, strict=True))
    for lane, (learner, reference) in enumerate(zip(pack, references, strict=True)):
        moments = [reference.run_trial(start) for start in starts[:, lane]]
        assert (learner.weight - before[lane]).abs().max() > 1e-3
        assert (learner.weight - reference.network.weight).abs().max() < 1e-12
        assert torch.allclose(learner.rate, reference.rates[0], rtol=1e-11)
        V, H = (
            np.array([[getattr(m, name) for m in trial] for trial in moments])
            for name in ("value", "hamiltonian")
        )
        assert value[:, lane] == pytest.approx(V.mean(axis=1), rel=1e-10, abs=1e-12)
        assert squared_hamiltonian[:, lane] == pytest.approx((H**2).mean(axis=1), rel=1e-10)
        if learner.settings.vario is not None:
            assert torch.allclose(learner.variance, reference.variances[0], rtol=1e-11)
            assert not torch.allclose(learner.rate, learner.settings.initial_rate * learner.base_rate)


@njit
def tanh_of_vectors(x, y):
    for i in range(0, x.size, LANES):
        store(y, i, tanh_of_lanes(load(x, i)))


@pytest.mark.parametrize("vario", [None, VarioEta()])
def test_layers_are_a_cascade_without_some_connections(vario):
    def learner(seed):
        network = Layered(3, 5, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        return FusedTD(Pendulum(), network, TDSettings(eta=0.01, trial_duration=0.5, vario=vario))

    pack, alone = ([learner(seed) for seed in range(3)] for _ in range(2))
    starts = starts_for(Pendulum(), 3, len(pack))
    PopulationTD(pack).train(starts)
    for lane, single in enumerate(alone):
        single.train(starts[:, lane])
        assert single.weight[-1].abs().max() > 0  # it did learn
        assert (single.weight - pack[lane].weight).abs().max() < 1e-12
        assert (pack[lane].weight[~single.network.connected] == 0).all()


def test_a_learner_that_diverged_begins_anew_when_its_weights_are_set_anew():
    learner, other = (learner_for(Pendulum(), 0) for _ in range(2))
    population, weights = PopulationTD([learner]), learner.weight.clone()
    population.train(np.full((1, 1, 2), np.inf))
    assert not learner.weight.isfinite().all()
    learner.weight.copy_(weights)
    starts = starts_for(Pendulum(), 1, 1)
    population.train(starts)
    PopulationTD([other]).train(starts)
    assert torch.equal(learner.weight, other.weight)


def test_vector_tanh_is_the_scalar_one():
    x = np.concatenate([np.linspace(-12, 12, 40_000), np.geomspace(1e-30, 1, 1000), [0, -0.0] * 20])
    x = x.astype(np.float32)
    assert x.size % LANES == 0
    y = np.empty_like(x)
    tanh_of_vectors(x, y)
    assert np.abs(y - np.tanh(x.astype(np.float64))).max() < 5e-7
    assert np.abs(y - np.array([tanh_of_one(v) for v in x])).max() < 2e-7


@pytest.fixture(scope="module")
def pair():
    return [learner_for(Pendulum(), seed) for seed in range(2)]


def test_refuses_a_wrong_number_of_learners(pair):
    with pytest.raises(ValueError, match="a population has 1 to 16 learners, got 0"):
        PopulationTD([])
    with pytest.raises(ValueError, match="a population has 1 to 16 learners, got 17"):
        PopulationTD(pair[:1] * 17)


def another(**options):
    return FusedTD(Pendulum(), network_for(Pendulum(), 1, **options), TDSettings(trial_duration=0.5))


class AnotherReward(Pendulum):
    def form(self, kind):
        form = Pendulum().form(kind)
        return form._replace(reward=njit(lambda constants, x: 0.0)) if kind is CompiledForm else form


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (lambda: learner_for(Pendulum(s_gamma=0.5), 1), "one problem and one s_gamma"),
        (lambda: learner_for(Pendulum(mass=2.0), 1), "one problem and one s_gamma"),
        (lambda: learner_for(Pendulum(torque_limit=4.0), 1), "one problem and one s_gamma"),
        (lambda: learner_for(Swimming(PAPER), 1), "one problem and one s_gamma"),
        (lambda: learner_for(AnotherReward(), 1), "one problem and one s_gamma"),
        (lambda: another(n_neurons=N_NEURONS + 1), "one size, one dtype and one sigmoid"),
        (lambda: another(dtype=torch.float32), "one size, one dtype and one sigmoid"),
        (lambda: another(sigmoid="logistic"), "one size, one dtype and one sigmoid"),
        (lambda: learner_for(Pendulum(), 1, dt=0.02), "one dt and one trial_duration"),
        (lambda: learner_for(Pendulum(), 1, trial_duration=1.0), "one dt and one trial_duration"),
    ],
)
def test_refuses_learners_that_cannot_share_a_pack(pair, other, message):
    with pytest.raises(ValueError, match=f"of a population must have {message}"):
        PopulationTD([pair[0], other()])


def test_refuses_initial_states_of_another_shape(pair):
    pack = PopulationTD(pair)
    for states in (np.zeros((3, 2)), np.zeros((3, 1, 2)), np.zeros((3, 2, 4))):
        message = (
            rf"initial_states must have shape \(trials, 2, 2\), got \({', '.join(map(str, states.shape))}"
        )
        with pytest.raises(ValueError, match=message):
            pack.train(states)


@pytest.mark.parametrize("problem", [SWIMMING, Pendulum()], ids=lambda problem: problem.name)
def test_final_states_are_where_the_last_trials_ended(problem):
    settings = TDSettings(eta=0.04, trial_duration=0.1)
    learners = [FusedTD(problem, network_for(problem, seed), settings) for seed in range(2)]
    starts = starts_for(problem, 2, 2)
    references = [ContinuousTD(problem, copy.deepcopy(learner.network), settings) for learner in learners]
    population = PopulationTD(learners)
    population.train(starts)
    for lane, reference in enumerate(references):
        reference.run_trial(starts[0, lane])
        x = starts[1, lane]
        reference.start_trial()
        for _ in range(settings.steps_per_trial):
            x = problem.step(x, reference.learn_at(x).control, settings.dt)
        assert np.abs(x - starts[1, lane]).max() > 0.01
        assert population.final_states[lane] == pytest.approx(x, rel=1e-9, abs=1e-11)
