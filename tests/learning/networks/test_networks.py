import math

import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming


def make(network=Cascade, seed=0, **kwargs):
    generator = torch.Generator().manual_seed(seed)
    return network(5, generator=generator, dtype=torch.float64, **kwargs)


def with_random_output(network, seed=1):
    """Initial output weights are zero; most tests want a value that depends on everything."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        row = network.weight[-1]
        row[:] = torch.randn(row.shape, generator=generator, dtype=row.dtype)
    return network


def inputs(*shape):
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(2))


def test_cascade_is_what_its_definition_says():
    network = with_random_output(make(n_neurons=7))
    z = inputs(5)
    W = network.weight.tolist()
    heard = [*z.tolist(), 1.0]
    for i in range(7):
        activation = sum(w * y for w, y in zip(W[i], heard, strict=False))
        heard.append(activation if i == 6 else math.tanh(activation))
    assert network(z).item() == pytest.approx(heard[-1], rel=1e-14)


def test_cascade_batches():
    network = with_random_output(make(n_neurons=9))
    z = inputs(3, 4, 5)
    batched = network(z)
    assert batched.shape == (3, 4)
    assert torch.allclose(batched[2, 1], network(z[2, 1]), rtol=1e-14)


def test_no_gradient_reaches_weights_without_a_connection():
    network = with_random_output(make(n_neurons=9))
    network(inputs(5)).backward()
    gradient = network.weight.grad
    assert gradient is not None
    assert (gradient[~network.connected] == 0).all()
    assert (gradient[network.connected] != 0).all()
    assert (network.weight[~network.connected] == 0).all()


def test_number_of_connections_of_the_papers_network():
    network = Cascade(17, 60)
    assert int(network.connected.sum()) == 60 * 18 + 60 * 59 // 2


@pytest.mark.parametrize("network", [make(), make(Multilayer)])
def test_value_is_zero_at_first(network):
    assert (network(inputs(100, 5)) == 0).all()


def test_hidden_weights_have_the_stated_spread():
    weight = Cascade(17, 60, generator=torch.Generator().manual_seed(0), dtype=torch.float64).weight
    scaled = torch.cat([weight[i, : 18 + i] * (18 + i) ** 0.5 for i in range(59)])
    # A sample of 2773 normal numbers: standard errors of mean and of standard deviation are 0.019 and 0.013.
    assert abs(scaled.mean().item()) < 0.08
    assert abs(scaled.std().item() - 1) < 0.06


def test_same_seed_same_network():
    assert torch.equal(make(seed=3).weight, make(seed=3).weight)
    assert not torch.equal(make(seed=3).weight, make(seed=4).weight)


def test_cascade_learning_rates():
    network = make(n_neurons=16)
    (rates,) = network.learning_rates(0.1)
    assert (rates[~network.connected] == 0).all()
    assert (rates[:-1][network.connected[:-1]] == 0.1).all()
    assert rates[-1].tolist() == pytest.approx([0.1 / 4] * rates.shape[1])
    (unscaled,) = network.learning_rates(0.1, output_scaling=False)
    assert (unscaled[-1] == 0.1).all()


def test_multilayer_shapes_and_learning_rates():
    network = make(Multilayer, hidden=(4, 11))
    assert [tuple(w.shape) for w in network.parameters()] == [(4, 5), (4,), (11, 4), (11,), (1, 11), (1,)]
    rates = network.learning_rates(0.1)
    assert [rate.unique().item() for rate in rates] == pytest.approx([0.1] * 4 + [0.1 / 4] * 2)
    assert network(inputs(2, 3, 5)).shape == (2, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((0, 60), "n_inputs must be at least 1, got 0"), ((3, 0), "n_neurons must be at least 1, got 0")],
)
def test_cascade_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        Cascade(*arguments)


def test_multilayer_refuses():
    with pytest.raises(ValueError, match="width must be at least 1, got 0"):
        Multilayer(3, (5, 0))


@pytest.mark.parametrize("without", [torch.no_grad, torch.inference_mode])
@pytest.mark.parametrize(
    "problem", [Pendulum(), Swimming(coordinates="joints", held=True)], ids=lambda problem: problem.name
)
def test_a_policy_acts_where_gradients_are_turned_off(problem, without):
    network = Cascade(problem.n_inputs, 4, generator=torch.Generator().manual_seed(0))
    torch.nn.init.constant_(network.weight[-1], 0.3)
    policy, x = GreedyPolicy(problem, network), problem.initial_states(np.random.default_rng(0), 5)
    expected = policy.judge(x)
    with without():
        found = policy.judge(x)
    for one, other in zip(found, expected, strict=True):
        assert (one == other).all()
