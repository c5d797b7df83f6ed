"""What do other packages' swimmers feel in their water? Writes docs/other-swimmers.md's tables, their JSON and plot.

    python benchmarks/other_swimmers.py

measures this project's swimmers, Gymnasium's, dm_control's and, where Brax can be imported, Brax's. What cannot be
imported keeps the values that docs/other-swimmers.json has of it. Brax wants, in an environment of its own,

    pip install -e '.[gymnasium]' brax 'mujoco<4' 'jax<0.8'

since Brax 0.14.2 calls what jax has removed since. Drag is measured on the straight chain: all velocities are zero
but the root's, and the force of the fluid on the whole chain is the passive force on the root's two slides.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings and dm_control carry no types.)
from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import inspect
import json
import math
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from swimmer_mj.files import replacing
from swimmer_mj.render.backend import BackendError, use_backend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SPEEDS", "SWIMMERS", "Swimmer", "drag_plot", "measure", "read", "tables"]

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "other-swimmers.md"
DATA = ROOT / "docs" / "other-swimmers.json"
PLOT = ROOT / "docs" / "images" / "other-swimmers.png"
SPEEDS = np.logspace(-2, 1, 31)
"""Speeds at which drag is measured, m/s: ten a decade."""
EXPONENT_SPEEDS = (0.01, 10.0)
"""Where the power of the speed that drag follows is measured, m/s."""
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"

Array = NDArray[np.float64]
Force = Callable[[Array], Array]
"""Force of the fluid on the straight chain, shape (2,), N, at a velocity, shape (2,), m/s."""


@dataclasses.dataclass(frozen=True)
class Swimmer:
    """What was measured of one swimmer. SI units; links are equal, or measuring fails."""

    name: str
    package: str
    versions: dict[str, str]
    links: int
    link_mass: float
    link_length: float
    """Distance between the joints of a link, m."""
    armature: float
    """Inertia that each joint adds to what it turns, kg·m²."""
    joint_limit: float | None
    """Largest angle either way, rad; None without limits."""
    density: float
    """Of MuJoCo's fluid, kg/m³."""
    viscosity: float
    """Of MuJoCo's fluid, Pa·s."""
    across: list[float]
    """Drag at :data:`SPEEDS` in motion across the chain, N."""
    along: list[float]
    """The same along it."""
    across_exponents: list[float]
    """d log(drag) / d log(speed) at :data:`EXPONENT_SPEEDS`; empty without drag."""
    along_exponents: list[float]
    torque: float
    """Largest torque of a motor, N·m; there is one motor a joint."""
    timestep: float
    substeps: int
    """Time steps of the simulation in a control step."""
    integrator: str
    episode: float
    """Duration, s."""
    reward: str
    """In words; the words' formula was held against the reward of a step."""

    @property
    def mass(self) -> float:
        """Of the chain, kg."""
        return self.links * self.link_mass

    def drag(self, direction: str, speed: float) -> float:
        """Drag, N, in motion ``"across"`` or ``"along"`` at one of :data:`SPEEDS`."""
        return getattr(self, direction)[int(np.argmin(np.abs(SPEEDS - speed)))]


# Measuring ---------------------------------------------------------------------------------------------------------


def measure_ours(task: str) -> Swimmer:
    """A task of this project."""
    import swimmer_mj

    env = swimmer_mj.load(task, task_kwargs={"random": 0})
    physics = env.physics
    try:
        episode = _dm_control_episode(env)
        env.reset()
        before = physics.center_of_mass()
        step = env.step(_random_action(env.action_spec().shape))
        velocity = (physics.center_of_mass() - before)[0] / env.control_timestep()
        _hold("reward", step.reward, velocity)
        return Swimmer(
            name=task,
            package="swimmer-mj",
            versions=_versions("swimmer-mj", "mujoco"),
            **_mujoco(physics.model.ptr, physics.data.ptr),
            substeps=round(env.control_timestep() / physics.timestep()),
            episode=episode,
            reward="velocity of the centre of mass along the target direction",
        )
    finally:
        physics.free()


