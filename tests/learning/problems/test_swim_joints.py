"""V in the coordinates of joints, and torques that are chosen to be held: each against another statement of it."""

import numpy as np
import pytest
import torch

from swimmer_mj import state as st
from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.dynamics import to_qpos_qvel
from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import BatchForm, CompiledForm, CoordinatesForm, HoldForm, LanesForm
from swimmer_mj.learning.problems.held import held_control
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER, SwimmerParameters

UNEQUAL = SwimmerParameters(
    n_links=4, mass=[0.5, 1.0, 1.5, 0.7], length=[1.2, 0.8, 1.0, 0.6], torque_limit=[5.0, 4.0, 3.0]
)
SWIMMERS = pytest.mark.parametrize("parameters", [PAPER, UNEQUAL], ids=["paper", "unequal"])
VARIANTS = pytest.mark.parametrize(
    "how",
    [{"coordinates": "joints"}, {"held": True}, {"coordinates": "joints", "held": True}],
    ids=["joints", "held", "both"],
)


def states(problem, count=2 * LANES, seed=0):
    x = problem.initial_states(np.random.default_rng(seed), count)
    n = problem.parameters.n_links
    x[:, :n] *= 10  # several turns
    x[:, n:] *= 3
    return x


def columns(x):
    return np.ascontiguousarray(x.T)


@SWIMMERS
def test_coordinates_are_bends_and_the_velocity_of_the_head(parameters):
    problem, n = Swimming(parameters, coordinates="joints"), parameters.n_links
    x = states(problem)
    form = problem.form(CoordinatesForm)
    y = form.enter(torch.from_numpy(x))
    full = st.split(st.expand(parameters, x), n)
    np.testing.assert_allclose(y[:, 1:n], np.diff(full.angles), rtol=0, atol=1e-12)
    np.testing.assert_allclose(y[:, n + 1 : 2 * n], np.diff(full.angular_velocities), rtol=0, atol=1e-12)
    np.testing.assert_allclose(y[:, [0, n]], x[:, [0, n]], rtol=0, atol=0)
    np.testing.assert_allclose(y[:, 2 * n :], full.velocity, rtol=0, atol=1e-11)
    np.testing.assert_allclose(form.leave(y), x, rtol=0, atol=1e-11)
    compiled = np.empty_like(columns(x))
    problem.form(BatchForm).coordinates.enter(columns(x), compiled)
    np.testing.assert_allclose(compiled.T, y, rtol=0, atol=1e-9)


