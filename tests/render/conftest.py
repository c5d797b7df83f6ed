import itertools
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from swimmer_mj import PAPER, SwimmerParameters
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.render.figures import save_figure
from swimmer_mj.state import expand
from swimmer_mj.trajectory import Trajectory

APART = 15.0
"""Two greys that differ by so much in L* are told apart."""


@pytest.fixture(scope="session")
def episode() -> Trajectory:
    """3 s of a travelling wave of bang-bang torques; the target direction is reversed after 1.45 s."""
    swimmer, dt, steps = AnalyticSwimmer(PAPER), 0.01, 300
    times = dt * np.arange(steps + 1)
    phases = 2 * np.pi * (times[:-1, None] + dt / 2) / 2.0 + 0.85 * np.arange(4)
    controls = 5.0 * np.sign(np.sin(phases))
    states = [expand(PAPER, np.zeros(12))]
    for u in controls:
        states.append(swimmer.rk4_step(states[-1], u, dt))
    directions = np.where(times < 1.45, 0.0, np.pi)
    return Trajectory(
        PAPER, times, np.array(states), controls, directions, np.cos(times), 0.1 * np.sin(3 * times)
    )


THREE = SwimmerParameters(n_links=3)


@pytest.fixture(scope="session")
def swimming() -> Callable[..., Trajectory]:
    """Make a trajectory of three links whose joints have given angles, (T + 1, 2), and whose centre of mass drifts."""

    def swimming(angles, directions=None, velocity=(0.5, 0.0), controls=None, dt=0.01):
        count = len(angles)
        times = dt * np.arange(count)
        links = np.cumsum(np.column_stack([0.3 * np.sin(times), angles]), axis=1)
        z = np.column_stack([links, np.gradient(links, dt, axis=0), np.tile(velocity, (count, 1))])
        states = expand(THREE, z)
        states[:, :2] += times[:, None] * velocity
        directions = np.zeros(count) if directions is None else directions
        controls = np.ones((count - 1, 2)) if controls is None else controls
        return Trajectory(THREE, times, states, controls, directions, np.cos(times), np.sin(times))

    return swimming


@pytest.fixture(scope="session")
def waves() -> Callable[..., np.ndarray]:
    """Make the angles of two joints that go to and fro, (T + 1, 2), rad."""

    def waves(period, duration=6.0, size=0.8, dt=0.01):
        times = np.arange(0, duration + dt / 2, dt)
        return size * np.column_stack(
            [np.sin(2 * np.pi * times / period), np.cos(2 * np.pi * times / period)]
        )

    return waves


@pytest.fixture(scope="session")
def chain() -> Callable[[int], Trajectory]:
    """Make 4 s of a wave of torques along a chain of so many links."""

    def chain(n_links):
        parameters, times = SwimmerParameters(n_links), 0.01 * np.arange(401)
        swimmer = AnalyticSwimmer(parameters)
        controls = 2 * np.sin(2 * np.pi * times[:-1, None] / 0.8 + 0.8 * np.arange(n_links - 1))
        states = [expand(parameters, np.zeros(2 * n_links + 2))]
        for u in controls:
            states.append(swimmer.rk4_step(states[-1], u, 0.01))
        return Trajectory(
            parameters, times, np.array(states), controls, np.zeros(401), np.sin(times), np.cos(times)
        )

    return chain


@pytest.fixture
def check_whole(tmp_path) -> Callable[[Figure], None]:
    """Save a figure: something is drawn, and nothing touches the edges, where it would be cut off."""

    def check(figure: Figure) -> None:
        path = tmp_path / "figure.png"
        save_figure(figure, path, dpi=100)
        pixels = imread(path)[..., :3]
        assert (pixels.min(axis=-1) < 0.5).mean() > 0.005
        edges = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        np.testing.assert_array_equal(edges, 1.0)

    return check


@pytest.fixture(scope="session")
def lightness() -> Callable[[str], float]:
    """L* of CIELAB, 0 to 100: what grey print leaves of a colour."""

    def lightness(color):
        rgb = np.array(to_rgb(color))
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        Y = float(linear @ [0.2126, 0.7152, 0.0722])
        return 116 * Y ** (1 / 3) - 16 if Y > (6 / 29) ** 3 else 24389 / 27 * Y

    return lightness


@pytest.fixture(scope="session")
def check_apart(lightness) -> Callable[[Figure], None]:
    """Any two lines of a panel that are named differ in grey print: in dashes, marks or lightness."""

    def check(figure: Figure) -> None:
        for axes in figure.axes:
            named = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
            for one, other in itertools.combinations(named, 2):
                shapes = [shape(line) for line in (one, other)]
                light = [lightness(line.get_color()) for line in (one, other)]
                names = one.get_label(), other.get_label()
                assert shapes[0] != shapes[1] or abs(light[0] - light[1]) >= APART, names

    return check


def shape(line):
    """Dashes, all of which matplotlib's get_linestyle calls "--", and mark of a line."""
    mark = line.get_marker()
    return line.get_linestyle(), line._unscaled_dash_pattern, None if mark in ("", "None") else mark