def measure_dm_control(task: str) -> Swimmer:
    """A swimmer of dm_control's suite."""
    from dm_control import suite
    from dm_control.utils import rewards

    env = suite.load("swimmer", task, task_kwargs={"random": 0})
    physics = env.physics
    try:
        episode = _dm_control_episode(env)
        env.reset()
        physics.named.model.geom_pos["target", ["x", "y"]] = physics.named.data.geom_xpos["nose", ["x", "y"]]
        physics.named.model.geom_pos["target", "x"] += 0.3
        step = env.step(_random_action(env.action_spec().shape))
        radius = physics.named.model.geom_size["target", 0]
        distance = np.hypot(
            *(physics.named.data.geom_xpos["nose"] - physics.named.data.geom_xpos["target"])[:2]
        )
        nearness = rewards.tolerance(distance, (0, radius), margin=5 * radius, sigmoid="long_tail")
        _hold("reward", step.reward, nearness)
        return Swimmer(
            name=task,
            package="dm_control",
            versions=_versions("dm-control", "mujoco"),
            **_mujoco(physics.model.ptr, physics.data.ptr),
            substeps=round(env.control_timestep() / physics.timestep()),
            episode=episode,
            reward="nearness of the nose to a target, 0 to 1",
        )
    finally:
        physics.free()


def measure_gymnasium(environment: str) -> Swimmer:
    """A swimmer of Gymnasium."""
    import gymnasium

    made = gymnasium.make(environment)
    env: Any = made.unwrapped
    try:
        made.reset(seed=0)
        action = _random_action(env.action_space.shape)
        before = env.data.qpos[0]
        _, reward, *_ = made.step(action)
        _hold("reward", float(reward), (env.data.qpos[0] - before) / env.dt - 1e-4 * (action @ action))
        measured = _mujoco(env.model, env.data)
        assert made.spec is not None
        assert made.spec.max_episode_steps is not None
        return Swimmer(
            name=environment,
            package="Gymnasium",
            versions=_versions("gymnasium", "mujoco"),
            **measured,
            substeps=env.frame_skip,
            episode=made.spec.max_episode_steps * env.dt,
            reward=_slide_reward(env.model, env.data),
        )
    finally:
        made.close()


def measure_brax(name: str) -> Swimmer:
    """A swimmer of Brax."""
    import jax  # pyright: ignore[reportMissingImports]
    import mujoco
    from brax import envs  # pyright: ignore[reportMissingImports]
    from brax.generalized import dynamics, pipeline  # pyright: ignore[reportMissingImports]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that Brax is not maintained
        env = envs.get_environment(name)
    system = env.sys
    nq = system.q_size()

    @jax.jit
    def passive(qd: Any) -> Any:
        state = pipeline.init(system, jax.numpy.zeros(nq), qd)
        return dynamics.forward(system, state, jax.numpy.zeros(nq)) + dynamics.inverse(system, state)

    def force(velocity: Array) -> Array:
        return np.asarray(passive(np.concatenate([velocity, np.zeros(nq - 2)])), dtype=np.float64)[:2]

    state = jax.jit(env.reset)(jax.random.PRNGKey(0))
    action = _random_action((env.action_size,))
    stepped = jax.jit(env.step)(state, action)
    q = state.pipeline_state.q, stepped.pipeline_state.q
    reward = (q[1][0] - q[0][0]) / env.dt - 1e-4 * (action @ action)
    _hold("reward", float(stepped.reward), float(reward), 1e-4)
    once = jax.jit(pipeline.step)(system, state.pipeline_state, action)
    _hold("integrator", once.q, state.pipeline_state.q + system.opt.timestep * once.qd, 1e-6)

    model, data = system.mj_model, mujoco.MjData(system.mj_model)
    _hold("mass", system.link.inertia.mass, model.body_mass[1:], 1e-6)
    _hold(
        "density, viscosity",
        (system.density, system.viscosity),
        (model.opt.density, model.opt.viscosity),
        1e-6,
    )
    measured = {**_mujoco(model, data, force), "integrator": "semi-implicit Euler"}
    steps = inspect.signature(envs.create).parameters["episode_length"].default
    return Swimmer(
        name=name,
        package="Brax",
        versions=_versions("brax", "jax", "mujoco"),
        **measured,
        substeps=round(float(env.dt) / float(system.opt.timestep)),
        episode=_short(steps * env.dt),
        reward=_slide_reward(model, data),
    )