@SWIMMERS
def test_coordinates_are_those_of_mujoco(parameters):
    """qpos and qvel, where the swimmer is left out."""
    n, problem = parameters.n_links, Swimming(parameters, coordinates="joints")
    x = states(problem)
    qpos, qvel = to_qpos_qvel(st.expand(parameters, x), n)
    y = problem.form(CoordinatesForm).enter(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(np.sin(y[:, :n] - qpos[:, 2:]), 0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(y[:, n : 2 * n], qvel[:, 2:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(y[:, 2 * n :], qvel[:, :2], rtol=0, atol=1e-11)


@SWIMMERS
def test_slopes_go_over_by_the_jacobian(parameters):
    """There and back, against automatic differentiation of the coordinates."""
    problem = Swimming(parameters, coordinates="joints")
    x, slope = states(problem), np.random.default_rng(1).normal(size=(2 * LANES, problem.state_size))
    enter = problem.form(CoordinatesForm).enter
    wanted = torch.func.vjp(enter, torch.from_numpy(x))[1](torch.from_numpy(slope))[0]
    compiled, found = problem.form(BatchForm).coordinates, columns(slope)
    compiled.to_state(columns(x), found)
    np.testing.assert_allclose(found.T, wanted, rtol=1e-9, atol=1e-8)
    back = found[None].copy()
    compiled.from_state(columns(x)[None], back)
    np.testing.assert_allclose(back[0].T, slope, rtol=1e-9, atol=1e-8)


@SWIMMERS
def test_inputs_are_encoded_bends(parameters):
    problem = Swimming(parameters, coordinates="joints")
    x = torch.from_numpy(states(problem))
    y, code = problem.form(CoordinatesForm).enter(x), problem.form(BatchForm).encoding
    z = problem.inputs(x)
    assert z.shape[1] == problem.n_inputs
    np.testing.assert_allclose(z[:, code.cosine], torch.cos(y[:, code.angle]))
    np.testing.assert_allclose(z[:, code.sine], torch.sin(y[:, code.angle]))
    np.testing.assert_allclose(z[:, code.scaled], y[:, code.linear] * torch.from_numpy(code.scale))


@SWIMMERS
@pytest.mark.parametrize("coordinates", ["links", "joints"])
def test_a_torque_is_chosen_for_the_state_at_the_end_of_its_step(parameters, coordinates):
    """As by the equations in NumPy, one Euler step of a hundredth of a second long."""
    problem = Swimming(parameters, coordinates=coordinates, held=True)
    x, limits = states(problem), parameters.torque_limits
    weights = torch.from_numpy(np.random.default_rng(2).normal(size=(problem.n_inputs,)))

    def slope_at(at):
        state = torch.tensor(at.T, requires_grad=True)
        (slope,) = torch.autograd.grad(torch.sin(3 * problem.inputs(state) @ weights).sum(), state)
        return slope.numpy().T

    a, B = problem.drift_and_control_matrix(x)
    gain = np.ascontiguousarray(np.moveaxis(0.01 * B, 0, -1).swapaxes(0, 1))
    nothing = np.zeros((len(limits), len(x)))
    wanted = held_control(slope_at, columns(x + 0.01 * a), gain, limits, nothing)
    found = problem.form(HoldForm).choose(slope_at, x, None)
    np.testing.assert_allclose(found, wanted.T, rtol=0, atol=1e-6)
    inside = np.abs(found) < limits
    assert 0 < inside.sum() < inside.size
    u, y, flips = np.empty_like(nothing), np.empty_like(columns(x)), np.ones_like(nothing)
    batch = problem.form(BatchForm)
    batch.greedy_step(slope_at, columns(x), slope_at(columns(x)), flips, 0.01, u, y)
    np.testing.assert_allclose(u.T, found, rtol=0, atol=1e-9)
    np.testing.assert_allclose(y.T, problem.step(x, found, 0.01), rtol=1e-9, atol=1e-9)
    batch.greedy_rk4(slope_at, columns(x), slope_at(columns(x)), flips, 0.01, u, y)

    def f(state):
        a, B = problem.drift_and_control_matrix(state)
        return a + np.einsum("npq,nq->np", B, found)

    np.testing.assert_allclose(y.T, rk4_step(f, x, 0.01), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("huber", [None, 0.7])
@VARIANTS
def test_both_engines_learn_and_act_alike(how, huber):
    problem = Swimming(s_gamma=0.5, **how)
    settings = ValueGradientSettings(trajectories=32, minibatch=32, steps=5, flips=0.1, huber=huber)
    starts = problem.initial_states(np.random.default_rng(5), 10)
    results = []
    for engine in ("torch", "compiled"):
        generator = torch.Generator().manual_seed(0)
        network = Multilayer(problem.n_inputs, (8, 8), generator=generator, dtype=torch.float64)
        before = torch.nn.utils.parameters_to_vector(network.parameters()).detach().clone()
        learner = ValueGradientLearner(problem, network, settings, seed=1, engine=engine)
        for _ in range(3):
            learner.step()
        results.append((learner._weights, learner.control(starts), learner.rollout(starts, 0.1)))
        assert not torch.equal(before, learner._weights)
        np.testing.assert_allclose(learner.policy()(starts), learner.control(starts), rtol=0, atol=1e-9)
    for by_torch, compiled in zip(*results, strict=True):
        np.testing.assert_allclose(by_torch, compiled, rtol=0, atol=1e-9)


@VARIANTS
def test_forms_of_another_control_or_other_inputs_are_not_offered(how):
    problem = Swimming(**how)
    assert problem.form(CompiledForm) is None
    assert problem.form(LanesForm) is None
    assert isinstance(GreedyPolicy(problem, Multilayer(problem.n_inputs, (4,))), GreedyPolicy)


def test_raw_angles_are_of_links():
    with pytest.raises(ValueError, match="coordinates 'joints' need encoding 'circle', got 'angle'"):
        Swimming(coordinates="joints", encoding="angle")
