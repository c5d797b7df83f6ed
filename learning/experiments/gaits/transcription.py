"""A stroke as a nonlinear program: direct collocation, solved by IPOPT.

A stroke of duration T is cut into N equal intervals, on each of which the torques are constant. On each, the
accelerations at the 3 Gauss-Legendre points are unknowns, and the state there and at the interval's end is their
integral (order 6)::

    maximise    the pull: a force per mass along -x, against which the swimmer swims
    over        the pull, T, z_k, u_k (k = 0 .. N - 1), accelerations
    subject to  the equations of motion at each point, |u_i| <= U_i,
                z_N = z_0, but for whole turns of the angles,
                the mean velocity of the centre of mass along x is what is asked for

The position of the centre of mass is none of the variables. Without a pull nothing would be left to find: a straight
chain glides at any speed.
"""

# pyright: reportMissingImports=false
# (CasADi is an extra.)
from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.learning.experiments.gaits.equations import residual
from swimmer_mj.learning.experiments.gaits.gait import Gait, pulled
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["PERIODS", "POINTS", "STAGES", "WEIGHTS", "Program", "Solution"]

Array = NDArray[np.float64]

PERIODS = (0.1, 8.0)
"""Of a stroke, s: the shortest and the longest."""

_root = np.sqrt(15.0)
POINTS = np.array([5 - _root, 5, 5 + _root]) / 10
"""Gauss-Legendre points on [0, 1]."""
WEIGHTS = np.array([5, 8, 5]) / 18
"""Of the quadrature over them."""
STAGES = np.array(
    [
        [5 / 36, 2 / 9 - _root / 15, 5 / 36 - _root / 30],
        [5 / 36 + _root / 24, 2 / 9, 5 / 36 - _root / 24],
        [5 / 36 + _root / 30, 2 / 9 + _root / 15, 5 / 36],
    ]
)
"""Butcher's matrix of the method: integrals from 0 to each point."""


@dataclass(frozen=True)
class Solution:
    """What IPOPT came to."""

    gait: Gait
    kkt_residual: float
    """The largest violation of any first-order condition: gradient of the Lagrangian, constraint, complementarity."""
    iterations: int
    seconds: float
    """Of processor time."""
    status: str


def _interval(parameters: SwimmerParameters) -> ca.Function:
    """(z, z at the end, accelerations, u, h, pull) -> (defects, mean velocity along x) of one interval."""
    n = parameters.n_links
    R = residual(parameters)
    z, end, u = ca.SX.sym("z", 2 * n + 2), ca.SX.sym("end", 2 * n + 2), ca.SX.sym("u", n - 1)
    h, pull = ca.SX.sym("h"), ca.SX.sym("pull")
    q = ca.SX.sym("q", n + 2, 3)  # theta'', G'' at the points
    angles, turning, rates = z[:n], z[n : 2 * n], z[n:]
    defects, speed = [], ca.SX(0)
    for i in range(3):
        rates_i = rates + h * q @ STAGES[i]
        angles_i = angles + POINTS[i] * h * turning + h**2 * (q[:n, :] @ (STAGES @ STAGES)[i])
        rate = ca.vertcat(rates_i[:n], q[:n, i], q[n, i] + pull, q[n + 1, i])
        defects.append(R(ca.vertcat(angles_i, rates_i), rate, u)[n:])
        speed += WEIGHTS[i] * rates_i[n]
    angles_end = angles + h * turning + h**2 * (q[:n, :] @ (WEIGHTS @ STAGES))
    defects.append(ca.vertcat(angles_end, rates + h * q @ WEIGHTS) - end)
    return ca.Function("interval", [z, end, ca.vec(q), u, h, pull], [ca.vertcat(*defects), speed])


