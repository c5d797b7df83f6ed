"""The Gauss-Newton diagonal against autograd, against sums over paths, and against what it is exact for."""

from itertools import combinations, pairwise, product

import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.layered import Layered
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.td.levenberg_marquardt import (
    Firing,
    LevenbergMarquardt,
    average,
    fire,
    gauss_newton_diagonal,
    learning_rate,
    squared_gradient,
)


def network_for(kind=Cascade, n=7, sigmoid=None, seed=0):
    """A network on 3 inputs whose output weights are not zero; n neurons, the output counted."""
    generator = torch.Generator().manual_seed(seed)
    options = {"generator": generator, "dtype": torch.float64}
    network = kind(3, n - 1 if kind is Layered else n, **options, **({"sigmoid": sigmoid} if sigmoid else {}))
    draw = torch.randn(network.weight.shape[1], generator=generator, dtype=torch.float64)
    with torch.no_grad():
        network.weight[-1] = torch.where(network.connected[-1], draw, 0.0)
    return network


def inputs(count, seed=1):
    return np.random.default_rng(seed).normal(size=(count, 3))


def gradients(network, z):
    """dV/dw by autograd, shape (count, n, m + n)."""
    rows = [torch.autograd.grad(network(torch.tensor(x)), network.weight)[0] for x in z]
    return torch.stack(rows).numpy() * network.connected.numpy()


def both(network, z):
    weight = network.weight.detach().numpy()
    firing = fire(weight, z, network.sigmoid)
    return gauss_newton_diagonal(weight, firing), squared_gradient(weight, firing)


@pytest.mark.parametrize("sigmoid", ["tanh", "logistic"])
def test_the_neurons_fire_as_those_of_the_network(sigmoid):
    network, z = network_for(sigmoid=sigmoid), inputs(20)
    weight = network.weight.detach().numpy()
    firing = fire(weight, z, sigmoid)
    assert firing.sources[:, :4].tolist() == [[*x, 1.0] for x in z]
    assert firing.sources @ weight[-1] == pytest.approx(network(torch.tensor(z)).detach().numpy(), rel=1e-13)


@pytest.mark.parametrize("sigmoid", ["tanh", "logistic"])
def test_the_squared_gradient_is_autograds(sigmoid):
    network, z = network_for(sigmoid=sigmoid), inputs(20)
    assert both(network, z)[1] == pytest.approx(gradients(network, z) ** 2, rel=1e-10, abs=1e-15)


def test_with_one_hidden_layer_the_diagonal_is_the_squared_gradient():
    network, z = network_for(Layered), inputs(20)
    h, exact = both(network, z)[0], gradients(network, z) ** 2
    connected = network.connected.numpy()
    assert (exact[:, connected] > 0).all()
    assert h[:, connected] == pytest.approx(exact[:, connected], rel=1e-10)


def test_in_a_chain_the_diagonal_is_the_squared_gradient():
    """Neuron 0 hears the inputs, each other one its predecessor and the bias."""
    network, z = network_for(n=5), inputs(20)
    chain = torch.zeros_like(network.connected)
    chain[:, 3] = True
    chain[0, :3] = True
    for i in range(1, 5):
        chain[i, 3 + i] = True
    with torch.no_grad():
        network.weight[~chain] = 0.0
    h, exact = both(network, z)[0], gradients(network, z) ** 2
    assert (exact[:, chain] > 0).all()
    assert h[:, chain] == pytest.approx(exact[:, chain], rel=1e-10)


def test_output_weights_have_the_mean_square_of_their_source():
    network, z = network_for(), inputs(50)
    h, _ = both(network, z)
    sources = fire(network.weight.detach().numpy(), z).sources
    assert h.mean(axis=0)[-1] == pytest.approx((sources**2).mean(axis=0), rel=1e-13)
    assert h[:, -1, 3] == pytest.approx(1.0)  # the bias


def test_the_recursion_is_the_sum_over_all_paths_to_the_output():
    """c_k sums, over k < j_1 < ... < output, the squares of all weights and slopes on the way."""
    network, n = network_for(n=6), 6
    weight = network.weight.detach().numpy()
    firing = fire(weight, inputs(1)[0])
    h = gauss_newton_diagonal(weight, firing)
    for k in range(n):
        c = 1.0 if k == n - 1 else 0.0
        between = range(k + 1, n - 1)
        for stops in (s for size in range(len(between) + 1) for s in combinations(between, size)):
            if k < n - 1:
                path = (k, *stops, n - 1)
                c += np.prod([(weight[j, 4 + i] * firing.slopes[i]) ** 2 for i, j in pairwise(path)])
        heard = 4 + k
        assert h[k, :heard] == pytest.approx(c * firing.sources[:heard] ** 2, rel=1e-12)
        assert (h[k, heard:] == 0).all()


def test_in_a_cascade_it_is_the_mean_of_the_squared_gradient_over_all_signs_of_the_weights():
    weight, z = network_for(n=4).weight.detach().numpy(), inputs(1)[0]
    firing = fire(weight, z)
    h = gauss_newton_diagonal(weight, firing)
    assert squared_gradient(weight, firing)[0] != pytest.approx(h[0], rel=0.01)
    connections = [(j, 4 + k) for j in range(4) for k in range(j)]
    total = np.zeros_like(h)
    for signs in product((-1.0, 1.0), repeat=len(connections)):
        other = weight.copy()
        for place, sign in zip(connections, signs, strict=True):
            other[place] *= sign
        total += squared_gradient(other, firing)
    assert total / 2 ** len(connections) == pytest.approx(h, rel=1e-12)


def test_leading_axes_are_independent():
    weights = np.stack([network_for(seed=seed).weight.detach().numpy() for seed in range(2)])
    z = inputs(6).reshape(2, 3, 3)
    together = gauss_newton_diagonal(weights[:, None], fire(weights[:, None], z))
    assert together.shape == (2, 3, *weights.shape[1:])
    for a in range(2):
        for b in range(3):
            alone = gauss_newton_diagonal(weights[a], fire(weights[a], z[a, b]))
            assert together[a, b] == pytest.approx(alone, rel=1e-13)


def test_arguments_are_left_alone():
    weight, z = network_for().weight.detach().numpy(), inputs(2)
    before, firing = weight.copy(), fire(weight, z)
    copy = Firing(*(array.copy() for array in firing))
    gauss_newton_diagonal(weight, firing)
    assert (weight == before).all()
    assert all((a == b).all() for a, b in zip(firing, copy, strict=True))


def test_the_average_approaches_what_is_shown_geometrically():
    h = np.array([1.0, 1.0])
    for k in range(1, 201):
        h = average(h, np.array([4.0, 0.0]), 0.01)
        assert h == pytest.approx([4 - 3 * 0.99**k, 0.99**k], rel=1e-12)


def test_rate_is_inverse_to_the_curvature_and_bounded():
    rate = learning_rate(np.array([0.0, 0.4, 9.9]), 0.1, 0.1)
    assert rate == pytest.approx([1.0, 0.2, 0.01])
    assert learning_rate(np.array([0.4]), np.array([0.1]), np.array([0.1])) == pytest.approx([0.2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gamma": 0.0}, r"gamma must be in \(0, 1\], got 0.0"),
        ({"mu": 0.0}, "mu must be positive and finite, got 0.0"),
        (
            {"initial_curvature": float("nan")},
            "initial_curvature must be positive and finite, got nan",
        ),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        LevenbergMarquardt(**arguments)
