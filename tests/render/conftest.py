from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from swimmer_mj import PAPER
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.render.figures import save_figure
from swimmer_mj.state import expand
from swimmer_mj.trajectory import Trajectory


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
