"""Value gradients beside PPO and SAC on the tasks of any_model.py: returns against time and against simulation.

    python benchmarks/any_model_curves.py

draws docs/images/any-model-time.png and docs/images/any-model-simulation.png from what any_model.py and
any_model_peers.py wrote: the mean over seeds as far as all were looked at, each seed faint behind it, and the best
listed return, dotted.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import tyro
from any_model import OUT as OURS
from any_model_peers import OUT as PEERS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter
from model_tables import published
from numpy.typing import NDArray

from swimmer_mj.cli.training import configured
from swimmer_mj.learning.problems.mujoco.task import MujocoTask
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.render.bands import end_key, mark_ends
from swimmer_mj.render.figures import COLORS, HANDLE, INK, plain_axes, save_figure

IMAGES = Path(__file__).parents[1] / "docs" / "images"
NAMES = {"ours": "value gradients", "ppo": "PPO", "sac": "SAC"}
STYLES = {"ours": "-", "ppo": "--", "sac": "-."}
WIDTHS = {"ours": 2.8, "ppo": 1.6, "sac": 1.6}
"""Value gradients lie below the others, and are seen beside their dashes."""
QUANTITIES = {"time": "processor time of one core  (s)", "simulation": "simulated time  (s)"}
COLUMNS = 3
Quantity = Literal["time", "simulation"]
Array = NDArray[np.float64]


class Curve(NamedTuple):
    """Looks at one learner of one task."""

    time: Array
    """s of a core."""
    simulation: Array
    """s simulated."""
    returns: Array


def _read(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def curves(ours: Path = OURS, peers: Path = PEERS) -> dict[str, dict[str, list[Curve]]]:
    """By task and learner, seed by seed."""
    looks: dict[tuple[str, str, str], list[tuple[float, float, float]]] = {}
    own, others = _read(ours), _read(peers)
    steps = {task: learners_step(task) for task in {row["task"] for row in own}}
    holds = {
        task: MujocoTask(task, threads=1).problem.control_timestep for task in {row["task"] for row in others}
    }
    for row in own:
        if row["look"] == "of the learner":
            simulated = float(row["simulation_steps"]) * steps[row["task"]]
            look = (float(row["cpu_seconds"]), simulated, float(row["return_mean"]))
            looks.setdefault((row["task"], "ours", row["seed"]), []).append(look)
    for row in others:
        simulated = float(row["actions"]) * holds[row["task"]]
        look = (float(row["cpu_seconds"]), simulated, float(row["return_mean"]))
        looks.setdefault((row["task"], row["algorithm"], row["seed"]), []).append(look)
    found: dict[str, dict[str, list[Curve]]] = {}
    for (task, learner, _), some in looks.items():
        found.setdefault(task, {}).setdefault(learner, []).append(Curve(*np.array(some).T))
    return found


def learners_step(task: str) -> float:
    """Of value gradients on a task, s."""
    method = configured(task, "value-gradient", {}, 1).method
    assert isinstance(method, ValueGradients)
    return method.settings.dt


def mean_curve(learners: Sequence[Curve], quantity: Quantity) -> tuple[Array, Array]:
    """Where all were looked at, and the mean of their returns there, looks joined by straight lines."""
    spent = [getattr(one, quantity) for one in learners]
    at = np.geomspace(max(x[0] for x in spent), min(x[-1] for x in spent), 200)
    returns = [np.interp(at, x, one.returns) for x, one in zip(spent, learners, strict=True)]
    return at, np.mean(returns, axis=0)


def _draw_task(axes: Axes, task: str, learners: Mapping[str, Sequence[Curve]], quantity: Quantity) -> None:
    plain_axes(axes)
    means = []
    for (name, style), color in zip(STYLES.items(), COLORS, strict=False):
        if name in learners:
            for one in learners[name]:
                axes.plot(getattr(one, quantity), one.returns, color=color, linewidth=0.6, alpha=0.3)
            means += axes.plot(
                *mean_curve(learners[name], quantity), color=color, linestyle=style, linewidth=WIDTHS[name]
            )
    mark_ends(axes, means)
    best = published().get(task)
    if best:
        axes.axhline(best[0][1], color=INK, linewidth=1.1, linestyle=":")
        axes.autoscale_view(scalex=False)  # not on the edge
    axes.set_title(task.partition("/")[2], fontsize=10, loc="left")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.xaxis.set_minor_formatter(NullFormatter())


def draw(found: Mapping[str, Mapping[str, Sequence[Curve]]], quantity: Quantity) -> Figure:
    """A panel a task."""
    rows = -(-len(found) // COLUMNS)
    figure = Figure(figsize=(9.6, 2.3 * rows + 0.8), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, (task, learners) in zip(grid, found.items(), strict=False):
        _draw_task(axes, task, learners, quantity)
    for axes in grid[len(found) :]:
        axes.axis("off")
    handles = [
        Line2D([], [], color=color, linestyle=style, linewidth=WIDTHS[name], label=NAMES[name])
        for (name, style), color in zip(STYLES.items(), COLORS, strict=False)
    ]
    handles.append(Line2D([], [], color=INK, linestyle=":", linewidth=1.1, label="best listed"))
    handles.append(end_key("its runs end"))
    figure.legend(handles=handles, loc="outside upper center", ncols=5, frameon=False, handlelength=HANDLE)
    figure.supxlabel(QUANTITIES[quantity], fontsize="medium")
    figure.supylabel("return of an episode", fontsize="medium")
    return figure


def main(ours: Path = OURS, peers: Path = PEERS, images: Path = IMAGES) -> None:
    """Draw both.

    Args:
        ours: What any_model.py wrote.
        peers: What any_model_peers.py wrote.
        images: Where to draw.
    """
    found = curves(ours, peers)
    for quantity in QUANTITIES:
        save_figure(draw(found, quantity), images / f"any-model-{quantity}.png", dpi=110)


if __name__ == "__main__":
    tyro.cli(main)
