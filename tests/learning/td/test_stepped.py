"""The network's part of TD(lambda) compiled, against the reference, which does it by torch."""

import copy

import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.cart_pole import CartPole
from swimmer_mj.learning.problems.mujoco import MujocoProblem
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.td.stepped import SteppedTD
from swimmer_mj.learning.td.vario_eta import VarioEta

ARM = """
<mujoco>
  <option timestep="0.01"><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.05"/>
      <body pos="0 0 -0.5">
        <joint name="elbow" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04"/>
        <site name="hand" pos="0 0 -0.4"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder" gear="20" ctrlrange="-1 1"/><motor joint="elbow" gear="8" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def height(scene):
    return scene.site("hand")[:, 2]


PROBLEMS = {
    "an arm, torques held": lambda: MujocoProblem(ARM, height, threads=1),
    "an arm, torques of the instant that cost": lambda: MujocoProblem(
        ARM, height, control_cost=[0.1, 0.3], held=False, threads=1
    ),
    "cart-pole": CartPole,
    "pendulum": Pendulum,
    "swimmer by RK4": lambda: Swimming(integrator="rk4"),
}


@pytest.fixture(scope="module", params=PROBLEMS.values(), ids=PROBLEMS.keys())
def problem(request):
    return request.param()


SETTINGS = {
    "plain": (TDSettings(eta=0.2, trial_duration=0.3), "tanh"),
    "logistic": (TDSettings(eta=0.2, s_lambda=3.0, output_scaling=False, trial_duration=0.3), "logistic"),
    "vario-eta": (
        TDSettings(eta=0.1, trial_duration=0.1, vario=VarioEta(epsilon=0.1, initial_variance=1.0)),
        "tanh",
    ),
}


def twins(problem, settings, sigmoid, dtype):
    generator = torch.Generator().manual_seed(0)
    network = Cascade(problem.n_inputs, 9, generator=generator, dtype=dtype, sigmoid=sigmoid)
    with torch.no_grad():
        network.weight[-1] = 0.3 * torch.randn(network.weight.shape[1], generator=generator, dtype=dtype)
    return ContinuousTD(problem, copy.deepcopy(network), settings), SteppedTD(problem, network, settings)


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
def test_learns_what_the_reference_learns(problem, settings):
    reference, stepped = twins(problem, *settings, torch.float64)
    before = stepped.network.weight.detach().clone()
    for x in problem.initial_states(np.random.default_rng(0), 3):
        for one, other in zip(stepped.run_trial(x), reference.run_trial(x), strict=True):
            np.testing.assert_allclose(one.control, other.control, rtol=1e-6, atol=1e-9)
            assert one.value == pytest.approx(other.value, rel=1e-9, abs=1e-11)
            assert one.hamiltonian == pytest.approx(other.hamiltonian, rel=1e-8, abs=1e-9)
    for name in ("weights", "traces", "variances", "rates"):
        (found,), (expected,) = getattr(stepped, name), getattr(reference, name)
        assert torch.allclose(found, expected, rtol=1e-8, atol=1e-9), name
    assert (stepped.network.weight - before).abs().max() > 1e-4  # it did learn
    assert (stepped.network.weight[~stepped.network.connected] == 0).all()


def test_a_step_in_float32_is_the_reference_s_to_its_digits():
    problem = Pendulum()
    reference, stepped = twins(problem, TDSettings(eta=0.2), "tanh", torch.float32)
    for learner in (reference, stepped):
        learner.start_trial()
        for x in problem.initial_states(np.random.default_rng(0), 4):
            learner.learn_at(x)
    assert stepped.network.weight.dtype == torch.float32
    assert torch.allclose(stepped.network.weight, reference.network.weight, rtol=1e-4, atol=1e-6)


def test_it_is_what_learns_where_nothing_is_compiled(problem):
    learner = TemporalDifferences(TDSettings(trial_duration=0.1), neurons=5).start(problem, 0)
    assert type(learner.by_steps) is (type(None) if isinstance(problem, Pendulum) else SteppedTD)