def _mujoco(model: Any, data: Any, force: Force | None = None) -> dict[str, Any]:
    """What a MuJoCo model says of a chain; ``force`` by MuJoCo itself unless it is given."""
    import mujoco

    def passive_force(velocity: Array) -> Array:
        data.qvel[:] = 0
        data.qvel[:2] = velocity
        mujoco.mj_forward(model, data)
        return data.qfrc_passive[:2].copy()

    mujoco.mj_resetData(model, data)
    data.qpos[:] = 0
    mujoco.mj_forward(model, data)
    slide, hinge = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
    bodies = np.flatnonzero(model.body_mass)
    links = bodies.size
    _hold("joints", model.jnt_type, [slide, slide] + [hinge] * links)
    _hold("slides", data.xaxis[:2], [[1, 0, 0], [0, 1, 0]])
    gaps = np.diff(data.xipos[bodies], axis=0)  # between the links' centres, which are the middles
    along = gaps[0, :2] / np.hypot(*gaps[0, :2])
    _hold("straight chain of equal links", gaps, np.tile(gaps[0], (links - 1, 1)), 1e-9)
    _hold("equal masses", model.body_mass[bodies], model.body_mass[bodies[0]], 1e-9)
    anchors = np.diff(data.xanchor[3:], axis=0)  # the first hinge need not be at an end of its link
    _hold("length between joints", np.hypot(*anchors.T[:2]), np.hypot(*gaps[0, :2]), 1e-9)
    _hold("one motor a joint", model.actuator_trnid[:, 0], np.arange(3, links + 2))
    torque = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0] * model.actuator_ctrlrange.T
    _hold("equal motors", torque, torque[1, 0] * np.array([[-1], [1]]) * np.ones(links - 1))
    limited = model.jnt_limited[3:].astype(bool)
    limits = model.jnt_range[3:] * [-1, 1]
    _hold("equal joints", limits, limits[0, 0])
    _hold("equal joints", limited, limited[0])

    across = np.array([-along[1], along[0]])
    swept = {
        "across": _drag(force or passive_force, across, SPEEDS, across),
        "along": _drag(force or passive_force, along, SPEEDS, across),
    }
    exponents = {}
    for name, direction in (("across", across), ("along", along)):
        with np.errstate(divide="ignore", invalid="ignore"):
            pairs = _drag(
                force or passive_force, direction, np.outer(EXPONENT_SPEEDS, [1 / 1.02, 1.02]), across
            )
            exponents[name] = np.diff(np.log(pairs), axis=-1)[:, 0] / (2 * math.log(1.02))
    return {
        "links": int(links),
        "link_mass": _short(model.body_mass[bodies[0]]),
        "link_length": _short(np.hypot(*gaps[0, :2])),
        "armature": _short(model.dof_armature[3]),
        "joint_limit": _short(limits[0, 0]) if limited[0] else None,
        "density": _short(model.opt.density),
        "viscosity": _short(model.opt.viscosity),
        **{name: [_short(f) for f in drag] for name, drag in swept.items()},
        **{
            f"{name}_exponents": [_short(e) for e in values if np.isfinite(e)]
            for name, values in exponents.items()
        },
        "torque": _short(torque[1, 0]),
        "timestep": _short(model.opt.timestep),
        "integrator": _INTEGRATORS[int(model.opt.integrator)],
    }


_INTEGRATORS = {0: "semi-implicit Euler", 1: "RK4", 2: "implicit", 3: "implicitfast"}


