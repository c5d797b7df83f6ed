"""The experiments: what they compute, that they are deterministic, and that their logs are there."""

import copy
import csv

import numpy as np
import pytest
import torch

from swimmer_mj.learning.experiments import EXPERIMENTS, LOGS, figure_1, linear_approximators, section_3_3
from swimmer_mj.learning.experiments.hamiltonians import both_hamiltonians
from swimmer_mj.learning.experiments.noise import NoiseMeter
from swimmer_mj.learning.experiments.section_3_3 import noise_summary
from swimmer_mj.learning.experiments.tables import read_table, rows_where, write_table
from swimmer_mj.learning.experiments.value_bias import value_error
from swimmer_mj.learning.networks.layered import Layered
from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.hamiltonian import hamiltonian_by_difference, second_order_term, switches
from swimmer_mj.learning.td.vario_eta import VarioEta


def layered(seed=0, n_hidden=13):
    generator = torch.Generator().manual_seed(seed)
    network = Layered(3, n_hidden, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        draw = torch.randn(network.weight.shape[1], generator=generator, dtype=torch.float64)
        network.weight[-1] = torch.where(network.connected[-1], 0.3 * draw, 0.0)
    return network


# A network with one hidden layer as a masked cascade ---------------------------------------------------------------


def test_layered_is_the_multilayer_network_with_the_same_weights():
    network, other = layered(), Multilayer(3, (13,), dtype=torch.float64)
    weight = network.weight.data
    with torch.no_grad():
        other.layers[0].weight.copy_(weight[:-1, :3])
        other.layers[0].bias.copy_(weight[:-1, 3])
        other.layers[1].weight.copy_(weight[-1:, 4:])
        other.layers[1].bias.copy_(weight[-1:, 3])
    z = torch.randn(50, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    assert torch.allclose(network(z), other(z), rtol=1e-13, atol=1e-14)
    assert network.n_weights == sum(w.numel() for w in other.parameters()) == 66


def test_layered_initial_weights_have_the_law_of_the_multilayer_network():
    network = Layered(3, 4000, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    hidden = network.weight.data[:-1, :4]
    assert hidden.std(dim=0).numpy() == pytest.approx(0.5, rel=0.05)
    assert (network.weight.data[-1] == 0).all()
    assert (network.weight.data[~network.connected] == 0).all()


def test_layered_learns_as_the_reference_does_and_grows_no_connection():
    problem, network = Pendulum(), layered()
    twin = copy.deepcopy(network)
    settings = TDSettings(eta=0.1, output_scaling=False, trial_duration=1.0)
    start = np.array([[2.0, -1.0]])
    before = network.weight.detach().clone()
    ContinuousTD(problem, network, settings).run_trial(start[0])
    FusedTD(problem, twin, settings).train(start)
    assert (network.weight - before).abs().max() > 1e-3
    assert (network.weight - twin.weight).abs().max() < 1e-12
    assert (twin.weight[~twin.connected] == 0).all()


def test_layered_refuses_no_units():
    with pytest.raises(ValueError, match="n_hidden must be at least 1, got 0"):
        Layered(3, 0)


# The noise of each weight ------------------------------------------------------------------------------------------


def test_the_meter_under_vario_eta_is_the_learners_own_vario_eta():
    problem, vario = Pendulum(), VarioEta(beta=0.1, epsilon=0.05, initial_variance=4.0)
    networks = [
        Cascade(3, 8, generator=torch.Generator().manual_seed(0), dtype=torch.float64) for _ in range(2)
    ]
    starts = problem.initial_states(np.random.default_rng(0), 6)
    own = FusedTD(problem, networks[0], TDSettings(eta=0.1, trial_duration=0.5, vario=vario))
    own.train(starts)
    other = FusedTD(problem, networks[1], TDSettings(eta=0.1, trial_duration=0.5), rate_each=True)
    meter = NoiseMeter(other, adapt=vario)
    meter.train(starts)
    connected = networks[0].connected
    assert torch.allclose(networks[0].weight, networks[1].weight, rtol=1e-10, atol=1e-13)
    assert torch.allclose(own.variance[connected], meter.variance[connected], rtol=1e-9)
    assert torch.allclose(own.rate[connected], meter.learner.rate[connected], rtol=1e-9)


def test_the_meter_measures_and_leaves_fixed_rates_alone():
    problem, network = Pendulum(), layered()
    meter = NoiseMeter(FusedTD(problem, network, TDSettings(eta=0.2, trial_duration=0.5)), beta=0.25)
    rate, v, m = meter.learner.rate.clone(), 0.0, 0.0
    for x in problem.initial_states(np.random.default_rng(0), 5):
        before = network.weight.detach().clone()
        meter.train(x[None])
        gradient = (network.weight.detach() - before)[-1, -1] / rate[-1, -1]
        v, m = 0.75 * v + 0.25 * gradient**2, 0.75 * m + 0.25 * gradient
    assert torch.equal(meter.learner.rate, rate)
    assert meter.variance[-1, -1].item() == pytest.approx(v.item(), rel=1e-9)
    assert meter.mean[-1, -1].item() == pytest.approx(m.item(), rel=1e-9)
    assert (meter.variance[~network.connected] == 0).all()


def test_the_meter_refuses_a_learner_that_sets_its_own_rates():
    learner = FusedTD(Pendulum(), Cascade(3, 4), TDSettings(vario=VarioEta()))
    with pytest.raises(ValueError, match=r"settings\.vario must be None"):
        NoiseMeter(learner)


def test_noise_summary_tells_output_from_internal_connections():
    """3 neurons on 2 inputs: rows of 3, 4 and 5 connections, the last one the output's."""
    v = np.array([[1.0, 1.0, 4.0, 99.0, 99.0], [1.0, 1.0, 4.0, 7.0, 99.0], [10.0, 20.0, 30.0, 40.0, 50.0]])
    summary = noise_summary(v, -0.5 * np.sqrt(v), 2)
    named = dict(zip(section_3_3.HEADER[5:], summary, strict=False))
    assert named["output"] == 30.0
    assert named["internal"] == pytest.approx(19 / 7)
    assert (named["from_inputs"], named["from_neurons"]) == (2.0, 7.0)
    assert named["internal_p50"] == 1.0
    assert named["mean_over_deviation"] == pytest.approx(0.5)
    assert (named["neuron_p05"], named["neuron_p95"]) == pytest.approx((2 + 0.05 * 1.25, 3.25 - 0.05 * 1.25))


# H both ways -------------------------------------------------------------------------------------------------------


def test_the_difference_form_is_exact_where_V_is_linear_and_second_order_where_quadratic():
    rng = np.random.default_rng(0)
    x, f, g, dt = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), 0.1
    linear = hamiltonian_by_difference(0.7, g @ x, g @ (x + dt * f), 0.5, dt)
    assert linear == pytest.approx(0.7 - 0.5 * (g @ x) + g @ f, rel=1e-12)
    A = rng.normal(size=(3, 3))
    A = A + A.T
    V, V_next = x @ A @ x / 2, (x + dt * f) @ A @ (x + dt * f) / 2
    gradient = 0.7 - 0.5 * V + (A @ x) @ f
    bend = second_order_term(A @ x, A @ (x + dt * f), f)
    assert bend == pytest.approx(dt / 2 * (f @ A @ f), rel=1e-12)
    assert hamiltonian_by_difference(0.7, V, V_next, 0.5, dt) - gradient == pytest.approx(bend, rel=1e-9)


def test_switches_are_counted_by_component():
    u, u_next = np.array([[1.0, -1.0, 1.0], [1.0, 1.0, 1.0]]), np.array([[1.0, 1.0, -1.0], [1.0, 1.0, 1.0]])
    assert switches(u, u_next).tolist() == [2, 0]


def test_the_forms_meet_as_dt_goes_to_zero():
    """From states whose control does not switch within the step, in proportion to dt."""
    problem = Swimming()
    network = Cascade(17, 12, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    with torch.no_grad():
        network.weight[-1] = 0.3 * torch.randn(
            29, dtype=torch.float64, generator=torch.Generator().manual_seed(1)
        )
    states = problem.initial_states(np.random.default_rng(0), 30)
    errors = []
    for dt in (1e-3, 1e-4):
        both = both_hamiltonians(problem, network, states, dt, 1)
        still = both.switched[0] == 0
        assert still.sum() > 20
        errors.append(np.abs(both.gradient - both.difference)[0, still].mean())
        unexplained = np.abs(both.difference - both.gradient - both.second_order)[0, still].mean()
        assert unexplained < 0.1 * errors[-1]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.1)


def test_both_forms_at_the_start_are_those_of_the_learner():
    problem, network = Pendulum(), layered()
    states = problem.initial_states(np.random.default_rng(0), 20)
    both = both_hamiltonians(problem, network, states, 0.01, 2)
    assert both.gradient.shape == (2, 20)
    assert both.gradient[0] == pytest.approx(FusedTD(problem, network).sample(states).hamiltonian, rel=1e-9)
    assert both.final_states.shape == (20, 2)


# V against returns -------------------------------------------------------------------------------------------------


def test_value_error_splits_into_bias_and_deviation():
    V, returns = np.array([1.0, 2.0, 4.0]), np.array([0.0, 2.0, 2.0])
    error = value_error(V, returns)
    assert (error.bias, error.deviation) == pytest.approx((1.0, (2 / 3) ** 0.5))
    assert error.rmse**2 == pytest.approx(error.bias**2 + error.deviation**2) == pytest.approx(5 / 3)
    assert error.correlation == pytest.approx(np.corrcoef(V, returns)[0, 1])
    assert np.isnan(value_error(np.zeros(3), returns).correlation)


# Cost of linear approximators --------------------------------------------------------------------------------------


def test_the_number_of_weights_is_exponential_and_quadratic():
    """The cascade's: against the connections of the network itself."""
    for n_links in (2, 5):
        network = Cascade(3 * n_links + 2, 12 * n_links)
        assert linear_approximators.n_features("cascade", n_links) == int(network.connected.sum())
    assert linear_approximators.n_features("radial basis", 5) == 5**12
    assert linear_approximators.n_features("tile coding", 3) == 8 * 5**3 * 6**5
    with pytest.raises(
        ValueError, match="approximator must be one of cascade, radial basis, tile coding, got 'x'"
    ):
        linear_approximators.n_features("x", 3)


# Logs --------------------------------------------------------------------------------------------------------------


def test_a_table_comes_back_as_written(tmp_path):
    path = tmp_path / "t.csv"
    write_table(path, ("name", "k", "x"), [("a", 1, 0.123456789), ("b", 20000, np.nan)], digits=3)
    assert path.read_text() == "name,k,x\na,1,0.123\nb,20000,nan\n"
    table = read_table(path)
    assert table["name"].tolist() == ["a", "b"]
    assert rows_where(table, name="b")["k"].tolist() == [20000.0]
    with pytest.raises(ValueError, match="a row must have 2 cells, got 1"):
        write_table(path, ("a", "b"), [(1.0,)])


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_committed_logs_are_there_and_small(name):
    experiment = EXPERIMENTS[name]
    assert experiment.name == name
    for log in experiment.logs:
        path = LOGS / log
        assert path.stat().st_size < 200_000
        with path.open(newline="") as file:
            widths = {len(row) for row in csv.reader(file)}
        assert len(widths) == 1


def test_figure_1_recomputes_the_beginning_of_its_log(tmp_path):
    """The log's first rows from scratch, on the committed settings; chaos bounds how far one can compare."""
    figure_1.run(tmp_path, seeds=[0], trials=100, evaluate_every=100)
    again, log = read_table(tmp_path / figure_1.WEIGHTS_LOG), read_table(LOGS / figure_1.WEIGHTS_LOG)
    for method in figure_1.METHODS:
        for trial in (0, 100):
            where = {"method": method, "trial": trial, "quantity": "weight"}
            mine, theirs = rows_where(again, **where), rows_where(log, **where)
            weights = [np.array([table[f"w{k}"][0] for k in range(66)]) for table in (mine, theirs)]
            assert weights[0] == pytest.approx(weights[1], rel=1e-3, abs=1e-3)


def test_figure_1_refuses_an_unknown_method():
    with pytest.raises(ValueError, match="method must be one of basic, vario-eta, got 'adam'"):
        figure_1.make_meter("adam", 0)


def test_section_3_3_runs_twice_alike(tmp_path):
    small = {
        "pendulum_seeds": [3],
        "swimmer_seeds": [],
        "pendulum_neurons": [8],
        "pendulum_moments": [5, 10],
    }
    for name in ("a", "b"):
        section_3_3.run(tmp_path / name, **small)
    text = (tmp_path / "a" / section_3_3.LOG).read_text()
    assert text == (tmp_path / "b" / section_3_3.LOG).read_text()
    table = read_table(tmp_path / "a" / section_3_3.LOG)
    assert table["trial"].tolist() == [5, 10, 5, 10]
    assert (table["output"] > table["internal"]).all()
