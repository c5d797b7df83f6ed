import numpy as np
import pytest
import torch

from swimmer_mj.learning.td.vario_eta import VarioEta, learning_rate, variance


def test_variance_of_equal_changes_approaches_their_square_geometrically():
    v, beta, gradient = 9.0, 0.01, 0.5
    for k in range(1, 301):
        v = variance(v, 0.2 * gradient, 0.2, beta)
        assert v == pytest.approx(gradient**2 + (1 - beta) ** k * (9.0 - gradient**2), rel=1e-12)


def test_variance_does_not_depend_on_the_rate_that_made_the_change():
    gradients = np.random.default_rng(0).normal(size=50)
    v = w = 1.0
    for gradient in gradients:
        v = variance(v, 0.1 * gradient, 0.1, 0.05)
        w = variance(w, 7.0 * gradient, 7.0, 0.05)
    assert v == pytest.approx(w, rel=1e-12)


def test_rate_is_inverse_to_the_noise_and_bounded():
    assert learning_rate(4.0, 0.1, 0.0) == pytest.approx(0.05)
    assert learning_rate(0.0, 0.1, 0.01) == pytest.approx(10.0)


def test_works_on_arrays_and_tensors():
    v, change = np.array([1.0, 2.0]), np.array([0.1, -0.2])
    expected = variance(v, change, 0.1, 0.5)
    assert expected == pytest.approx([1.0, 3.0])
    assert variance(torch.tensor(v), torch.tensor(change), torch.tensor(0.1), 0.5).numpy() == pytest.approx(
        expected
    )
    assert learning_rate(torch.tensor(v), 0.1, 0.0).numpy() == pytest.approx(0.1 / np.sqrt(v))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"beta": 0.0}, r"beta must be in \(0, 1\], got 0.0"),
        ({"epsilon": -1.0}, "epsilon must be positive and finite, got -1.0"),
        ({"initial_variance": float("inf")}, "initial_variance must be positive and finite, got inf"),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        VarioEta(**arguments)
