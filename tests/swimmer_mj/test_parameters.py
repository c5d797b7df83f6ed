import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from swimmer_mj.parameters import PAPER, SwimmerParameters

positive = some.floats(min_value=1e-3, max_value=1e3)
not_positive_or_finite = some.sampled_from([0.0, -1.0, -1e-300, math.inf, -math.inf, math.nan])


def test_paper_has_the_values_of_a5():
    assert PAPER.n_links == 5
    assert PAPER.masses.tolist() == [1.0] * 5
    assert PAPER.lengths.tolist() == [1.0] * 5
    assert PAPER.torque_limits.tolist() == [5.0] * 4
    assert PAPER.viscous_friction == 10.0


@given(some.integers(1, 8), positive, positive, positive)
def test_scalars_stand_for_equal_links(n, mass, length, torque_limit):
    scalars = SwimmerParameters(n, mass, length, torque_limit=torque_limit)
    sequences = SwimmerParameters(n, [mass] * n, [length] * n, torque_limit=[torque_limit] * (n - 1))
    assert scalars == sequences
    assert hash(scalars) == hash(sequences)


@pytest.mark.parametrize("n_links", [0, -1])
def test_refuses_fewer_than_one_link(n_links):
    with pytest.raises(ValueError, match=f"n_links must be at least 1, got {n_links}"):
        SwimmerParameters(n_links)


@pytest.mark.parametrize("n_links", [2.0, "3", None])
def test_refuses_a_number_of_links_that_is_no_integer(n_links):
    with pytest.raises(TypeError, match="n_links must be an integer"):
        SwimmerParameters(n_links)


@pytest.mark.parametrize("name", ["mass", "length", "torque_limit"])
@given(value=not_positive_or_finite, position=some.integers(0, 1))
def test_refuses_values_that_are_not_positive_and_finite(name, value, position):
    with pytest.raises(ValueError, match=f"{name} must be positive and finite"):
        SwimmerParameters(3, **{name: value})
    values = [1.0, 1.0, 1.0][: 2 if name == "torque_limit" else 3]
    values[position] = value
    with pytest.raises(ValueError, match=f"{name} must be positive and finite"):
        SwimmerParameters(3, **{name: values})


@pytest.mark.parametrize("value", [-1.0, math.inf, math.nan])
def test_refuses_negative_or_infinite_friction(value):
    with pytest.raises(ValueError, match="viscous_friction must be finite and not negative"):
        SwimmerParameters(viscous_friction=value)


def test_allows_no_friction():
    assert SwimmerParameters(viscous_friction=0).viscous_friction == 0.0


@pytest.mark.parametrize(("name", "wrong"), [("mass", 2), ("length", 4), ("torque_limit", 3)])
def test_refuses_wrong_lengths(name, wrong):
    with pytest.raises(ValueError, match=f"{name} must be a scalar or have"):
        SwimmerParameters(3, **{name: [1.0] * wrong})


def test_another_number_of_links_says_where_to_get_its_parameters():
    message = (
        r"mass must be a scalar or have 3 values, one per link; got 5: \(1\.0, .*\) "
        r"\(SwimmerParameters\(n_links=3\) has the paper's\)$"
    )
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PAPER, n_links=3)
    with pytest.raises(ValueError, match=r"have 2 values, one per joint; got 4: .*n_links=3\)"):
        SwimmerParameters(3, torque_limit=PAPER.torque_limit)
    with pytest.raises(ValueError, match=r"one per link; got shape \(1, 3\): "):
        SwimmerParameters(3, mass=np.ones((1, 3)))


@pytest.mark.parametrize("name", ["mass", "length", "viscous_friction", "torque_limit"])
def test_refuses_what_is_no_number(name):
    for value in ("heavy", None, [1.0, [2.0, 3.0]]):
        with pytest.raises(TypeError, match=f"{name} must be a number.*, got {re.escape(repr(value))}"):
            SwimmerParameters(3, **{name: value})


def test_arrays_are_copies():
    swimmer = SwimmerParameters(3)
    swimmer.masses[:] = 7
    np.testing.assert_array_equal(swimmer.masses, 1.0)
