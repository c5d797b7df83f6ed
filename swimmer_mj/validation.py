"""Is the physics right? What can be said about a swimmer without knowing how it moves, and what can be known.

The motion has three statements: the linear system of A.3 (:mod:`swimmer_mj.analytic`), MuJoCo with the friction as
a passive force (:mod:`swimmer_mj.viscous`), MuJoCo with the friction as actuators (:mod:`swimmer_mj.mjcf`). No two
share a line about friction; the last two share MuJoCo's rigid bodies. Beside them stands an arbiter
(:mod:`swimmer_mj.arbiter`). Each check here measures one error and holds it against a tolerance that says where it
comes from.

Rounding is bounded as in any text on numerical linear algebra: N equations with a matrix of condition number c,
solved stably in arithmetic of precision eps, give a relative error of at most about N eps c.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.arbiter import LagrangianSwimmer, Motion
from swimmer_mj.dynamics import MujocoSwimmer, from_qpos_qvel, to_qpos_qvel
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.mjcf import Friction, Integrator, mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = [
    "ARBITER",
    "STATEMENTS",
    "Check",
    "Curve",
    "Section",
    "accelerations",
    "callback_self_test",
    "closed_forms",
    "disagreement",
    "full_report",
    "invariants",
    "limits",
    "measure_motion",
    "other_models",
    "physics_report",
    "random_parameters",
    "random_states",
    "relative_error",
    "statements",
    "symmetries",
    "symmetry_errors",
    "trajectories",
]

Array = NDArray[np.float64]

STATEMENTS = ("A.3", "MuJoCo + callback", "MuJoCo + actuators")
ARBITER = "Lagrange"

_EPS = float(np.finfo(np.float64).eps)
_DURATION = 5.0  # s, a trial of the paper
_MAX_EVALUATIONS = 20_000  # of a swimmer's derivative for one reference; some 5,000 are usual


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Check:
    """One comparison, of two statements of the physics or of one with what must hold."""

    name: str
    """What is compared."""
    error: float
    """What was measured."""
    tolerance: float
    """The largest error that passes."""
    reason: str
    """Where the tolerance comes from."""
    worst: str = ""
    """Where among the cases of this check the error was measured."""

    @property
    def passed(self) -> bool:
        """Whether the error is within tolerance, and both are finite."""
        return bool(self.error <= self.tolerance < math.inf) and math.isfinite(self.error)

    def to_json(self) -> dict[str, Any]:
        """All of it; an error or tolerance that is no finite number is None."""
        numbers = {"error": _or_none(self.error), "tolerance": _or_none(self.tolerance)}
        return {**asdict(self), **numbers, "passed": self.passed}


@dataclass(frozen=True)
class Curve:
    """Numbers to draw."""

    label: str
    x: list[float]
    y: list[float]
    guide: bool = False
    """Whether it is there to compare the others with."""

    def to_json(self) -> dict[str, Any]:
        """All of it; what is no finite number is None."""
        return {**asdict(self), "x": [_or_none(v) for v in self.x], "y": [_or_none(v) for v in self.y]}


@dataclass(frozen=True)
class Section:
    """Checks that belong together, and what to draw beside them."""

    title: str
    checks: list[Check]
    axes: tuple[str, str] = ("", "")
    """Labels of the plot's axes; both are logarithmic where ``loglog``, else the vertical one."""
    curves: list[Curve] = field(default_factory=list)
    loglog: bool = False

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)


@dataclass
class _Worst:
    """The case of a check with the largest error; or of those that fail, the one that exceeds most."""

    name: str
    reason: str
    case: Check | None = None
    _rank: tuple[float, float] = (0.0, 0.0)

    def add(self, error: float, tolerance: float, where: str) -> None:
        new = Check(self.name, float(error), float(tolerance), self.reason, where)
        if np.isfinite(new.error):
            excess = new.error / new.tolerance if new.tolerance > 0 else float(new.error > 0) * np.inf
            rank = (0.0 if new.passed else float(excess), new.error)
        else:
            rank = (np.inf, np.inf)
        if self.case is None or rank > self._rank:
            self.case, self._rank = new, rank

    def check(self) -> Check:
        if self.case is None:
            raise ValueError(f"nothing was measured for the check {self.name!r}")
        return self.case


# What to compare, and where -------------------------------------------------------------------------------------


def statements(parameters: SwimmerParameters) -> dict[str, Any]:
    """The three statements of a swimmer's dynamics and their arbiter, by name."""
    return {
        "A.3": AnalyticSwimmer(parameters),
        "MuJoCo + callback": MujocoSwimmer(parameters, "callback"),
        "MuJoCo + actuators": MujocoSwimmer(parameters, "actuators"),
        ARBITER: LagrangianSwimmer(parameters),
    }


