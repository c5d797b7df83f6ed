"""Differential dynamic programming with limits on torques, in a receding horizon: planning by derivatives.

The backward pass is Tassa, Mansard and Todorov 2014, doi:10.1109/ICRA.2014.6907001: at each action, the quadratic model
of cost and cost to go is minimised in a box of torques. iLQR leaves the dynamics' second derivatives out. Here all
curvature but that of the effort is in them: the reward is the velocity, which is linear in the state. They come by
central differences of the transposed Jacobian. Tassa, Erez and Smart 2007 swam chains by DDP in a receding horizon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from peers.engine import SwimEngine
from swimmer_mj.learning.problems.swim import Swimming

Array = NDArray[np.float64]
STRIDES = (1.0, 0.5, 0.25, 0.1, 0.03)
"""Shares of the change of a plan that are tried."""
IN_BOX = 0.3 ** np.arange(8)
"""Shares of a Newton step within the box that are tried."""
CALMEST, WILDEST = 1e-5, 1e5
"""Range of the damping."""


@dataclass(frozen=True)
class DdpSettings:
    """Of the algorithm."""

    horizon: int = 40
    """Actions in a plan."""
    hold: int = 4
    """Steps of 0.01 s for which an action is held."""
    iterations: int = 1
    """Times that a plan is improved before its first action is done."""
    effort: float = 0.01
    """m/s: cost of torques at their limits; without it, iLQR has no curvature at all."""
    second_order: bool = True
    """With the second derivatives of the dynamics: DDP; without: iLQR."""
    noise: float = 0.05
    """Of the first plan, in units of the largest torque."""


class Expansion(NamedTuple):
    """A plan's cost and dynamics around it, at each of T actions, of N swimmers."""

    A: Array
    """dy/dx, (T, N, p, p)."""
    B: Array
    """dy/dw, (T, N, p, q)."""
    gradient: Array
    """Of the action's own cost by (x, w), (T, N, p + q)."""
    hessian: Array
    """Of it, and of the dynamics times the costate, (T, N, p + q, p + q)."""