def _drag(force: Force, direction: Array, speeds: Array, across: Array) -> Array:
    """Drag against ``direction`` at ``speeds``, same shape, N; 0 where rounding is all there is of it."""
    drag = np.reshape([-force(v * direction) @ direction for v in speeds.flat], speeds.shape)
    largest = np.reshape([np.hypot(*force(v * across)) for v in speeds.flat], speeds.shape)
    return np.where(np.abs(drag) < 1e-12 * largest, 0.0, drag)


def _slide_reward(model: Any, data: Any) -> str:
    """Which point the velocity of the first slide is that of, with the chain straight."""
    distance = np.hypot(*(data.xanchor[2] - data.xipos[model.jnt_bodyid[2]])[:2])
    point = f"a point fixed to the first link, {_number(distance)} m from the link's centre"
    return f"x velocity of {point}, less 1e-4 Σ action²"


def _dm_control_episode(env: Any) -> float:
    return env._step_limit * env.control_timestep()  # dm_control does not tell otherwise


def _random_action(shape: Sequence[int]) -> Array:
    return np.random.default_rng(0).uniform(-1, 1, shape)


def _hold(what: str, found: Any, expected: Any, tolerance: float = 1e-12) -> None:
    """Fail where a swimmer is not what the page takes it for."""
    if not np.allclose(found, expected, rtol=tolerance, atol=tolerance):
        raise AssertionError(f"{what}: found {found}, expected {expected}")


def _versions(*packages: str) -> dict[str, str]:
    return {package: version(package) for package in packages}


def _short(number: float) -> float:
    """Without the digits that rounding makes."""
    return float(f"{float(number):.6g}")


SWIMMERS: dict[tuple[str, str], Callable[[str], Swimmer]] = {
    ("swimmer_mj", "swim5"): measure_ours,
    ("swimmer_mj", "swim3"): measure_ours,
    ("gymnasium", "Swimmer-v5"): measure_gymnasium,
    ("brax", "swimmer"): measure_brax,
    ("dm_control", "swimmer6"): measure_dm_control,
    ("dm_control", "swimmer15"): measure_dm_control,
}
"""Import name and task -> how to measure it, in the order of the tables."""


def measure(stored: Iterable[Swimmer] = ()) -> list[Swimmer]:
    """All of :data:`SWIMMERS`, as ``stored`` has them where they cannot be imported."""
    known = {swimmer.name: swimmer for swimmer in stored}
    fresh = {
        name: function(name) if importlib.util.find_spec(module) else known.get(name)
        for (module, name), function in SWIMMERS.items()
    }
    return [swimmer for swimmer in fresh.values() if swimmer is not None]


def read(path: Path = DATA) -> list[Swimmer]:
    """The swimmers in a JSON file that :func:`main` wrote; none if there is no file."""
    if not path.exists():
        return []
    stored = json.loads(path.read_text(encoding="utf-8"))
    _hold(f"speeds in {path}", stored["speeds"], SPEEDS, 1e-5)
    return [Swimmer(**record) for record in stored["swimmers"]]


# Showing -----------------------------------------------------------------------------------------------------------