def relative_error(actual: Array, expected: Array, n_axes: int = 1) -> Array:
    """|actual - expected| / |expected| in the Euclidean norm over the last ``n_axes`` axes."""
    axes = tuple(range(-n_axes, 0))
    difference = np.sqrt(((actual - expected) ** 2).sum(axis=axes))
    return difference / np.sqrt((expected**2).sum(axis=axes))


def random_parameters(
    rng: np.random.Generator, n_links: int, viscous_friction: float | None = None
) -> SwimmerParameters:
    """Draw a swimmer: m_i, l_i in [0.5, 2], k in [0, 20] unless given, U_i in [1, 10], SI units."""
    return SwimmerParameters(
        n_links=n_links,
        mass=rng.uniform(0.5, 2, n_links).tolist(),
        length=rng.uniform(0.5, 2, n_links).tolist(),
        viscous_friction=rng.uniform(0, 20) if viscous_friction is None else viscous_friction,
        torque_limit=rng.uniform(1, 10, n_links - 1).tolist(),
    )


def random_states(rng: np.random.Generator, n_links: int, size: int) -> Array:
    """Full states with angles in [-pi, pi], everything else in [-3, 3] SI units; shape (size, 2n + 4)."""
    x = rng.uniform(-3, 3, (size, st.full_size(n_links)))
    st.split(x, n_links).angles[:] = rng.uniform(-np.pi, np.pi, (size, n_links))
    return x


def _random_torques(rng: np.random.Generator, parameters: SwimmerParameters, size: int) -> Array:
    """Torques within their limits, shape (size, n - 1)."""
    return rng.uniform(-1, 1, (size, parameters.n_links - 1)) * parameters.torque_limits


def _in_force(friction: Friction) -> AbstractContextManager[None]:
    return viscous_friction() if friction == "callback" else nullcontext()


def _mj_states(
    parameters: SwimmerParameters,
    friction: Friction,
    integrator: Integrator,
    x: Array,
    controls: Iterable[Array],
    steps: int,
    dt: float,
) -> Array:
    """States after each of ``controls`` (torques, N·m, held for ``steps`` steps), by ``mj_step``."""
    n = parameters.n_links
    model = mujoco.MjModel.from_xml_string(
        mjcf(parameters, friction=friction, integrator=integrator, timestep=dt)
    )
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = to_qpos_qvel(x, n)
    states = []
    with _in_force(friction):
        for u in controls:
            data.ctrl[: n - 1] = u / parameters.torque_limits
            mujoco.mj_step(model, data, steps)
            states.append(from_qpos_qvel(data.qpos, data.qvel))
    return np.array(states)


def _states(
    step: Callable[[Callable[[Array], Array], Array, float], Array],
    swimmer: Any,
    x: Array,
    controls: Iterable[Array],
    steps: int,
    dt: float,
) -> Array:
    """The same by ``step`` from the integrators here, for any statement."""
    states = []
    for u in controls:
        for _ in range(steps):
            x = step(lambda y, u=u: swimmer.derivative(y, u), x, dt)
        states.append(x)
    return np.array(states)