class Ddp:
    """Plans of N swimmers, each for itself, in actions w = u / U."""

    def __init__(self, problem: Swimming, settings: DdpSettings, seed: int) -> None:
        self.settings, self.rng = settings, np.random.default_rng(seed)
        self.engine = SwimEngine(problem, hold=settings.hold)
        self.limits = problem.control_limits
        self.plans: Array | None = None
        """(T, q, N)."""

    def act(self, states: Array) -> Array:
        """Torques (N, q), N m, at states (N, p), which follow on those of the last call."""
        T, q, N = self.settings.horizon, self.engine.q, len(states)
        if self.plans is None:
            self.plans = np.clip(self.settings.noise * self.rng.standard_normal((T, q, N)), -1, 1)
            self.damping = np.full(N, 1e-3)
        for _ in range(self.settings.iterations):
            self.improve(states)
        first = self.plans[0].T * self.limits
        self.plans = np.concatenate([self.plans[1:], self.plans[-1:]])
        return first

    def improve(self, states: Array) -> Array:
        """Change the plans from states (N, p) so that none costs more; what they cost, (N,)."""
        assert self.plans is not None
        T, q, N = self.plans.shape
        x, cost = self.follow(states.T, self.plans)
        expansion = self.expand(x, self.plans)
        k, K = backward(expansion, self.plans, self.damping)
        S = len(STRIDES)
        strides = np.repeat(STRIDES, N)
        plans = np.tile(self.plans + 0.0, (1, 1, S))
        tried, costs = self.follow(
            np.tile(states.T, (1, S)),
            plans,
            (strides, np.tile(k, (1, S, 1)), np.tile(K, (1, S, 1, 1)), np.tile(x, (1, 1, S))),
        )
        del tried
        costs = costs.reshape(S, N)
        best = costs.argmin(axis=0)
        better = costs.min(axis=0) < cost
        chosen = plans.reshape(T, q, S, N)[:, :, best, np.arange(N)]
        self.plans = np.where(better, chosen, self.plans)
        self.damping = np.clip(np.where(better, self.damping / 3, self.damping * 3), CALMEST, WILDEST)
        return np.minimum(cost, costs.min(axis=0))

    def follow(
        self, x: Array, plans: Array, feedback: tuple[Array, Array, Array, Array] | None = None
    ) -> tuple[Array, Array]:
        """States (T + 1, p, M) from x (p, M) and costs (M,); ``plans`` become what is done under feedback."""
        T, _, M = plans.shape
        states, cost = np.empty((T + 1, *x.shape)), np.zeros(M)
        states[0] = x
        for t in range(T):
            if feedback is not None:
                strides, k, K, around = feedback
                change = strides[:, None] * k[t] + np.einsum("nqp,pn->nq", K[t], states[t] - around[t])
                plans[t] = np.clip(plans[t] + change.T, -1.0, 1.0)
            reached, velocity = self.engine.forward(states[t], plans[t] * self.limits[:, None])
            states[t + 1] = reached[-1]
            cost += (self.settings.effort * np.square(plans[t]).mean(axis=0) - velocity) / T
        return states, cost

    def expand(self, x: Array, plans: Array) -> Expansion:
        """Derivatives along states x (T + 1, p, N) under plans (T, q, N)."""
        (T, q, N), p = plans.shape, self.engine.p
        flat = x[:-1].transpose(1, 0, 2).reshape(p, -1)
        w = plans.transpose(1, 0, 2).reshape(q, -1)
        # the rows of the Jacobian, and the gradient of minus the velocity
        adjoints = np.zeros((p, p + 1, T * N))
        adjoints[np.arange(p), np.arange(p)] = 1.0
        last = np.zeros((p + 1, T * N))
        last[p] = -1.0 / T
        rows = self.gradient(
            np.tile(flat, (1, p + 1)), np.tile(w, (1, p + 1)), adjoints.reshape(p, -1), last.ravel()
        )
        rows = rows.reshape(p + q, p + 1, T, N).transpose(2, 3, 1, 0)
        A, B, gradient = rows[..., :p, :p], rows[..., :p, p:], rows[..., p, :].copy()
        effort = 2 * self.settings.effort / (q * T)
        gradient[..., p:] += effort * plans.transpose(0, 2, 1)
        hessian = np.zeros((T, N, p + q, p + q))
        if self.settings.second_order:
            costates = np.zeros((T, N, p))  # of the states after each action
            for t in range(T - 1, 0, -1):
                costates[t - 1] = gradient[t, :, :p] + np.einsum("nij,ni->nj", A[t], costates[t])
            hessian = self.curvature(flat, w, costates.transpose(2, 0, 1).reshape(p, -1), T)
        hessian[..., range(p, p + q), range(p, p + q)] += effort
        return Expansion(A, B, gradient, convex(hessian))

    def curvature(self, x: Array, w: Array, costates: Array, T: int, h: float = 1e-4) -> Array:
        """Second derivatives by (x, w) of an action's costs and of costates times where it leads."""
        p, M = x.shape
        d = p + len(w)
        z = (
            np.concatenate([x, w])[:, None, None, :]
            + h * np.array([1.0, -1.0])[:, None] * np.eye(d)[:, :, None, None]
        )
        z = z.reshape(d, -1)  # (d, varied, sign, M)
        found = self.gradient(z[:p], z[p:], np.tile(costates, (1, 2 * d)), np.full(2 * d * M, -1.0 / T))
        found = found.reshape(d, d, 2, T, M // T)
        hessian = ((found[:, :, 0] - found[:, :, 1]) / (2 * h)).transpose(2, 3, 0, 1)
        return 0.5 * (hessian + hessian.swapaxes(-1, -2))

    def gradient(self, x: Array, w: Array, d_y: Array, d_velocity: Array) -> Array:
        """Of d_y times where w leads from x, and of d_velocity times the velocity: by (x, w), (p + q, M)."""
        u = w * self.limits[:, None]
        states, _ = self.engine.forward(x, u)
        d_x, d_u = self.engine.backward(states, u, d_y, d_velocity)
        return np.concatenate([d_x, d_u * self.limits[:, None]])


def backward(expansion: Expansion, plans: Array, damping: Array) -> tuple[Array, Array]:
    """Changes k (T, N, q) of the plans, and feedback K (T, N, q, p), for the least cost in the box."""
    T, N, p, q = expansion.B.shape
    k, K = np.empty((T, N, q)), np.empty((T, N, q, p))
    v, V = np.zeros((N, p)), np.zeros((N, p, p))
    for t in range(T - 1, -1, -1):
        A, B = expansion.A[t], expansion.B[t]
        AB = np.concatenate([A, B], axis=2)
        g = expansion.gradient[t] + np.einsum("nij,ni->nj", AB, v)
        H = expansion.hessian[t] + AB.swapaxes(1, 2) @ V @ AB
        g_x, g_u, H_xx, H_ux, H_uu = g[:, :p], g[:, p:], H[:, :p, :p], H[:, p:, :p], H[:, p:, p:]
        steep = H_uu + damping[:, None, None] * np.eye(q)
        w = plans[t].T
        k[t], free = least_in_box(steep, g_u, -1.0 - w, 1.0 - w)
        K[t] = -np.linalg.solve(of_free(steep, free), H_ux * free[..., None])
        v = (
            g_x
            + np.einsum("nqp,nq->np", K[t], g_u + np.einsum("nij,nj->ni", H_uu, k[t]))
            + np.einsum("nqp,nq->np", H_ux, k[t])
        )
        cross = K[t].swapaxes(1, 2) @ H_ux
        V = H_xx + K[t].swapaxes(1, 2) @ H_uu @ K[t] + cross + cross.swapaxes(1, 2)
        V = 0.5 * (V + V.swapaxes(1, 2))
    return k, K


def convex(H: Array) -> Array:
    """Symmetric H (..., d, d) without its negative eigenvalues."""
    values, vectors = np.linalg.eigh(H)
    return (vectors * np.maximum(values, 0.0)[..., None, :]) @ vectors.swapaxes(-1, -2)


def of_free(H: Array, free: Array) -> Array:
    """H (N, q, q) with the rows and columns of what is not free those of the identity."""
    both = free[:, :, None] & free[:, None, :]
    return np.where(both, H, np.eye(H.shape[1]))


def least_in_box(H: Array, g: Array, low: Array, high: Array, iterations: int = 10) -> tuple[Array, Array]:
    """The d (N, q) that minimises g d + d H d / 2 between low and high, and which of it are free (N, q).

    Projected Newton: Tassa et al. 2014, section III-B, of N problems at once; where all of its steps are worse, which
    the bounds may make them, a step against the slope, which never is.
    """
    d = np.clip(np.zeros_like(g), low, high)
    free = np.ones_like(g, dtype=bool)

    def cost(d: Array) -> Array:
        return np.einsum("ni,ni->n", g, d) + 0.5 * np.einsum("ni,nij,nj->n", d, H, d)

    for _ in range(iterations):
        slope = g + np.einsum("nij,nj->ni", H, d)
        free = ~(((d <= low) & (slope > 0)) | ((d >= high) & (slope < 0)))
        step = -np.linalg.solve(of_free(H, free), (slope * free)[..., None])[..., 0]
        steps = [*(IN_BOX[:, None, None] * step), -slope / np.trace(H, axis1=1, axis2=2)[:, None]]
        tried = np.clip(d + np.array(steps), low, high)
        costs = np.array([cost(there) for there in tried])
        best = costs.argmin(axis=0)
        d = np.where((costs.min(axis=0) < cost(d))[:, None], tried[best, np.arange(len(d))], d)
    return d, free
