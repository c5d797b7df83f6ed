"""Value gradients on a GPU; without one, test_second_device.py stands for it."""

import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device here")

SETTINGS = ValueGradientSettings(trajectories=32, steps=4, minibatch=32, flips=0.1)


def learn(network, device):
    """Two rounds, a resume, another round: weights, speeds of episodes, controls."""
    problem = Swimming(PAPER)
    learner = ValueGradientLearner(problem, network.to(device), SETTINGS, engine="torch")
    for _ in range(2):
        learner.step()
    state = learner.state_dict()
    learner = ValueGradientLearner(problem, network, SETTINGS, seed=1, engine="torch")
    learner.load_state_dict(state)
    learner.step()
    assert {w.device.type for w in network.parameters()} == {device}
    starts = problem.initial_states(np.random.default_rng(3), 4)
    return learner._weights.cpu().numpy(), learner.rollout(starts, 0.05), learner.control(starts)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-10), (torch.float32, 1e-4)])
@pytest.mark.parametrize(
    "make", [lambda m, **how: Multilayer(m, (8, 8), **how), lambda m, **how: Cascade(m, 6, **how)]
)
def test_a_gpu_learns_what_the_processor_learns(make, dtype, tolerance):
    m = Swimming(PAPER).n_inputs
    here, there = (
        learn(make(m, generator=torch.Generator().manual_seed(0), dtype=dtype), device)
        for device in ("cpu", "cuda")
    )
    for a, b in zip(here, there, strict=True):
        assert a.any()
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


def test_the_same_seed_gives_the_same_bits_on_a_gpu():
    m = Swimming(PAPER).n_inputs
    runs = [
        learn(Multilayer(m, (8, 8), generator=torch.Generator().manual_seed(0)), "cuda") for _ in range(2)
    ]
    for a, b in zip(*runs, strict=True):
        np.testing.assert_array_equal(a, b)