def _semi_implicit_euler_step(f: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """x(t + dt) with the new velocities in the positions: what MuJoCo calls Euler."""
    half = len(x) // 2
    velocities = x[half:] + dt * f(x)[half:]
    return np.concatenate([x[:half] + dt * velocities, velocities])


def _reference(swimmer: Any, x: Array, controls: Iterable[Array], duration: float) -> Array:
    """States after each of ``controls``, held for ``duration``, by DOP853 at a relative tolerance of 1e-12.

    They are NaN from where the motion overflows, or takes so many evaluations that something must be wrong.
    """
    evaluations = itertools.count()
    states = []
    for u in controls:

        def f(_: float, y: Array, u: Array = u) -> Array:
            if next(evaluations) > _MAX_EVALUATIONS or not np.isfinite(y).all():
                raise FloatingPointError
            return swimmer.derivative(y, u)

        lost = np.full_like(x, np.nan)
        try:
            if np.isfinite(x).all():
                solution = solve_ivp(f, (0, duration), x, method="DOP853", rtol=1e-12, atol=1e-13)
                x = solution.y[:, -1] if solution.success else lost
        except FloatingPointError:
            x = lost
        states.append(x)
    return np.array(states)


def _order(errors: Sequence[float], ratio: float) -> float:
    """The order by which the last of ``errors`` is smaller than the one before, in steps of ``ratio``."""
    coarse, fine = np.array(errors[-2:])
    return float(np.log(coarse / fine) / np.log(ratio))


# 1. Accelerations and control matrices --------------------------------------------------------------------------


def _scales(arbiter: LagrangianSwimmer, x: Array, u: Array) -> tuple[Array, Array]:
    """|f(x, u)|, or 1 where it is 0, and N eps c (1 + size / |f|): what rounding may do to f, in that unit."""
    f = np.linalg.norm(arbiter.derivative(x, u), axis=-1)
    f[f == 0] = 1.0
    condition, size = arbiter.conditioning(x, u)
    return f, (arbiter.parameters.n_links + 2) * _EPS * condition * (1 + size / f)


def disagreement(
    parameters: SwimmerParameters, x: Array, u: Array
) -> tuple[dict[tuple[str, str], Array], dict[tuple[str, str], Array], Array]:
    """How far the statements and the arbiter are apart at the states x (b, 2n + 4) and torques u (b, n - 1).

    Returns
    -------
    derivatives, control_matrices : dict
        Relative errors of f(x, u) and of B(x) for each pair, shape (b,); no control matrices with one link.
    tolerance : ndarray, shape (b,)
        2 N eps c (1 + size / |f|) with N = n + 2: two solutions, each off by what rounding does to them.
    """
    swimmers = statements(parameters)
    scale, rounding = _scales(swimmers[ARBITER], x, u)
    found = {name: (s.derivative(x, u), s.control_matrix(x)) for name, s in swimmers.items()}
    derivatives, matrices = {}, {}
    for one, other in itertools.combinations(found, 2):
        derivatives[one, other] = np.linalg.norm(found[one][0] - found[other][0], axis=-1) / scale
        if parameters.n_links > 1:
            matrices[one, other] = relative_error(found[one][1], found[other][1], n_axes=2)
    return derivatives, matrices, 2 * rounding


def accelerations(
    rng: np.random.Generator, links: Iterable[int] = range(1, 11), n_swimmers: int = 2, n_states: int = 10
) -> Section:
    """Compare the statements and the arbiter pair by pair: f(x, u) and df/du, for unequal links."""
    reason = (
        "2 N eps c (1 + s): two stable solutions of N = n + 2 equations of condition c, s for what cancels"
    )
    pairs = list(itertools.combinations([*STATEMENTS, ARBITER], 2))
    by_kind = [
        {pair: _Worst(f"{kind}: {pair[0]} and {pair[1]}", reason) for pair in pairs}
        for kind in ("accelerations", "control matrices")
    ]
    links = list(links)
    curves = {pair: Curve(" and ".join(pair), [], []) for pair in pairs}
    bound = Curve("tolerance", [], [], guide=True)
    for n in links:
        largest, largest_tolerance = dict.fromkeys(pairs, 0.0), 0.0
        for _ in range(n_swimmers):
            parameters = random_parameters(rng, n)
            x, u = random_states(rng, n, n_states), _random_torques(rng, parameters, n_states)
            *errors, tolerance = disagreement(parameters, x, u)
            for worst, found in zip(by_kind, errors, strict=True):
                for pair, error in found.items():
                    for e, t in zip(error, tolerance, strict=True):
                        worst[pair].add(e, t, f"{n} links")
            for pair, error in errors[0].items():
                largest[pair] = max(largest[pair], float(error.max()))
            largest_tolerance = max(largest_tolerance, float(tolerance.max()))
        for pair, curve in curves.items():
            curve.x.append(n)
            curve.y.append(largest[pair])
        bound.x.append(n)
        bound.y.append(largest_tolerance)
    checks = [w.check() for worst in by_kind for w in worst.values() if w.case is not None]
    return Section(
        "Accelerations and control matrices, pair by pair",
        checks,
        ("number of links", "largest relative error of f(x, u)"),
        [*curves.values(), bound],
    )


# 2. Trajectories ------------------------------------------------------------------------------------------------


_ORDERS = {"Euler": 1, "semi-implicit Euler": 1, "RK4": 4}
_STEP_SIZES = (0.02, 0.01, 0.005, 0.0025, 0.00125)  # s


def _step_sizes(name: str, integrator: str) -> tuple[float, ...]:
    """As many as take a second or two."""
    if integrator == "RK4":
        return _STEP_SIZES[:3] if name == "A.3" else _STEP_SIZES
    return _STEP_SIZES[:4]


def _final_states(name: str, swimmer: Any, integrator: str, x: Array, controls: Array, dt: float) -> Array:
    """States at the ends of the control intervals by one statement's own implementation of an integrator."""
    steps = round(_DURATION / len(controls) / dt)
    if name == "A.3" or integrator == "Euler":
        step = {"Euler": euler_step, "semi-implicit Euler": _semi_implicit_euler_step, "RK4": rk4_step}
        return _states(step[integrator], swimmer, x, controls, steps, dt)
    native: Integrator = "Euler" if integrator == "semi-implicit Euler" else "RK4"
    return _mj_states(swimmer.parameters, swimmer.friction, native, x, controls, steps, dt)


def trajectories(rng: np.random.Generator, parameters: SwimmerParameters = PAPER) -> Section:
    """Compare 5 s under the same controls with a tight solution of the arbiter's equations, for each integrator."""
    swimmers = statements(parameters)
    x = st.expand(parameters, rng.uniform(-1, 1, st.reduced_size(parameters.n_links)))
    controls = _random_torques(rng, parameters, 25)  # each held for 0.2 s
    interval = _DURATION / len(controls)
    reference = _reference(swimmers[ARBITER], x, controls, interval)
    size = np.linalg.norm(reference, axis=-1).max()
    checks, curves = [], []
    for name in STATEMENTS:
        tight = _reference(swimmers[name], x, controls, interval)
        checks.append(
            Check(
                f"5 s by DOP853: {name} and {ARBITER}",
                float(np.linalg.norm(tight - reference, axis=-1).max() / size),
                1e-9,
                "1e-12 a step, some 300 steps, grown at most threefold by the motion",
            )
        )
    for integrator, order in _ORDERS.items():
        for name in STATEMENTS:
            errors, step_sizes = [], _step_sizes(name, integrator)
            for dt in step_sizes:
                found = _final_states(name, swimmers[name], integrator, x, controls, dt)
                errors.append(float(np.linalg.norm(found - reference, axis=-1).max() / size))
            curves.append(Curve(f"{integrator}: {name}", list(step_sizes), errors))
            # of MuJoCo's RK4, finer steps meet the reference's own error
            measured = _order(errors[:3] if integrator == "RK4" else errors, 2)
            checks.append(
                Check(
                    f"order of {integrator}: {name}, distance from {order}",
                    abs(measured - order),
                    0.25,
                    "half the distance at which it could be taken for a neighbouring integer",
                    f"order {measured:.2f}",
                )
            )
            if integrator == "RK4":
                checks.append(
                    Check(
                        f"time step to 0: {name} by RK4 at {step_sizes[-1]} s",
                        errors[-1],
                        2 * errors[0] / 16 ** (len(errors) - 1) + 1e-9,
                        "twice what the fourth order leaves of the error at 0.02 s, and the reference's own",
                    )
                )
    for order, start in ((1, curves[0].y[0]), (4, curves[-1].y[0])):
        slope = [1.5 * start * (dt / _STEP_SIZES[0]) ** order for dt in _STEP_SIZES]
        curves.append(Curve(f"slope {order}", list(_STEP_SIZES), slope, guide=True))
    return Section(
        "Trajectories of 5 s and the orders of the integrators",
        checks,
        ("time step, s", "largest relative error of the state"),
        curves,
        loglog=True,
    )


# 3. Invariants --------------------------------------------------------------------------------------------------


def measure_motion(parameters: SwimmerParameters, x: Array, u: Array) -> tuple[dict[str, Motion], Array]:
    """Energy, momenta, powers and their rates along f(x, u), as the arbiter measures them, for each statement.

    Returns
    -------
    motions : dict
        By statement, the arbiter among them.
    tolerance : ndarray, shape (b,)
        N eps c for the rates, in units of their sizes.
    """
    swimmers = statements(parameters)
    arbiter: LagrangianSwimmer = swimmers[ARBITER]
    condition, size = arbiter.conditioning(x, u)
    motions = {name: arbiter.motion(x, s.derivative(x, u), u, size) for name, s in swimmers.items()}
    return motions, (parameters.n_links + 2) * _EPS * condition


def _vacuum_swim(name: str, swimmer: Any, x: Array, u: Array) -> Array:
    """States at 0 and 5 s, shape (2, 2n + 4)."""
    return np.concatenate([x[None], _reference(swimmer, x, [u], _DURATION)])


def invariants(rng: np.random.Generator, links: Iterable[int] = (1, 2, 3, 5), n_states: int = 20) -> Section:
    """Check what the friction, the torques and their absence may do to energy and momentum."""
    reason = "N eps c of the sum of the absolute values of its terms: the accelerations' rounding"
    names = {
        "still momentum": "no friction, no torques: rate of the momentum",
        "still angular": "no friction, no torques: rate of the angular momentum",
        "still energy": "no friction, no torques: rate of the energy",
        "driven momentum": "no friction, any torques: rate of the momentum",
        "driven angular": "no friction, any torques: rate of the angular momentum",
        "balance": "power balance: energy rate less powers of torques and friction",
        "loss": "friction, no torques: rise of the energy",
    }
    worst = {key: _Worst(name, reason) for key, name in names.items()}

    def note(key: str, value: Array, size: Array, tolerance: Array, where: str) -> None:
        for v, s, t in zip(value, size, tolerance, strict=True):
            worst[key].add(v / s if s > 0 else abs(v), t, where)

    for n in links:
        x = random_states(rng, n, n_states)
        for kind, k in (("vacuum", 0.0), ("fluid", None)):
            parameters = random_parameters(rng, n, k)
            for driven in (False, True):
                u = _random_torques(rng, parameters, n_states) * driven
                motions, tolerance = measure_motion(parameters, x, u)
                for name, m in motions.items():
                    where = f"{name}, {n} links"
                    if kind == "vacuum":
                        key = "driven" if driven else "still"
                        rate = np.abs(m.momentum_rate).max(-1)
                        note(f"{key} momentum", rate, m.momentum_rate_size, tolerance, where)
                        rate = np.abs(m.angular_momentum_rate)
                        note(f"{key} angular", rate, m.angular_momentum_rate_size, tolerance, where)
                        if not driven:
                            note("still energy", np.abs(m.energy_rate), m.energy_rate_size, tolerance, where)
                    elif driven:
                        balance = np.abs(m.energy_rate - m.friction_power - m.torque_power)
                        size = m.energy_rate_size - m.friction_power + np.abs(m.torque_power)
                        note("balance", balance, size, tolerance, where)
                    else:
                        note("loss", m.energy_rate, m.energy_rate_size, tolerance, where)
    checks = [w.check() for w in worst.values()]
    checks += _vacuum_checks(rng)
    section_checks, curves = _driven_power(rng)
    return Section(
        "Energy and momentum",
        [*checks, *section_checks],
        ("time, s", "power, W"),
        curves,
    )


def _vacuum_checks(rng: np.random.Generator) -> list[Check]:
    """Check 5 s without friction, and 5 s of friction without torques."""
    n = 3
    reason = "1e-12 a step of DOP853, some 500 steps"
    free = random_parameters(rng, n, 0.0)
    x = random_states(rng, n, 1)[0] / 3
    kept = {
        key: _Worst(f"5 s without friction{and_more}: change of the {what}", reason)
        for key, and_more, what in (
            ("E", " and torques", "energy"),
            ("P", " and torques", "momentum"),
            ("L", " and torques", "angular momentum"),
            ("driven P", ", torques on", "momentum"),
            ("driven L", ", torques on", "angular momentum"),
        )
    }
    arbiter = LagrangianSwimmer(free)
    u = _random_torques(rng, free, 1)[0] / 5
    for name, swimmer in statements(free).items():
        if name == ARBITER:  # the judge here
            continue
        for torques, prefix in ((0 * u, ""), (u, "driven ")):
            states = _vacuum_swim(name, swimmer, x, torques)
            m = arbiter.motion(states, np.zeros_like(states), np.tile(torques, (2, 1)))
            scale = np.sqrt(2 * m.energy.max() * free.masses.sum())  # of a momentum: sqrt(2 E M)
            reach = free.lengths.sum()
            if not prefix:
                kept["E"].add(abs(np.diff(m.energy)[0]) / m.energy.max(), 5e-10, name)
            kept[prefix + "P"].add(np.abs(np.diff(m.momentum, axis=0)).max() / scale, 5e-10, name)
            kept[prefix + "L"].add(abs(np.diff(m.angular_momentum)[0]) / (scale * reach), 5e-10, name)

    fluid = random_parameters(rng, n)
    arbiter = LagrangianSwimmer(fluid)
    rises = _Worst(
        "5 s of friction without torques: largest rise of the energy in a step of 0.01 s",
        "rounding of the energy, 2 N eps of what it was at the start",
    )
    still = np.zeros((500, n - 1))
    for name, swimmer in statements(fluid).items():
        if name == ARBITER:
            continue
        if name == "A.3":
            states = _states(rk4_step, swimmer, x, still, 1, 0.01)
        else:
            states = _mj_states(fluid, swimmer.friction, "RK4", x, still, 1, 0.01)
        states = np.concatenate([x[None], states])
        energy = arbiter.motion(states, np.zeros_like(states), np.zeros((len(states), n - 1))).energy
        rises.add(max(0.0, float(np.diff(energy).max() / energy[0])), 2 * (n + 2) * _EPS, name)
    return [*(w.check() for w in kept.values()), rises.check()]


def _driven_power(rng: np.random.Generator) -> tuple[list[Check], list[Curve]]:
    """Check the power balance along 5 s of the paper's swimmer, driven by a travelling wave, on MuJoCo."""
    n = PAPER.n_links
    times = np.arange(500) * 0.01
    phases = 2 * np.pi * (times[:, None] - np.arange(n - 1) / 4)
    controls = np.sin(phases) * PAPER.torque_limits
    x = st.expand(PAPER, rng.uniform(-0.5, 0.5, st.reduced_size(n)))
    states = _mj_states(PAPER, "callback", "RK4", x, controls, 1, 0.01)
    x, u = states[:-1], controls[1:]
    motions, tolerance = measure_motion(PAPER, x, u)
    worst = _Worst(
        "power balance along 5 s of swimming", "N eps c of the sum of the absolute values of its terms"
    )
    for name, m in motions.items():
        balance = np.abs(m.energy_rate - m.friction_power - m.torque_power)
        size = m.energy_rate_size - m.friction_power + np.abs(m.torque_power)
        for b, s, t in zip(balance, size, tolerance, strict=True):
            worst.add(b / s, t, name)
    m = motions["MuJoCo + callback"]
    curves = [
        Curve(label, times[1:].tolist(), values.tolist())
        for label, values in (
            ("dE/dt", m.energy_rate),
            ("torques", m.torque_power),
            ("friction", m.friction_power),
            ("dE/dt - torques - friction", m.energy_rate - m.torque_power - m.friction_power),
        )
    ]
    return [worst.check()], curves


# 4. Symmetries --------------------------------------------------------------------------------------------------


def _turn(x: Array, n: int, angle: float) -> Array:
    """A state, or its derivative (angle rates do not turn), turned by ``angle`` about the origin."""
    s = st.split(x, n)
    return st.join(st.rotate(s.position, angle), s.angles, st.rotate(s.velocity, angle), s.angular_velocities)


def _from_the_other_end(parameters: SwimmerParameters, x: Array, dx: Array) -> tuple[Array, Array]:
    """The state and its derivative with the links counted from A_n."""
    s, rate = st.split(x, parameters.n_links), st.split(dx, parameters.n_links)
    l = parameters.lengths[:, None]
    t, normal = st.link_directions(s.angles), st.link_normals(s.angles)
    w, dw = s.angular_velocities[..., None], rate.angular_velocities[..., None]
    end = s.position + (l * t).sum(-2)
    end_velocity = s.velocity + (l * w * normal).sum(-2)
    end_acceleration = rate.velocity + (l * dw * normal - l * w**2 * t).sum(-2)
    state = st.join(end, s.angles[..., ::-1] + np.pi, end_velocity, s.angular_velocities[..., ::-1])
    return state, st.join(
        end_velocity, rate.angles[..., ::-1], end_acceleration, rate.angular_velocities[..., ::-1]
    )


def symmetry_errors(
    parameters: SwimmerParameters, x: Array, u: Array, shift: Array, angle: float
) -> tuple[dict[str, dict[str, Array]], Array]:
    """f of the moved swimmer against f moved, by symmetry and statement, relative; and the tolerance, shape (b,).

    Symmetries: translation by ``shift`` (2,), rotation by ``angle``, reflection in the x axis, and counting
    the links from the other end. The tolerance is that of :func:`disagreement`, where the swimmer is farthest.
    """
    n = parameters.n_links
    swimmers = statements(parameters)
    moved = x.copy()
    st.split(moved, n).position[:] += shift
    turned = _turn(x, n, angle)
    st.split(turned, n).angles[:] += angle
    mirror = st.join([1, -1], np.full(n, -1), [1, -1], np.full(n, -1))
    backward = SwimmerParameters(
        n,
        parameters.mass[::-1],  # pyright: ignore[reportIndexIssue]
        parameters.length[::-1],  # pyright: ignore[reportIndexIssue]
        parameters.viscous_friction,
        parameters.torque_limit[::-1],  # pyright: ignore[reportIndexIssue]
    )
    scale, rounding = _scales(swimmers[ARBITER], x, u)
    _, moved_rounding = _scales(swimmers[ARBITER], moved, u)
    errors: dict[str, dict[str, Array]] = {}
    for name, swimmer in swimmers.items():
        f = swimmer.derivative(x, u)
        end, end_f = _from_the_other_end(parameters, x, f)
        for symmetry, found, expected in (
            ("translation", swimmer.derivative(moved, u), f),
            ("rotation", swimmer.derivative(turned, u), _turn(f, n, angle)),
            ("reflection", swimmer.derivative(mirror * x, -u), mirror * f),
            ("counting from the other end", statements(backward)[name].derivative(end, -u[:, ::-1]), end_f),
        ):
            errors.setdefault(symmetry, {})[name] = np.linalg.norm(found - expected, axis=-1) / scale
    return errors, 2 * np.maximum(rounding, moved_rounding)


def symmetries(rng: np.random.Generator, links: Iterable[int] = (1, 2, 3, 5), n_states: int = 10) -> Section:
    """Check that a moved, turned, mirrored swimmer, or one described from its other end, moves as it did."""
    worst: dict[str, _Worst] = {}
    for n in links:
        parameters = random_parameters(rng, n)
        x, u = random_states(rng, n, n_states), _random_torques(rng, parameters, n_states)
        errors, tolerance = symmetry_errors(parameters, x, u, rng.uniform(-5, 5, 2), rng.uniform(-3, 3))
        for symmetry, by_name in errors.items():
            check = worst.setdefault(
                symmetry, _Worst(symmetry, "2 N eps c (1 + s): two solutions of the equations of motion")
            )
            for name, error in by_name.items():
                for e, t in zip(error, tolerance, strict=True):
                    check.add(e, t, f"{name}, {n} links")
    return Section("Symmetries", [w.check() for w in worst.values()])


# 5. Closed forms ------------------------------------------------------------------------------------------------


_ROD = SwimmerParameters(n_links=1, mass=2.0, length=0.5, viscous_friction=10.0)
_ROD_STEP = 0.005  # s


def _rod_states(name: str, x: Array, duration: float) -> Array:
    """States of :data:`_ROD` every 0.01 s by RK4."""
    controls = np.zeros((round(duration / 0.01), 0))
    steps = round(0.01 / _ROD_STEP)
    if name in ("MuJoCo + callback", "MuJoCo + actuators"):
        friction: Friction = "callback" if name == "MuJoCo + callback" else "actuators"
        return _mj_states(_ROD, friction, "RK4", x, controls, steps, _ROD_STEP)
    swimmer = AnalyticSwimmer(_ROD) if name == "A.3" else LagrangianSwimmer(_ROD)
    return _states(rk4_step, swimmer, x, controls, steps, _ROD_STEP)


def closed_forms(names: Sequence[str] = (*STATEMENTS, ARBITER), duration: float = 0.5) -> Section:
    """Check single rods against exp(-k l t / m)."""
    k, l, m = _ROD.viscous_friction, _ROD.lengths[0], _ROD.masses[0]
    rate = k * l / m
    z = -rate * _ROD_STEP
    of_a_step = (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) / np.exp(z) - 1  # of RK4 on v' = -rate v
    tolerance = duration / _ROD_STEP * (1.001 * abs(of_a_step) + 4 * _EPS)
    reason = "that of 1 + z + z²/2 + z³/6 + z⁴/24 for exp(z), z = -rate dt, and 4 eps, in each step of RK4"
    checks, curves = [], []
    slope = 0.3  # rad; no special direction
    along, across = np.array([np.cos(slope), np.sin(slope)]), np.array([-np.sin(slope), np.cos(slope)])
    sideways = _Worst("a rod drifting sideways: exp(-k l t / m)", reason)
    glide = _Worst("a rod gliding along itself: constant", "4 eps a step")
    spin = _Worst("a rod spinning: exp(-k l t / m)", reason)
    times = 0.01 * np.arange(1, round(duration / 0.01) + 1)
    decay = np.exp(-rate * times)
    for name in names:
        velocity = st.split(_rod_states(name, st.join([0, 0], [slope], across, [0]), duration), 1).velocity
        sideways.add(np.abs(velocity @ across / decay - 1).max(), tolerance, name)
        curves.append(Curve(name, times.tolist(), (velocity @ across).tolist()))
        velocity = st.split(_rod_states(name, st.join([0, 0], [slope], along, [0]), duration), 1).velocity
        glide.add(np.abs(velocity @ along - 1).max(), duration / _ROD_STEP * 4 * _EPS, name)
        start = st.join(-l / 2 * along, [slope], -l / 2 * across, [1.0])  # about its middle
        angular = st.split(_rod_states(name, start, duration), 1).angular_velocities[:, 0]
        spin.add(np.abs(angular / decay - 1).max(), tolerance, name)
    checks = [sideways.check(), glide.check(), spin.check()]
    curves.append(Curve("exp(-k l t / m)", times.tolist(), decay.tolist(), guide=True))
    return Section("Closed forms: one rod", checks, ("time, s", "velocity sideways, m/s"), curves)


# 6. Limits ------------------------------------------------------------------------------------------------------


def limits(rng: np.random.Generator) -> Section:
    """Check the ways to k = 0 and to an infinitely heavy link; that to a time step of 0 is in the trajectories."""
    checks, curves = [], []
    n, frictions = 3, (1e-2, 1e-3, 1e-4)
    p = random_parameters(rng, n)
    x = random_states(rng, n, 1)[0] / 2
    u = _random_torques(rng, p, 1)
    by_friction: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    for name, errors in by_friction.items():
        ends = []
        for k in (0.0, *frictions):
            swimmer = SwimmerParameters(n, p.mass, p.length, k, p.torque_limit)
            if name == "A.3":
                ends.append(_states(rk4_step, AnalyticSwimmer(swimmer), x, u, 100, 0.01)[-1])
            else:
                friction: Friction = "callback" if name == "MuJoCo + callback" else "actuators"
                ends.append(_mj_states(swimmer, friction, "RK4", x, u, 100, 0.01)[-1])
        errors += [float(np.linalg.norm(end - ends[0])) for end in ends[1:]]
        order = _order(errors, 10)
        checks.append(
            Check(
                f"k to 0: {name}, difference from a vacuum after 1 s, distance of its order from 1",
                abs(order - 1),
                0.05,
                "the next term is k times as large, 1e-3, with a factor of 10 s of a second for time",
                f"order {order:.4f}",
            )
        )
        curves.append(Curve(f"k: {name}", list(frictions), errors))

    # A light link on one too heavy to move turns about the joint: m l^2 / 3 w' = u - k l^3 / 3 w
    masses = (1e2, 1e3, 1e4, 1e5)  # kg
    l, m, k, w, torque = 0.8, 0.5, 4.0, 1.5, 0.7
    pinned = (torque - k * l**3 / 3 * w) / (m * l**2 / 3)
    state = st.join([0, 0], [0.4, 1.3], [0, 0], [0.0, w])
    names = [*STATEMENTS, ARBITER]
    by_mass: dict[str, list[float]] = {name: [] for name in names}
    for heavy in masses:
        swimmers = statements(SwimmerParameters(2, [heavy, m], [1.2, l], k, 1.0))
        for name in names:
            found = swimmers[name].derivative(state, np.array([torque]))[-1]
            by_mass[name].append(abs(float(found) - pinned) / abs(pinned))
    for name, errors in by_mass.items():
        order = _order(errors, 10)
        checks.append(
            Check(
                f"one heavy link: {name}, distance from the light one pinned, of its order from 1",
                abs(order - 1),
                0.01,
                "the next term is m / M times as large, 5e-5; rounding 1e-10 beside 1e-5",
                f"order {order:.5f}",
            )
        )
        curves.append(Curve(f"1 / M: {name}", [1 / mass for mass in masses], errors))
    return Section(
        "Limits",
        checks,
        ("k, N·s/m², or 1 / M, 1/kg", "distance from the limit"),
        curves,
        loglog=True,
    )


# 7. Other models ------------------------------------------------------------------------------------------------


_FOREIGN_MODEL = """
<mujoco model="pendulum in MuJoCo's own fluid">
  <option density="1000" viscosity="0.1"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.1" stiffness="0.3"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      <body name="lower" pos="0.5 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def other_models() -> Section:
    """Check that another model of the process moves as it does without us, to the last bit."""

    def final_state() -> Array:
        model = mujoco.MjModel.from_xml_string(_FOREIGN_MODEL)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        return np.concatenate([data.qpos, data.qvel])

    alone = final_state()
    swimmer = mujoco.MjModel.from_xml_string(mjcf(PAPER))
    swimmer_data = mujoco.MjData(swimmer)
    with viscous_friction():
        mujoco.mj_step(swimmer, swimmer_data, 10)
        beside = final_state()
    return Section(
        "Other models in the process",
        [
            Check(
                "another model beside a swimmer: change of its state",
                float(np.abs(beside - alone).max()),
                0.0,
                "nothing may act on it",
            )
        ],
    )


# Reports --------------------------------------------------------------------------------------------------------


def full_report(seed: int = 0) -> Iterator[Section]:
    """Run all checks, in less than a minute, and yield each section when it is done.

    Parameters
    ----------
    seed : int
        Of the random swimmers, states and torques.
    """
    rng = np.random.default_rng(seed)
    for section in (accelerations, trajectories, invariants, symmetries, lambda _: closed_forms(), limits):
        with np.errstate(all="ignore"):  # a wrong motion may overflow: its errors are no numbers, and fail
            done = section(rng)
        yield done
    yield other_models()


def physics_report(seed: int = 0, n_states: int = 50) -> list[Check]:
    """Run the checks that take a few seconds together.

    Parameters
    ----------
    seed : int
        Of the random swimmers and states.
    n_states : int
        How many states the statements are compared at, for each of five numbers of links.
    """
    rng = np.random.default_rng(seed)
    sections = [
        accelerations(rng, (1, 2, 3, 5, 8), 5, max(1, n_states // 5)),
        symmetries(rng, (2, 5), 5),
        closed_forms(STATEMENTS, 0.2),
        other_models(),
    ]
    return [check for section in sections for check in section.checks]


def callback_self_test() -> Check:
    """Check that the callback acts in this installation: the rod that glides sideways."""
    return closed_forms(STATEMENTS[1:2]).checks[0]