def tables(swimmers: Sequence[Swimmer]) -> str:
    """The page's tables, in Markdown."""
    title = ["", *(f"`{s.name}`" for s in swimmers)]
    packages = {"package": [s.package for s in swimmers]}

    def degrees(angle: float | None) -> str:
        return "none" if angle is None else f"±{_number(math.degrees(angle))}"

    body = {
        **packages,
        "links": [f"{s.links}" for s in swimmers],
        "mass of a link, kg": [_number(s.link_mass) for s in swimmers],
        "length of a link, m": [_number(s.link_length) for s in swimmers],
        "mass of the chain, kg": [_number(s.mass) for s in swimmers],
        "length of the chain, m": [_number(s.links * s.link_length) for s in swimmers],
        "armature of a joint, kg·m²": [_number(s.armature) for s in swimmers],
        "joint limits, °": [degrees(s.joint_limit) for s in swimmers],
    }
    drag = {
        **packages,
        "density of MuJoCo's fluid, kg/m³": [_number(s.density) for s in swimmers],
        "viscosity of MuJoCo's fluid, Pa·s": [_number(s.viscosity) for s in swimmers],
        "drag across at 1 m/s, N": [_number(s.drag("across", 1)) for s in swimmers],
        "drag along at 1 m/s, N": [_number(s.drag("along", 1)) for s in swimmers],
        "across / along": [_ratio(s.drag("across", 1), s.drag("along", 1)) for s in swimmers],
        "across, per kg of swimmer, N/kg": [_number(s.drag("across", 1) / s.mass) for s in swimmers],
        "along, per kg of swimmer, N/kg": [_number(s.drag("along", 1) / s.mass) for s in swimmers],
    }
    for direction in ("across", "along"):
        drag[f"power of the speed {direction}"] = [
            _powers(getattr(s, f"{direction}_exponents")) for s in swimmers
        ]
    drag["drag law"] = [_law(s) for s in swimmers]
    control = {
        **packages,
        "motors": [f"{s.links - 1}" for s in swimmers],
        "largest torque, N·m": [_number(s.torque) for s in swimmers],
        "torque / (m l²) of a link, 1/s²": [
            _number(s.torque / (s.link_mass * s.link_length**2)) for s in swimmers
        ],
        "time step, s": [_number(s.timestep) for s in swimmers],
        "integrator": [s.integrator for s in swimmers],
        "control step, s": [_number(s.timestep * s.substeps) for s in swimmers],
        "episode, s": [_number(s.episode) for s in swimmers],
    }
    reward = {f"{s.package} `{s.name}`": [s.reward] for s in swimmers}
    sections = (
        ("Body", _table(title, body)),
        ("Drag on the straight chain", _table(title, drag)),
        ("Control and time", _table(title, control)),
        ("Reward of a control step", _table(["", "reward"], reward)),
    )
    return "\n\n".join(f"## {heading}\n\n{table}" for heading, table in sections)


def versions_line(swimmers: Sequence[Swimmer]) -> str:
    """Which versions were measured."""
    found: dict[str, str] = {}
    for swimmer in swimmers:
        for package, number in swimmer.versions.items():
            if found.setdefault(package, number) != number:
                found[package] += f" ({number} for {swimmer.package})"
    return "Measured with " + ", ".join(f"{package} {number}" for package, number in found.items()) + "."


def _table(title: Sequence[str], rows: dict[str, list[str]]) -> str:
    cells = [list(title), *([name, *values] for name, values in rows.items())]
    widths = [max(len(row[i]) for row in cells) for i in range(len(title))]
    align = [
        ":" + "-" * (widths[0] - 1),
        *("-" * (w - 1) + ":" if len(title) > 2 else "-" * w for w in widths[1:]),
    ]
    lines = [cells[0], align, *cells[1:]]

    def line(row: Sequence[str]) -> str:
        first, *rest = row
        pad = str.rjust if len(title) > 2 else str.ljust
        return f"| {' | '.join([first.ljust(widths[0]), *map(pad, rest, widths[1:])])} |"

    return "\n".join(map(line, lines))


def _number(value: float) -> str:
    """Three significant digits, without an exponent where it is readable."""
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 1e6:
        decimals = max(0, 2 - math.floor(math.log10(abs(value))))
        text = f"{value:,.{decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.3g}".replace("e-0", "e-")


def _ratio(a: float, b: float) -> str:
    return "∞" if b == 0 else _number(a / b)


def _powers(exponents: Sequence[float]) -> str:
    """From that at the lowest of the speeds to that at the highest."""
    if not exponents:
        return "no drag"
    first, last = f"{exponents[0]:.2f}", f"{exponents[-1]:.2f}"
    return first if first == last else f"{first} to {last}"


def _law(swimmer: Swimmer) -> str:
    slow, fast = zip(
        *(e[:: len(EXPONENT_SPEEDS) - 1] for e in (swimmer.across_exponents, swimmer.along_exponents) if e),
        strict=True,
    )
    for power, name in ((1, "linear"), (2, "quadratic")):
        if all(abs(p - power) < 0.005 for p in fast):
            return name if all(abs(p - power) < 0.005 for p in slow) else f"{name} when fast"
    return "mixed"


