from typing import get_args

import numpy as np
import pytest

from swimmer_mj.initial_states import InitialLaw, random_initial_state


@pytest.mark.parametrize("rng", [np.random.default_rng(0), np.random.RandomState(0)])
def test_components_are_uniform_within_their_bounds(rng):
    n = 3
    z = random_initial_state(rng, n, 20_000)
    assert z.shape == (20_000, 2 * n + 2)
    bound = np.array([np.pi] * n + [1.0] * n + [0.3] * 2)
    assert (np.abs(z) <= bound).all()
    np.testing.assert_allclose(z.mean(0) / bound, 0, atol=0.03)
    np.testing.assert_allclose(z.std(0) / bound, 1 / np.sqrt(3), rtol=0.03)
    correlations = np.corrcoef(z.T) - np.eye(2 * n + 2)
    assert np.abs(correlations).max() < 0.04


@pytest.mark.parametrize("law", get_args(InitialLaw))
def test_states_are_drawn_one_after_the_other(law):
    many = random_initial_state(np.random.default_rng(1), 5, 4, law)
    rng = np.random.default_rng(1)
    one, two = random_initial_state(rng, 5, law=law), random_initial_state(rng, 5, 3, law)
    assert one.shape == (12,)
    np.testing.assert_array_equal(np.vstack([one, two]), many)


def test_other_laws():
    rng = np.random.default_rng(2)
    rest, fast, straight = (random_initial_state(rng, 4, 1000, law) for law in ("rest", "fast", "straight"))
    assert (rest[:, 4:] == 0).all()
    assert np.abs(rest[:, :4]).max() > 3.1
    assert 2.9 < np.abs(fast[:, 4:8]).max() <= 3.0
    assert 0.8 < np.abs(fast[:, 8:]).max() <= 0.9
    assert (straight[:, 4:] == 0).all()
    bends = straight[:, :4] - straight[:, :1]
    assert 0.9 < np.abs(bends).max() <= 1.0
    assert np.abs(straight[:, 0]).max() > 3.0
    with pytest.raises(ValueError, match=r"law must be one of 'moderate', .* 'gliding', got 'wild'"):
        random_initial_state(rng, 4, law="wild")


def test_half_of_those_that_glide():
    states = random_initial_state(np.random.default_rng(3), 4, 4000, "gliding")
    glides = np.abs(states[:, 8]) > 0.3
    some, others = states[glides], states[~glides]
    assert 0.44 < glides.mean() < 0.5  # 0.06 of those that glide are as slow as the others
    assert (some[:, 9] == 0).all()
    assert 4.9 < some[:, 8].max() <= 5.0
    assert some[:, 8].min() > 0
    tail_first = np.cos(some[:, 0]) < 0
    assert 0.45 < tail_first.mean() < 0.55
    off = some[:, :4] - np.pi * tail_first[:, None]
    assert 0.65 < np.abs(off).max() <= 0.7
    assert 0.55 < np.ptp(off, axis=1).max() <= 0.6
    assert np.abs(states[:, 4:8]).max() <= 1.0
    assert others[:, :4].min() < -3.1
