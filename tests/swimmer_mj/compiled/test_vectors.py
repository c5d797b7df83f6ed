"""Vectors and functions for tight loops, against NumPy."""

from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from swimmer_mj.compiled.elementary import cos_sin
from swimmer_mj.compiled.vectors import (
    LANES,
    add_lanes,
    aligned_zeros,
    clamp,
    load,
    multiply_add,
    round_up,
    splat,
    store,
)

OPERATIONS = ("copy", "splat", "multiply", "divide", "clamp", "multiply_add")


@njit
def cosines_and_sines(x, c, s):
    for i in range(x.size):
        c[i], s[i] = cos_sin(x[i])


@njit
def every_operation(a, b, c, scalar, out):
    """Row k of ``out`` gets operation k of the vectors at index 3, which no vector register is aligned to."""
    o = 3
    x, y, z = load(a, o), load(b, o), load(c, o)
    width = out.shape[1]
    store(out, o, x)
    store(out, width + o, splat(scalar))
    store(out, 2 * width + o, x * y)
    store(out, 3 * width + o, x / y)
    store(out, 4 * width + o, clamp(x, y, z))
    store(out, 5 * width + o, multiply_add(x, y, z))
    return add_lanes(x)


def worst_error(x):
    c, s = np.empty_like(x), np.empty_like(x)
    cosines_and_sines(x, c, s)
    return max(np.abs(c - np.cos(x)).max(), np.abs(s - np.sin(x)).max())


@pytest.mark.parametrize("size", [1e-300, 1e-8, 1.0, 10.0, 1e3, 1e5])
def test_cosine_and_sine_are_exact_to_1e_15(size):
    assert worst_error(np.random.default_rng(0).uniform(-size, size, 100_000)) < 1e-15


def test_cosine_and_sine_are_exact_where_the_quadrant_changes():
    """Reduction changes its multiple of pi/2 at odd multiples of pi/4; results are smallest at those of pi/2."""
    edges = np.arange(-1000, 1001) * (np.pi / 4)
    far = np.arange(127_000, 127_300) * (np.pi / 4)  # up to 1e5
    x = np.concatenate([edges, far, -far])
    steps = x + np.arange(-2, 3)[:, None] * np.spacing(x)
    assert worst_error(steps.ravel()) < 1e-15


def test_cosine_and_sine_at_zero():
    c, s = np.empty(2), np.empty(2)
    cosines_and_sines(np.array([0.0, -0.0]), c, s)
    assert (c == 1).all()
    assert (s == 0).all()


@pytest.fixture(scope="module", params=[np.float32, np.float64], ids=["float32", "float64"])
def results(request):
    """Operands (3, LANES), the scalar, the rows of results with what surrounds them, the sum."""
    dtype = request.param
    operands = np.random.default_rng(1).normal(size=(3, LANES + 6)).astype(dtype)
    operands[1:] = np.sort(operands[1:], axis=0)  # low <= high for clamp
    scalar = dtype(0.1)
    out = np.full((len(OPERATIONS), LANES + 6), 7, dtype)
    total = every_operation(*operands, scalar, out)
    return operands[:, 3:-3], scalar, out, total


def test_operations_agree_with_numpy(results):
    (a, b, c), scalar, out, _ = results
    expected = {
        "copy": a,
        "splat": np.full_like(a, scalar),
        "multiply": a * b,
        "divide": a / b,
        "clamp": np.clip(a, b, c),
    }
    assert {(a < b).any(), (a > c).any(), ((a > b) & (a < c)).any()} == {True}  # each case of clamp is there
    for name, row in zip(OPERATIONS, out[:, 3:-3], strict=True):
        if name in expected:
            assert (row == expected[name]).all(), name


def test_multiply_add_rounds_once(results):
    (a, b, c), _, out, _ = results
    exact = [
        Fraction(x) * Fraction(y) + Fraction(z)
        for x, y, z in zip(a.tolist(), b.tolist(), c.tolist(), strict=True)
    ]

    def error(found):
        """In units of the last place."""
        units = map(Fraction, np.spacing(np.abs(found)).tolist())
        return [abs(Fraction(f) - e) / u for f, e, u in zip(found.tolist(), exact, units, strict=True)]

    assert max(error(out[-1, 3:-3])) <= Fraction(1, 2)
    assert max(error(a * b + c)) > Fraction(1, 2)  # or nothing would be tested


def test_sum_of_lanes(results):
    (a, *_), _, _, total = results
    assert total == pytest.approx(
        float(np.sum(a.astype(np.float64))), abs=2e-6 if a.dtype == np.float32 else 1e-14
    )
    assert isinstance(total, float)


def test_store_writes_its_vector_and_nothing_else(results):
    *_, out, _ = results
    assert (out[:, :3] == 7).all()
    assert (out[:, -3:] == 7).all()


@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, LANES), (2, 5, 4), (0, 4)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
def test_aligned_zeros(shape, dtype):
    arrays = [aligned_zeros(shape, dtype) for _ in range(10)]
    for array in arrays:
        assert (array.shape, array.dtype) == (shape, dtype)
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert array.size == 0 or array.ctypes.data % 64 == 0
        assert (array == 0).all()
        array[...] = 1
    assert all((array == 1).all() for array in arrays)


def test_round_up():
    sizes = [0, 1, LANES - 1, LANES, LANES + 1, 60]
    assert [round_up(size) for size in sizes] == [0, LANES, LANES, LANES, 2 * LANES, 4 * LANES]
