"""Feedforward networks on many inputs at once, compiled: V, dV/dz, and the weight gradient of a loss in both.

For a loss L(V, dV/dz) let c = dL/dV and v = dL/d(dV/dz). The weight gradient of L is that of the scalar
c V + v . dV/dz with c and v held, and v . dV/dz is the derivative of V along v. So four sweeps through the network do,
none of which keeps a graph (reverse over forward; Pearlmutter 1994, doi:10.1162/neco.1994.6.1.147):

    forward     a_i = sum_k w_ik y_k,               y_i = tanh(a_i)
    backward    delta_i = dV/da_i
    tangent     a'_i = sum_k w_ik y'_k,             y'_i = (1 - y_i^2) a'_i       along v
    backward    beta_i = d(c V + V')/da_i           = (1 - y_i^2) sum_j w_ji beta_j - 2 y_i a'_i delta_i

    dL/dw_ik = sum over samples of  beta_i y_k + delta_i y'_k

The cascade and layers are one thing here: each neuron hears an unbroken range of sources (:class:`Wiring`). Samples
are on the last axis and are worked on in blocks of :data:`BLOCK`; four neurons share each number that is loaded.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit, types
from numba.extending import overload
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.elementary import cos_sin_of_lanes, tanh_of_many
from swimmer_mj.compiled.vectors import (
    FAST,
    LANES,
    OPTIONS,
    add_lanes,
    aligned_zeros,
    convert,
    load,
    splat,
    spread,
    store,
)
from swimmer_mj.learning.networks.networks import Cascade, Multilayer, ValueNetwork
from swimmer_mj.learning.problems.forms import Encoding

__all__ = ["BLOCK", "BatchedNetwork"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Real = NDArray[Any]  # the network's dtype

BLOCK = 2 * LANES
"""Samples that are worked on together."""


class Wiring(NamedTuple):
    """Who hears whom. Sources are the m inputs, 1 (bias), then the neurons in order; the last neuron is the output."""

    first: Indices
    """First source of each neuron, (n,)."""
    last: Indices
    """One past its last."""
    base: Indices
    """The weight from source k is number base + k of the flat weights."""
    bias: Indices
    """Number of a bias weight besides, or -1."""
    group: Indices
    """Where groups of up to four neurons start that hear the same sources but for each other; n at the end."""


def wiring(network: ValueNetwork) -> Wiring:
    """Where the weights of ``network`` stand in its flattened parameters."""
    m = network.n_inputs
    if isinstance(network, Cascade):
        i = np.arange(network.n_neurons)
        group = np.append(i[::4], network.n_neurons)
        if group[-2] != network.n_neurons - 1:  # the output stands alone
            group = np.insert(group, -1, network.n_neurons - 1)
        return Wiring(0 * i, m + 1 + i, i * (m + network.n_neurons), 0 * i - 1, group)
    assert isinstance(network, Multilayer)
    rows: list[tuple[int, int, int, int]] = []
    group = []
    heard, offset = (0, m), 0
    for layer in network.layers:
        assert isinstance(layer, torch.nn.Linear)
        width, fan_in = layer.out_features, layer.in_features
        group += list(range(len(rows), len(rows) + width, 4))
        start = len(rows)
        for i in range(width):
            rows.append((heard[0], heard[1], offset + i * fan_in - heard[0], offset + width * fan_in + i))
        heard = (m + 1 + start, m + 1 + start + width)
        offset += width * (fan_in + 1)
    first, last, base, bias = np.array(rows, dtype=np.int64).T.copy()
    return Wiring(first, last, base, bias, np.array([*group, len(rows)], dtype=np.int64))


class Workspace(NamedTuple):
    """Block by block: rows of BLOCK numbers."""

    y: Real  # sources (m + 1 + n)
    y_dot: Real  # their tangents
    a: Real  # activations (n)
    a_dot: Real  # their tangents
    d: Real  # adjoints of sources (m + 1 + n)
    delta: Real  # (n)
    beta: Real  # (n)
    slope: Real  # dV/dx (p)


def _tanh(a: Real, i: int, y: Real, k: int) -> None:
    """Row ``k`` of y becomes tanh of row ``i`` of a."""
    raise NotImplementedError("for compiled code")


@overload(_tanh, jit_options={"fastmath": FAST})
def _tanh_of_dtype(a: Any, i: Any, y: Any, k: Any) -> Any:
    def single(a: Any, i: Any, y: Any, k: Any) -> Any:
        for o in range(0, BLOCK, LANES):
            store(y, k * BLOCK + o, tanh_of_many(load(a, i * BLOCK + o)))

    def double(a: Any, i: Any, y: Any, k: Any) -> Any:
        for o in range(BLOCK):
            y[k, o] = math.tanh(a[i, o])

    return single if a.dtype == types.float32 else double


@njit(**OPTIONS)
def _encode(code: Encoding, x: Array, start: int, z: Real) -> None:
    """The inputs z (m, BLOCK) of columns start .. start + BLOCK of x (p, N)."""
    N = x.shape[1]
    real = z[0, 0]
    for o in range(0, BLOCK, LANES):
        for i in range(code.angle.size):
            c, s = cos_sin_of_lanes(load(x, code.angle[i] * N + start + o))
            store(z, code.cosine[i] * BLOCK + o, convert(c, real))
            store(z, code.sine[i] * BLOCK + o, convert(s, real))
        for i in range(code.linear.size):
            scaled = code.scale[i] * load(x, code.linear[i] * N + start + o)
            store(z, code.scaled[i] * BLOCK + o, convert(scaled, real))


@njit(**OPTIONS)
def _pull_back(code: Encoding, z: Real, dVdz: Real, dVdx: Real) -> None:
    """DVdx = (dz/dx)^T dVdz."""
    for o in range(0, BLOCK, LANES):
        for i in range(code.angle.size):
            at_cosine, at_sine = code.cosine[i] * BLOCK + o, code.sine[i] * BLOCK + o
            turn = load(z, at_cosine) * load(dVdz, at_sine) - load(z, at_sine) * load(dVdz, at_cosine)
            store(dVdx, code.angle[i] * BLOCK + o, turn)
        for i in range(code.linear.size):
            scale = z.dtype.type(code.scale[i])
            store(dVdx, code.linear[i] * BLOCK + o, scale * load(dVdz, code.scaled[i] * BLOCK + o))


@njit(**OPTIONS)
def _push_forward(code: Encoding, z: Real, v: Real, vz: Real) -> None:
    """Vz = dz/dx v."""
    for o in range(0, BLOCK, LANES):
        for i in range(code.angle.size):
            at_cosine, at_sine = code.cosine[i] * BLOCK + o, code.sine[i] * BLOCK + o
            v_i = load(v, code.angle[i] * BLOCK + o)
            store(vz, at_cosine, -(load(z, at_sine) * v_i))
            store(vz, at_sine, load(z, at_cosine) * v_i)
        for i in range(code.linear.size):
            scale = z.dtype.type(code.scale[i])
            store(vz, code.scaled[i] * BLOCK + o, scale * load(v, code.linear[i] * BLOCK + o))


@njit(**OPTIONS)
def _weighted_sums(w: Real, wires: Wiring, g: int, y: Real, with_bias: bool, a: Real) -> None:
    """a_i = bias + sum_k w_ik y_k of group ``g``, as far as its neurons do not hear each other."""
    i, end = wires.group[g], wires.group[g + 1]
    first, last = wires.first[i], wires.last[i]
    if end - i == 4:
        b0, b1, b2, b3 = wires.base[i], wires.base[i + 1], wires.base[i + 2], wires.base[i + 3]
        p0 = p1 = p2 = p3 = q0 = q1 = q2 = q3 = splat(w.dtype.type(0))
        for k in range(first, last):
            u, v = load(y, k * BLOCK), load(y, k * BLOCK + LANES)
            p0 = p0 + spread(w, b0 + k) * u
            q0 = q0 + spread(w, b0 + k) * v
            p1 = p1 + spread(w, b1 + k) * u
            q1 = q1 + spread(w, b1 + k) * v
            p2 = p2 + spread(w, b2 + k) * u
            q2 = q2 + spread(w, b2 + k) * v
            p3 = p3 + spread(w, b3 + k) * u
            q3 = q3 + spread(w, b3 + k) * v
        store(a, i * BLOCK, p0)
        store(a, i * BLOCK + LANES, q0)
        store(a, (i + 1) * BLOCK, p1)
        store(a, (i + 1) * BLOCK + LANES, q1)
        store(a, (i + 2) * BLOCK, p2)
        store(a, (i + 2) * BLOCK + LANES, q2)
        store(a, (i + 3) * BLOCK, p3)
        store(a, (i + 3) * BLOCK + LANES, q3)
    else:
        for j in range(i, end):
            p0 = q0 = splat(w.dtype.type(0))
            for k in range(first, last):
                p0 = p0 + spread(w, wires.base[j] + k) * load(y, k * BLOCK)
                q0 = q0 + spread(w, wires.base[j] + k) * load(y, k * BLOCK + LANES)
            store(a, j * BLOCK, p0)
            store(a, j * BLOCK + LANES, q0)
    if with_bias:
        for j in range(i, end):
            if wires.bias[j] >= 0:
                for o in range(j * BLOCK, (j + 1) * BLOCK, LANES):
                    store(a, o, load(a, o) + spread(w, wires.bias[j]))


@njit(**OPTIONS)
def _hear_within(w: Real, wires: Wiring, i: int, start: Any, y: Real, a: Real) -> None:
    """Add to a_i what neuron i hears of its own group, the sources from ``start`` on."""
    for k in range(start, wires.last[i]):
        for o in range(0, BLOCK, LANES):
            store(
                a,
                i * BLOCK + o,
                load(a, i * BLOCK + o) + spread(w, wires.base[i] + k) * load(y, k * BLOCK + o),
            )


@njit(**OPTIONS)
def _forward(m: int, w: Real, wires: Wiring, ws: Workspace) -> None:
    n = wires.first.size
    for g in range(wires.group.size - 1):
        _weighted_sums(w, wires, g, ws.y, True, ws.a)
        i = wires.group[g]
        common = wires.last[i]
        for j in range(i, wires.group[g + 1]):
            _hear_within(w, wires, j, common, ws.y, ws.a)
            if j < n - 1:
                _tanh(ws.a, j, ws.y, m + 1 + j)


@njit(**OPTIONS)
def _tangent(m: int, w: Real, wires: Wiring, ws: Workspace) -> None:
    n = wires.first.size
    for g in range(wires.group.size - 1):
        _weighted_sums(w, wires, g, ws.y_dot, False, ws.a_dot)
        i = wires.group[g]
        common = wires.last[i]
        for j in range(i, wires.group[g + 1]):
            _hear_within(w, wires, j, common, ws.y_dot, ws.a_dot)
            if j < n - 1:
                for o in range(0, BLOCK, LANES):
                    y = load(ws.y, (m + 1 + j) * BLOCK + o)
                    store(
                        ws.y_dot,
                        (m + 1 + j) * BLOCK + o,
                        (w.dtype.type(1) - y * y) * load(ws.a_dot, j * BLOCK + o),
                    )


@njit(**OPTIONS)
def _backward(m: int, w: Real, wires: Wiring, ws: Workspace, delta: Real, second: bool) -> None:
    """Adjoints of activations, given that of the output; the second time, without those of the inputs."""
    n = wires.first.size
    lowest = m + 1 if second else 0
    for k in range(lowest, m + n):
        for o in range(0, BLOCK, LANES):
            store(ws.d, k * BLOCK + o, splat(w.dtype.type(0)))
    for g in range(wires.group.size - 2, -1, -1):
        i, end = wires.group[g], wires.group[g + 1]
        first, last = max(wires.first[i], lowest), wires.last[i]
        for j in range(end - 1, i - 1, -1):
            for o in range(0, BLOCK, LANES):
                if j < n - 1:
                    y = load(ws.y, (m + 1 + j) * BLOCK + o)
                    delta_j = (w.dtype.type(1) - y * y) * load(ws.d, (m + 1 + j) * BLOCK + o)
                    if second:
                        bend = load(ws.a_dot, j * BLOCK + o) * load(ws.delta, j * BLOCK + o)
                        delta_j = delta_j - w.dtype.type(2) * (y * bend)
                    store(delta, j * BLOCK + o, delta_j)
                delta_j = load(delta, j * BLOCK + o)
                for k in range(last, wires.last[j]):
                    store(
                        ws.d,
                        k * BLOCK + o,
                        load(ws.d, k * BLOCK + o) + spread(w, wires.base[j] + k) * delta_j,
                    )
        if end - i == 4:
            b0, b1, b2, b3 = wires.base[i], wires.base[i + 1], wires.base[i + 2], wires.base[i + 3]
            p0, q0 = load(delta, i * BLOCK), load(delta, i * BLOCK + LANES)
            p1, q1 = load(delta, (i + 1) * BLOCK), load(delta, (i + 1) * BLOCK + LANES)
            p2, q2 = load(delta, (i + 2) * BLOCK), load(delta, (i + 2) * BLOCK + LANES)
            p3, q3 = load(delta, (i + 3) * BLOCK), load(delta, (i + 3) * BLOCK + LANES)
            for k in range(first, last):
                u, v = load(ws.d, k * BLOCK), load(ws.d, k * BLOCK + LANES)
                u = u + spread(w, b0 + k) * p0
                v = v + spread(w, b0 + k) * q0
                u = u + spread(w, b1 + k) * p1
                v = v + spread(w, b1 + k) * q1
                u = u + spread(w, b2 + k) * p2
                v = v + spread(w, b2 + k) * q2
                u = u + spread(w, b3 + k) * p3
                v = v + spread(w, b3 + k) * q3
                store(ws.d, k * BLOCK, u)
                store(ws.d, k * BLOCK + LANES, v)
        else:
            for j in range(i, end):
                for k in range(first, last):
                    for o in range(0, BLOCK, LANES):
                        d = load(ws.d, k * BLOCK + o)
                        store(
                            ws.d, k * BLOCK + o, d + spread(w, wires.base[j] + k) * load(delta, j * BLOCK + o)
                        )


@njit(**OPTIONS)
def _value_and_slope(m: int, w: Real, wires: Wiring, code: Encoding, ws: Workspace) -> None:
    """From the inputs in ws.y: activations, delta, dV/dz in the first m rows of ws.d, dV/dx in ws.slope."""
    n = wires.first.size
    for b in range(BLOCK):
        ws.y[m, b] = 1
        ws.delta[n - 1, b] = 1
    _forward(m, w, wires, ws)
    _backward(m, w, wires, ws, ws.delta, False)
    _pull_back(code, ws.y, ws.d, ws.slope)


@entry_point(**OPTIONS)
def _judge(
    w: Real, wires: Wiring, code: Encoding, x: Array, ws: Workspace, z: Real, V: Array, dVdx: Array
) -> None:
    """Fill z (m, N), V (N,) and dVdx (p, N) at x (p, N)."""
    n, m = wires.first.size, z.shape[0]
    p, N = x.shape
    for start in range(0, N, BLOCK):
        _encode(code, x, start, ws.y)
        _value_and_slope(m, w, wires, code, ws)
        for o in range(0, BLOCK, LANES):
            for i in range(m):
                store(z, i * N + start + o, load(ws.y, i * BLOCK + o))
            for i in range(p):
                store(dVdx, i * N + start + o, convert(load(ws.slope, i * BLOCK + o), 0.0))
            store(V, start + o, convert(load(ws.a, (n - 1) * BLOCK + o), 0.0))


@entry_point(**OPTIONS)
def _loss_rows(
    w: Real,
    wires: Wiring,
    code: Encoding,
    data: Real,
    start: int,
    M: int,
    value_weight: float,
    slope_weights: Real,
    ws: Workspace,
    P: Real,
    Q: Real,
) -> tuple[float, float]:
    """The factors of dL/dw = P Q^T, L being the mean of value_weight (V - G)^2 + sum_i s_i (dV/dx_i - g_i)^2.

    ``data`` (m + p + 1, N) has z, g and G; the M samples start at column ``start``. The first 2M columns of P
    (n, ...) get beta and delta, those of Q (m + n, ...) get y and y'. Returns the two means.
    """
    n = wires.first.size
    row, N, p = P.shape[1], data.shape[1], slope_weights.size
    m = data.shape[0] - p - 1
    sum_V = sum_slope = splat(w.dtype.type(0))
    scale = w.dtype.type(2.0 / M)
    for block in range(0, M, BLOCK):
        at = start + block
        for i in range(m):
            for o in range(0, BLOCK, LANES):
                store(ws.y, i * BLOCK + o, load(data, i * N + at + o))
        _value_and_slope(m, w, wires, code, ws)
        for o in range(0, BLOCK, LANES):
            for i in range(p):
                error = load(ws.slope, i * BLOCK + o) - load(data, (m + i) * N + at + o)
                weighted = slope_weights[i] * error
                sum_slope = sum_slope + weighted * error
                store(ws.slope, i * BLOCK + o, scale * weighted)
            error = load(ws.a, (n - 1) * BLOCK + o) - load(data, (m + p) * N + at + o)
            sum_V = sum_V + error * error
            store(ws.beta, (n - 1) * BLOCK + o, (scale * w.dtype.type(value_weight)) * error)
            store(ws.y_dot, m * BLOCK + o, splat(w.dtype.type(0)))
        _push_forward(code, ws.y, ws.slope, ws.y_dot)
        _tangent(m, w, wires, ws)
        _backward(m, w, wires, ws, ws.beta, True)
        for o in range(0, BLOCK, LANES):
            for i in range(n):
                store(P, i * row + block + o, load(ws.beta, i * BLOCK + o))
                store(P, i * row + M + block + o, load(ws.delta, i * BLOCK + o))
            for k in range(m + n):
                store(Q, k * row + block + o, load(ws.y, k * BLOCK + o))
                store(Q, k * row + M + block + o, load(ws.y_dot, k * BLOCK + o))
    return float(add_lanes(sum_V)) / M, float(add_lanes(sum_slope)) / M


class BatchedNetwork:
    """Compiled evaluation and differentiation of a network at given flat weights.

    Parameters
    ----------
    network : Cascade or Multilayer
        Its shape and dtype; its weights are not touched.
    encoding : Encoding
        The problem's inputs.
    state_size : int
        p.
    """

    @staticmethod
    def check(network: ValueNetwork) -> None:
        """Raise TypeError if ``network`` cannot be compiled."""
        known = (Cascade.forward, Multilayer.forward)  # not one of a subclass's own
        if not isinstance(network, Cascade | Multilayer) or type(network).forward not in known:
            raise TypeError(f"knows Cascade and Multilayer networks, not {type(network).__name__}")
        if isinstance(network, Cascade) and network.sigmoid != "tanh":
            raise TypeError(f"knows neurons with sigmoid 'tanh', not {network.sigmoid!r}")
        dtype = next(network.parameters()).dtype
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(f"needs float32 or float64 weights, not {dtype}")

    def __init__(self, network: ValueNetwork, encoding: Encoding, state_size: int) -> None:
        self.check(network)
        self.wiring = wiring(network)
        parameters = list(network.parameters())
        self.shapes = [w.shape for w in parameters]
        self.n_inputs, self.state_size = m, p = network.n_inputs, state_size
        n = len(self.wiring.first)
        dtype = parameters[0].dtype
        self.dtype = dtype
        real: Any = np.float32 if dtype == torch.float32 else np.float64
        rows = (m + 1 + n, m + 1 + n, n, n, m + 1 + n, n, n, p)
        self._ws = Workspace(*(aligned_zeros((k, BLOCK), real) for k in rows))
        self._encoding = encoding
        self._cascade = network if isinstance(network, Cascade) else None
        self._real = real
        self._P, self._Q = torch.zeros(0), torch.zeros(0)

    def judge(self, weights: Tensor, x: Array, z: Real, V: Array, dVdx: Array) -> None:
        """Fill inputs z (m, N), V (N,) and dVdx (p, N) at x (p, N); N must be a multiple of BLOCK."""
        _judge(weights.numpy(), self.wiring, self._encoding, x, self._ws, z, V, dVdx)

    def loss_gradient(
        self,
        weights: Tensor,
        data: Real,
        start: int,
        count: int,
        value_weight: float,
        slope_weights: Real,
        out: Tensor,
    ) -> tuple[float, float]:
        """dL/dw into ``out``, flat, of L = mean of value_weight (V - G)^2 + sum_i slope_weights_i (dV/dx_i - g_i)^2.

        ``data`` (m + p + 1, N) has z, g, G; the mean is over ``count`` columns, a multiple of BLOCK, from ``start`` on.
        Returns the means of (V - G)^2 and of the sum.
        """
        n = len(self.wiring.first)
        m = self.n_inputs
        if self._P.shape[1:] != (2 * count + LANES,):
            # Rows that are a power of two apart would all fall into the same few cache lines.
            self._P = torch.from_numpy(aligned_zeros((n, 2 * count + LANES), self._real))
            self._Q = torch.from_numpy(aligned_zeros((m + n, 2 * count + LANES), self._real))
        losses = _loss_rows(
            weights.numpy(),
            self.wiring,
            self._encoding,
            data,
            start,
            count,
            value_weight,
            slope_weights,
            self._ws,
            self._P.numpy(),
            self._Q.numpy(),
        )
        P, Q = self._P[:, : 2 * count], self._Q[:, : 2 * count]
        if self._cascade is not None:
            gradient = out.view(self.shapes[0])
            torch.mm(P, Q.T, out=gradient)
            gradient *= self._cascade.connected
            return losses
        at, neuron, heard = 0, 0, (0, m)
        for shape in self.shapes[::2]:
            width, fan_in = shape
            rows = P[neuron : neuron + width]
            torch.mm(rows, Q[heard[0] : heard[1]].T, out=out[at : at + width * fan_in].view(shape))
            at += width * fan_in
            torch.sum(rows[:, :count], 1, out=out[at : at + width])
            at += width
            heard = (m + 1 + neuron, m + 1 + neuron + width)
            neuron += width
        return losses
