"""Swimming as a control problem, its compiled form, and learning through dm_control."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.learning.problems.forms import CompiledForm, TrialsForm
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.reduced import compile_reduced_dynamics, reduced_constants
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.parameters import MOST_LINKS, SwimmerParameters


def unequal(n, seed=0):
    rng = np.random.default_rng(seed)
    return SwimmerParameters(
        n, rng.uniform(0.3, 3, n), rng.uniform(0.3, 3, n), rng.uniform(0.5, 20), rng.uniform(1, 10, n - 1)
    )


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_compiled_form_agrees_with_the_equations_of_the_paper(n):
    """Lagrange's equations in reduced variables against A.3's force balance."""
    problem = Swimming(unequal(n))
    compiled = problem.form(CompiledForm)
    for x in problem.initial_states(np.random.default_rng(n), 30):
        a, B = np.zeros(2 * n + 2), np.zeros((2 * n + 2, n - 1))
        compiled.dynamics(compiled.constants, x, a, B)
        expected_a, expected_B = problem.drift_and_control_matrix(x)
        assert np.abs(a - expected_a).max() < 1e-11 * np.abs(expected_a).max()
        assert np.abs(B - expected_B).max() < 1e-11 * np.abs(expected_B).max()
        assert compiled.reward(compiled.constants, x) == x[2 * n]


def test_as_many_links_as_there_may_be_fit_into_a_thread():
    """Their matrices, of 1,000 x 1,000 numbers, would not fit on its stack."""
    problem = Swimming(SwimmerParameters(MOST_LINKS))
    compiled = problem.form(CompiledForm)
    (x,) = problem.initial_states(np.random.default_rng(0), 1)
    a, B = np.zeros(problem.state_size), np.zeros((problem.state_size, MOST_LINKS - 1))
    with ThreadPoolExecutor(1) as pool:
        pool.submit(compiled.dynamics, compiled.constants, x, a, B).result()
    expected_a, expected_B = problem.drift_and_control_matrix(x)
    assert np.abs(a - expected_a).max() < 1e-9 * np.abs(expected_a).max()
    assert np.abs(B - expected_B).max() < 1e-9 * np.abs(expected_B).max()


def test_a_single_link_has_reduced_dynamics_too():
    parameters = SwimmerParameters(1, 2.0, 0.5, 7.0)
    z, a = np.array([0.3, 1.2, 0.7, -0.4]), np.zeros(4)
    compile_reduced_dynamics(1)(reduced_constants(parameters), z, a, np.zeros((4, 0)))
    x = st.expand(parameters, z)
    assert a == pytest.approx(
        st.reduce_derivative(parameters, x, AnalyticSwimmer(parameters).drift(x)), rel=1e-13
    )


@pytest.mark.parametrize("encoding", ["circle", "angle", "unwrapped"])
def test_inputs_and_their_pullback_agree_with_autograd(encoding):
    problem = Swimming(unequal(4), encoding=encoding)
    compiled = problem.form(CompiledForm)
    rng = np.random.default_rng(0)
    for x in 3 * problem.initial_states(rng, 10):  # some angles beyond pi
        z, dVdx = np.zeros(problem.n_inputs), np.zeros(problem.state_size)
        compiled.inputs(x, z)
        state = torch.tensor(x, requires_grad=True)
        expected = problem.inputs(state)
        assert z == pytest.approx(expected.detach().numpy(), rel=1e-14)
        dVdz = rng.normal(size=problem.n_inputs)
        compiled.input_pullback(z, dVdz, dVdx)
        (expected_dVdx,) = torch.autograd.grad(expected @ torch.tensor(dVdz), state)
        assert dVdx == pytest.approx(expected_dVdx.numpy(), rel=1e-12)
        turns = 2 * np.pi * np.concatenate([[1.0, -1.0, 2.0, 0.0], np.zeros(6)])
        z_turned = z + turns if encoding == "unwrapped" else z
        assert problem.inputs(torch.tensor(x + turns)).numpy() == pytest.approx(z_turned, rel=1e-9)


def test_euler_step_is_first_order_in_the_reduced_variables():
    problem = Swimming(unequal(3))
    x = problem.initial_states(np.random.default_rng(0), 1)[0]
    u = np.array([1.0, -2.0])
    a, B = problem.drift_and_control_matrix(x)
    assert problem.step(x, u, 0.01) == pytest.approx(x + 0.01 * (a + B @ u), rel=1e-12)


def test_rk4_step_is_that_of_the_full_state():
    parameters = unequal(3)
    x = Swimming(parameters).initial_states(np.random.default_rng(0), 1)[0]
    u = np.array([1.0, -2.0])
    full = AnalyticSwimmer(parameters).rk4_step(st.expand(parameters, x), u, 0.01)
    stepped = Swimming(parameters, integrator="rk4").step(x, u, 0.01)
    assert stepped == pytest.approx(st.reduce(parameters, full), rel=1e-13)


def test_batches_like_single_states():
    problem = Swimming(unequal(4))
    x = problem.initial_states(np.random.default_rng(0), 6).reshape(2, 3, -1)
    a, B = problem.drift_and_control_matrix(x)
    one_a, one_B = problem.drift_and_control_matrix(x[1, 2])
    assert a[1, 2] == pytest.approx(one_a, rel=1e-12)
    assert B[1, 2] == pytest.approx(one_B, rel=1e-12)
    assert problem.reward(x).shape == (2, 3)


def test_mujoco_gives_the_same_problem():
    parameters = unequal(4)
    x = Swimming(parameters).initial_states(np.random.default_rng(0), 20)
    a, B = Swimming(parameters).drift_and_control_matrix(x)
    mujoco_a, mujoco_B = Swimming(parameters, physics="mujoco").drift_and_control_matrix(x)
    assert np.abs(mujoco_a - a).max() < 1e-10 * np.abs(a).max()
    assert np.abs(mujoco_B - B).max() < 1e-10 * np.abs(B).max()


@pytest.mark.parametrize("physics", ["analytic", "mujoco"])
def test_several_threads_may_ask_at_once(physics):
    """As the runs of several seeds do, which share a problem."""
    problem = Swimming(unequal(3), physics=physics)
    batches = [problem.initial_states(np.random.default_rng(k), 100) for k in range(4)]
    expected = [problem.drift_and_control_matrix(x)[0] for x in batches]

    def differs(k):
        return any((problem.drift_and_control_matrix(batches[k])[0] != expected[k]).any() for _ in range(20))

    with ThreadPoolExecutor(4) as pool:
        assert not any(pool.map(differs, range(4)))
    again = pickle.loads(pickle.dumps(problem))
    assert again == problem
    assert (again.drift_and_control_matrix(batches[0])[0] == expected[0]).all()


@pytest.mark.parametrize("engine", ["fused", "torch"])
def test_learning_through_dm_control_is_learning_on_the_equations(engine):
    """Same trials, one stepped by the suite environment, one by A.3 with the same integrator.

    Rounding differs, and bang-bang control switches where rounding decides sooner or later; up to there, and here for
    all of three trials, values and weights agree to float64 accuracy.
    """
    settings = TDSettings(eta=0.04, trial_duration=0.5)
    through_mujoco = Swimming(physics="mujoco")
    on_equations = Swimming(integrator="rk4")
    network = TemporalDifferences(settings, 20, "float64").network(through_mujoco, 0)
    generator = torch.Generator().manual_seed(5)
    with torch.no_grad():
        row = network.weight[-1]
        row[:] = 0.3 * torch.randn(row.shape, generator=generator, dtype=torch.float64)
    before = network.weight.detach().clone()
    twin = copy.deepcopy(network)
    make = FusedTD if engine == "fused" else ContinuousTD
    starts = on_equations.initial_states(np.random.default_rng(0), 3)

    environment = through_mujoco.form(TrialsForm)
    moments = environment.learn(make(through_mujoco, network, settings), starts, 0.5, 0.01)

    learner = make(on_equations, twin, settings)
    expected = []
    for x in starts:
        learner.start_trial()
        for _ in range(settings.steps_per_trial):
            expected.append(learner.learn_at(x))
            x = on_equations.step(x, expected[-1].control, settings.dt)
        learner.end_trial()

    assert len(moments) == len(expected) == 150
    assert all((m.control == e.control).all() for m, e in zip(moments, expected, strict=True))
    for m, e in zip(moments, expected, strict=True):
        assert m.value == pytest.approx(e.value, abs=1e-10)
        assert m.hamiltonian == pytest.approx(e.hamiltonian, abs=1e-8)
    assert (network.weight - twin.weight).abs().max() < 1e-10
    assert (network.weight - before).abs().max() > 1e-3  # it did learn


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"parameters": SwimmerParameters(1)}, "at least 2 links to have a joint to move, got 1"),
        ({"s_gamma": 0.0}, "s_gamma must be positive and finite, got 0.0"),
        ({"integrator": "leapfrog"}, "integrator must be one of 'euler', 'rk4'; got 'leapfrog'"),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        Swimming(**arguments)
