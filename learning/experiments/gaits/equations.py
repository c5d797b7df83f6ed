"""The swimmer's equations of motion as CasADi expressions: appendix A.3, as :mod:`swimmer_mj.analytic` corrects it.

They stay as the paper states them, an implicit equation 0 = R(z, dz/dt, u): collocation asks for no more, and nothing
is inverted. In the reduced state of :mod:`swimmer_mj.state`, z = (theta, theta', G'), rows are::

    0 = theta' - dtheta/dt                                                              n, rad/s
    0 = f_n                           with f_i = f_{i-1} - F_i + m_i G''_i, f_0 = 0     2, N
    0 = det(G_i A_i, f_i + f_{i-1}) + M_i - m_i l_i^2 / 12 theta''_i - u_i + u_{i-1}    n, N·m
"""

# pyright: reportMissingImports=false
# (CasADi is an extra.)
from __future__ import annotations

import casadi as ca

from swimmer_mj import state as st
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["residual"]


def _det(a: ca.SX, b: ca.SX) -> ca.SX:
    """det(a, b) = a_x b_y - a_y b_x."""
    return a[0] * b[1] - a[1] * b[0]


def residual(parameters: SwimmerParameters) -> ca.Function:
    """R(z, dz/dt, u), shape (2n + 2,), affine in dz/dt (2n + 2,) and in u (n - 1,)."""
    p = parameters
    n, k = p.n_links, p.viscous_friction
    m, l, levers = p.masses.tolist(), p.lengths.tolist(), st.center_of_mass_levers(p).tolist()
    z, dz, u = ca.SX.sym("z", 2 * n + 2), ca.SX.sym("dz", 2 * n + 2), ca.SX.sym("u", n - 1)
    theta, theta_dot, theta_ddot = z[:n], z[n : 2 * n], dz[n : 2 * n]
    t = [ca.vertcat(ca.cos(theta[i]), ca.sin(theta[i])) for i in range(n)]
    normal = [ca.vertcat(-ca.sin(theta[i]), ca.cos(theta[i])) for i in range(n)]

    def turning(i: int) -> ca.SX:
        """The second derivative of t_i."""
        return theta_ddot[i] * normal[i] - theta_dot[i] ** 2 * t[i]

    A_dot, A_ddot = z[2 * n :], dz[2 * n :]  # of G; A0 = G - sum_j a_j t_j
    for j in range(n):
        A_dot -= levers[j] * theta_dot[j] * normal[j]
        A_ddot -= levers[j] * turning(j)

    f_before: ca.SX = ca.SX.zeros(2)
    moments = []
    for i in range(n):
        half_link_dot, half_link_ddot = l[i] / 2 * theta_dot[i] * normal[i], l[i] / 2 * turning(i)
        G_dot, G_ddot = A_dot + half_link_dot, A_ddot + half_link_ddot
        A_dot, A_ddot = G_dot + half_link_dot, G_ddot + half_link_ddot
        F = -k * l[i] * ca.dot(G_dot, normal[i]) * normal[i]
        M = -k * theta_dot[i] * l[i] ** 3 / 12
        f = f_before - F + m[i] * G_ddot
        torque = (u[i - 1] if i > 0 else 0) - (u[i] if i < n - 1 else 0)
        inertia = m[i] * l[i] ** 2 / 12 * theta_ddot[i]
        moments.append(_det(l[i] / 2 * t[i], f + f_before) + M - inertia + torque)
        f_before = f
    rows = ca.vertcat(theta_dot - dz[:n], f_before, *moments)
    return ca.Function("residual", [z, dz, u], [rows], ["z", "dz", "u"], ["R"])
