"""Equation 2 for a linear value function, compiled: see :mod:`~swimmer_mj.learning.td.linear`.

``form`` is what :func:`form_of` makes of a problem and of features. All are entry points for Python but the first
function.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.static import Static
from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.td.features import OPTIONS, CompiledFeatures
from swimmer_mj.learning.td.greedy import decide, hold_for_a_step

__all__ = ["add", "form_of", "rollout", "sample", "slope", "train", "value"]

Array = NDArray[np.float64]


def form_of(problem: CompiledForm, features: CompiledFeatures, by_difference: bool) -> Static:
    """What the kernel is compiled for; ``by_difference``: H has (V(x(t + dt)) - V(x(t))) / dt for dV/dx . f."""
    return Static(
        dynamics=problem.dynamics,
        reward=problem.reward,
        value=features.value,
        slope=features.slope,
        add=features.add,
        by_difference=by_difference,
        n_hit=features.n_hit,
        hit=features.hit,
    )


@njit(**OPTIONS)
def _judge(
    form: Any,
    constants: Any,
    features: Any,
    limits: Array,
    w: Array,
    scratch: Array,
    x: Array,
    dt: float,
    s_gamma: float,
    f: Array,
) -> tuple[float, float, float]:
    """V, H and r at x; fills f = a + B u under greedy control."""
    p = x.size
    a, B, dVdx, u = np.empty(p), np.zeros((p, limits.size)), np.empty(p), np.empty(limits.size)
    form.dynamics(constants, x, a, B)
    r = form.reward(constants, x)
    V = form.value(features, x, w, scratch)
    form.slope(features, x, w, dVdx, scratch)
    V_dot = decide(limits, dVdx, a, B, u, f)
    if form.by_difference:
        V_dot = (form.value(features, x + dt * f, w, scratch) - V) / dt
    return V, r - s_gamma * V + V_dot, r


@entry_point(**OPTIONS)
def train(
    form: Any,
    constants: Any,
    features: Any,
    limits: Array,
    initial_states: Array,
    n_steps: int,
    dt: float,
    s_gamma: float,
    s_lambda: float,
    eta: float,
    w: Array,
    e: Array,
    scratch: Array,
    statistics: Array,
) -> None:
    """One trial from each initial state; ``statistics`` (trials, 3) gets the means of V, H^2 and r.

    In each step w += dt eta H e, e += dt (-(s_gamma + s_lambda) e + phi(x)), x += dt f. Where few features are not 0,
    only those are touched that were hit in the trial.
    """
    f = np.empty(initial_states.shape[1])
    decay = 1.0 - dt * (s_gamma + s_lambda)
    which, known = np.empty(form.n_hit, np.int64), np.zeros(w.size if form.n_hit > 0 else 0, np.bool_)
    traced, n_traced = np.empty(min(n_steps * form.n_hit, w.size), np.int64), 0
    e[:] = 0.0
    for trial in range(initial_states.shape[0]):
        if form.n_hit > 0:
            for j in range(n_traced):
                e[traced[j]], known[traced[j]] = 0.0, False
            n_traced = 0
        else:
            e[:] = 0.0
        x = initial_states[trial].copy()
        statistics[trial] = 0.0
        for _ in range(n_steps):
            V, H, r = _judge(form, constants, features, limits, w, scratch, x, dt, s_gamma, f)
            gain = dt * eta * H
            if form.n_hit > 0:
                for j in range(n_traced):
                    w[traced[j]] += gain * e[traced[j]]
                    e[traced[j]] *= decay
                form.hit(features, x, which)
                for k in which:
                    if not known[k]:
                        traced[n_traced], known[k] = k, True
                        n_traced += 1
                    e[k] += dt / form.n_hit
            else:
                for k in range(w.size):
                    w[k] += gain * e[k]
                    e[k] *= decay
                form.add(features, x, dt, e, scratch)
            for i in range(x.size):
                x[i] += dt * f[i]
            statistics[trial, 0] += V / n_steps
            statistics[trial, 1] += H * H / n_steps
            statistics[trial, 2] += r / n_steps


@entry_point(**OPTIONS)
def sample(
    form: Any,
    constants: Any,
    features: Any,
    limits: Array,
    states: Array,
    dt: float,
    s_gamma: float,
    w: Array,
    scratch: Array,
    out: Array,
) -> None:
    """V and H at each of ``states``, into ``out`` (states, 2)."""
    f = np.empty(states.shape[1])
    for k in range(states.shape[0]):
        V, H, _ = _judge(form, constants, features, limits, w, scratch, states[k], dt, s_gamma, f)
        out[k, 0], out[k, 1] = V, H


@entry_point(**OPTIONS)
def rollout(
    form: Any,
    constants: Any,
    features: Any,
    limits: Array,
    initial_states: Array,
    n_steps: int,
    n_skip: int,
    dt: float,
    s_gamma: float,
    w: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Greedy episodes, control held over each step; means of r and returns into ``out`` (episodes, 2)."""
    p, q = initial_states.shape[1], limits.size
    a, B, dVdx, f, u = np.empty(p), np.zeros((p, q)), np.empty(p), np.empty(p), np.empty(q)
    for episode in range(initial_states.shape[0]):
        x = initial_states[episode].copy()
        gain = discounted = 0.0
        for t in range(n_steps):
            form.slope(features, x, w, dVdx, scratch)
            mean, share = hold_for_a_step(form, constants, limits, dVdx, x, a, B, u, f, t * dt, dt, s_gamma)
            if t >= n_skip:
                gain += mean
            discounted += share
        out[episode, 0] = gain / (n_steps - n_skip)
        out[episode, 1] = discounted


@entry_point(**OPTIONS)
def value(form: Any, features: Any, x: Array, w: Array, scratch: Array) -> float:
    """V at x."""
    return form.value(features, x, w, scratch)


@entry_point(**OPTIONS)
def slope(form: Any, features: Any, x: Array, w: Array, dVdx: Array, scratch: Array) -> None:
    """Fill the slope of V at x."""
    form.slope(features, x, w, dVdx, scratch)


@entry_point(**OPTIONS)
def add(form: Any, features: Any, x: Array, gain: float, e: Array, scratch: Array) -> None:
    """e += gain phi(x)."""
    form.add(features, x, gain, e, scratch)