def drag_plot(swimmers: Sequence[Swimmer]) -> Figure:
    """Drag per mass against speed, across and along the chain; swimmers that feel the same share a line."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    from swimmer_mj.render.figures import BLUE, COLORS, HANDLE, INK, ORANGE, line, plain_axes

    groups: list[list[Swimmer]] = []
    for swimmer in swimmers:
        for group in groups:
            if all(
                np.allclose(_per_mass(group[0], d), _per_mass(swimmer, d), rtol=1e-3)
                for d in ("across", "along")
            ):
                group.append(swimmer)
                break
        else:
            groups.append([swimmer])
    figure = Figure(figsize=(9.6, 4.7), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    colors = (BLUE, ORANGE, *COLORS[2:])
    for axes, direction in zip(panels, ("across", "along"), strict=True):
        plain_axes(axes)
        axes.set(xscale="log", yscale="log", xlabel="speed, m/s", xlim=(0.01, 10), ylim=(1e-4, 1e5))
        axes.set_title(f"Moving {direction} the straight chain", loc="left", fontsize=11, color=INK)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axes.yaxis.set_major_locator(LogLocator(numticks=10))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(
            FuncFormatter(lambda v, _: f"{v:,.0f}" if v >= 1 else f"{v:.4f}".rstrip("0"))
        )
        for color, group in zip(colors, groups, strict=False):
            drag = _per_mass(group[0], direction)
            label = "\n".join(f"{s.package} {s.name}" for s in group)
            if not drag.any():
                axes.text(0.97, 0.05, f"{label}\nno drag", transform=axes.transAxes, ha="right", va="bottom",
                          color=color, fontsize=9, linespacing=1.35)  # fmt: skip
                continue
            axes.plot(SPEEDS, drag, linewidth=2.2, label=label, **line(color))
            power = getattr(group[0], f"{direction}_exponents")[-1]
            law = {1: "∝ v", 2: "∝ v²"}.get(round(power, 2), f"∝ v^{power:.2f}")
            axes.annotate(
                law, (SPEEDS[-1], drag[-1]), (5, 0), textcoords="offset points", va="center", color=color
            )
    panels[0].set_ylabel("drag per kg of swimmer, N/kg")
    panels[0].legend(loc="upper left", frameon=False, fontsize=9, labelspacing=0.7, handlelength=HANDLE)
    return figure


def _per_mass(swimmer: Swimmer, direction: str) -> Array:
    return np.array(getattr(swimmer, direction)) / swimmer.mass


def page(text: str, swimmers: Sequence[Swimmer]) -> str:
    """``text`` of the page with what was measured between its two marks."""
    block = f"{BEGIN}\n\n{versions_line(swimmers)}\n\n{tables(swimmers)}\n\n{END}"
    new, count = re.subn(f"{re.escape(BEGIN)}.*{re.escape(END)}", lambda _: block, text, flags=re.DOTALL)
    if count != 1:
        raise ValueError(f"the page must have {BEGIN} and {END}, once")
    return new


def main() -> None:
    """Measure what can be imported; write tables, JSON and plot."""
    from swimmer_mj.render.figures import save_figure

    with contextlib.suppress(BackendError):
        use_backend()  # else dm_control looks for a screen when it is imported
    swimmers = measure(read())
    with replacing(DATA) as partial:
        record = {
            "speeds": [_short(v) for v in SPEEDS],
            "swimmers": [dataclasses.asdict(s) for s in swimmers],
        }
        text = json.dumps(record, indent=2)
        text = re.sub(
            r"\[[^\[\]{}]*\]", lambda m: " ".join(m[0].split()).replace("[ ", "[").replace(" ]", "]"), text
        )
        partial.write_text(text + "\n", encoding="utf-8")
    with replacing(PAGE) as partial:
        partial.write_text(page(PAGE.read_text(encoding="utf-8"), swimmers), encoding="utf-8")
    save_figure(drag_plot(swimmers), PLOT)
    print(tables(swimmers))


if __name__ == "__main__":
    tyro.cli(main)