class Program:
    """The nonlinear program of a swimmer's strokes of N intervals.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer; its torque limits are the bounds.
    n_intervals : int
        N.
    """

    def __init__(self, parameters: SwimmerParameters, n_intervals: int) -> None:
        self.parameters, self.n_intervals = parameters, n_intervals
        n, N = parameters.n_links, n_intervals
        sizes = 2 * n + 2, 3 * (n + 2), n - 1
        block = ca.MX.sym("block", sum(sizes), N)  # a column an interval
        duration, pull = ca.MX.sym("T"), ca.MX.sym("pull")
        turns, speed = ca.MX.sym("turns", n), ca.MX.sym("speed")
        z, q, u = ca.vertsplit(block, [0, *np.cumsum(sizes).tolist()])
        end = ca.horzcat(z[:, 1:], z[:, 0] + ca.vertcat(2 * np.pi * turns, ca.MX.zeros(n + 2)))
        each = (ca.repmat(value, 1, N) for value in (duration / N, pull))
        defects, speeds = _interval(parameters).map(N)(z, end, q, u, *each)
        self._problem = {
            "x": ca.vertcat(ca.vec(block), duration, pull),
            "p": ca.vertcat(turns, speed),
            "f": -pull,
            "g": ca.vertcat(ca.vec(defects), ca.sum2(speeds) / N - speed),
        }
        free = np.full((N, sum(sizes)), np.inf)
        free[:, -(n - 1) :] = parameters.torque_limits
        self._lower = np.append(-free.ravel(), [PERIODS[0], -np.inf])
        self._upper = np.append(free.ravel(), [PERIODS[1], np.inf])

    def solve(
        self, start: Gait, speed: float, *, tolerance: float = 1e-8, max_iterations: int = 400
    ) -> Solution:
        """The local optimum that IPOPT comes to from ``start``, a gait or anything like it.

        Parameters
        ----------
        start : Gait
            It need not obey the equations. Its turns are kept.
        speed : float
            Mean velocity of the centre of mass along x, m/s.
        tolerance : float
            Of IPOPT, unscaled.
        max_iterations : int
            It gives up then.
        """
        n, N, limits = self.parameters.n_links, self.n_intervals, self.parameters.torque_limits
        start = start.resampled(N)
        names = ("tol", "constr_viol_tol", "dual_inf_tol", "compl_inf_tol")
        ipopt = {
            **dict.fromkeys(names, tolerance),
            "max_iter": max_iterations,
            "mu_init": 1e-2,
            "nlp_scaling_method": "none",
            "bound_relax_factor": 0.0,  # the torques' limits are exact
            "acceptable_iter": 0,
            "print_level": 0,
            "sb": "yes",
        }
        options = {"ipopt": ipopt, "expand": True, "error_on_fail": False, "print_time": False}
        solver = ca.nlpsol("solver", "ipopt", self._problem, options)
        values = np.append(start.turns, speed)
        began = time.process_time()
        found = solver(x0=self._guess(start), p=values, lbx=self._lower, ubx=self._upper, lbg=0.0, ubg=0.0)
        seconds = time.process_time() - began
        x = np.asarray(found["x"]).ravel()
        block, (duration, pull) = x[:-2].reshape(N, -1), x[-2:].tolist()
        controls = np.clip(block[:, -(n - 1) :], -limits, limits)
        gait = Gait(self.parameters, duration, block[:, : 2 * n + 2], controls, start.turns, pull)
        stats = solver.stats()
        return Solution(
            gait,
            self._kkt_residual(found, values),
            int(stats["iter_count"]),
            seconds,
            str(stats["return_status"]),
        )

    def _guess(self, start: Gait) -> Array:
        """The unknowns of ``start``; accelerations are the equations' at states between its nodes."""
        n, N, p = self.parameters.n_links, self.n_intervals, self.parameters
        swimmer, nodes, back = AnalyticSwimmer(p), start.closed_states(), pulled(p, start.pull)
        q = np.empty((N, 3, n + 2))
        for i, share in enumerate(POINTS):
            x = st.expand(p, (1 - share) * nodes[:-1] + share * nodes[1:])
            q[:, i] = st.reduce_derivative(p, x, swimmer.derivative(x, start.controls) + back)[:, n:]
        blocks = np.concatenate([start.states, q.reshape(N, -1), start.controls], axis=1)
        return np.append(blocks.ravel(), [start.duration, start.pull])

    def _kkt_residual(self, found: dict[str, Any], values: Array) -> float:
        """From the solution and its multipliers, with exact derivatives; nothing is scaled."""
        x, f, g = (self._problem[name] for name in "xfg")
        multipliers = ca.MX.sym("multipliers", g.numel())
        slope = ca.gradient(f + ca.dot(multipliers, g), x)
        evaluate = ca.Function("conditions", [x, self._problem["p"], multipliers], [slope, g])
        gradient, defects = (np.asarray(one).ravel() for one in evaluate(found["x"], values, found["lam_g"]))
        at, bound = np.asarray(found["x"]).ravel(), np.asarray(found["lam_x"]).ravel()
        slack = np.where(
            bound > 0, self._upper - at, at - self._lower
        )  # of the bound that the multiplier is of
        complementarity = bound * np.where(np.isfinite(slack), slack, np.sign(bound) ** 2)
        outside = np.maximum(at - self._upper, self._lower - at).max()
        return float(
            max(np.abs(v).max() for v in (gradient + bound, defects, complementarity, max(outside, 0.0)))
        )
