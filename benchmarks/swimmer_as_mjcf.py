"""Does a swimmer that is only known as a model of MuJoCo learn to swim as one whose equations are written down?

    python benchmarks/swimmer_as_mjcf.py [--seeds 100 101 ...] [--seconds 120]

adds to benchmarks/results/swimmer-as-mjcf.csv, a row a look: value gradients on the MJCF of the 5-link swimmer, with
the friction as a passive-force callback and as actuators. One learner on one core; compilation and looks are not
counted. Judged by swimming speed in the vector environment. A seed that is there already is not learned again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor
from yardstick import COLUMNS, Row, fill, looks, row, swimming_speed

from swimmer_mj import state as st
from swimmer_mj.dynamics import to_qpos_qvel
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.mujoco import MujocoProblem
from swimmer_mj.learning.problems.mujoco.readings import Scene
from swimmer_mj.learning.problems.mujoco.starts import Starts
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.mjcf import Friction, mjcf
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parent / "results" / "swimmer-as-mjcf.csv"
S_GAMMA = 0.5
LOOKS = (5.0, 10.0, 20.0, 40.0, 80.0, 120.0)

Array = NDArray[np.float64]


def centre_velocity(scene: Scene) -> Tensor:
    """Velocity of the centre of mass along x, m/s."""
    theta, omega = torch.cumsum(scene.qpos[:, 2:], 1), torch.cumsum(scene.qvel[:, 2:], 1)
    across = (
        -torch.tensor(PAPER.lengths) * torch.sin(theta) * omega
    )  # of each link's end against its beginning
    middles = scene.qvel[:, :1] + torch.cumsum(across, 1) - across / 2
    masses = torch.tensor(PAPER.masses)
    return (middles * masses).sum(1) / masses.sum()


def swimmer(friction: Friction) -> MujocoProblem:
    """The paper's swimmer by its MJCF alone, with the initial states of the built-in problem."""

    def draw(rng: np.random.Generator, count: int) -> Starts:
        return starts(st.expand(PAPER, random_initial_state(rng, PAPER.n_links, size=count)))

    return MujocoProblem(
        mujoco.MjModel.from_xml_string(mjcf(PAPER, friction=friction)),
        centre_velocity,
        name=f"swim{PAPER.n_links} as MJCF, friction by {friction}",
        draw=draw,
        s_gamma=S_GAMMA,
        threads=1,
    )


def starts(full: Array) -> Starts:
    """MuJoCo's coordinates of states (count, 2n + 4)."""
    return Starts(*to_qpos_qvel(full, PAPER.n_links))


def start(problem: MujocoProblem, seed: int) -> ValueGradientLearner[Multilayer]:
    """A learner of it."""
    generator = torch.Generator().manual_seed(seed)
    network = Multilayer(problem.n_inputs, (64, 64), generator=generator, dtype=torch.float32)
    settings = ValueGradientSettings(trajectories=64, minibatch=256, passes=4, huber=1.0)
    return ValueGradientLearner(problem, network, settings, seed=seed)


def learn(friction: Friction, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at one learner."""
    problem = swimmer(friction)
    learner = start(problem, seed)
    learner.step()  # compiles
    rows: list[Row] = []
    for clock in looks(learner.step, LOOKS, seconds):
        act, limits = learner.policy().acting(), problem.control_limits

        def actions(x: Array, act: Callable[[Array], Array] = act, limits: Array = limits) -> Array:
            return act(problem.states(starts(st.expand(PAPER, x)))) / limits

        speed = swimming_speed(actions)
        rows.append(row(f"friction by {friction}", seed, clock, learner.simulation_steps, speed))
        console.print(*rows[-1])
    return rows


def main(
    frictions: tuple[Friction, ...] = ("callback", "actuators"),
    seeds: Sequence[int] = tuple(range(100, 110)),
    seconds: float = 120.0,
    out: Path = OUT,
) -> None:
    """Learn with each friction and each seed.

    Args:
        frictions: Which.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    names: dict[str, Friction] = {f"friction by {friction}": friction for friction in frictions}

    def of(name: str, seed: int) -> list[Row]:
        return learn(names[name], seed, seconds, console)

    fill(out, COLUMNS, ((name, seed) for seed in seeds for name in names), of)


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
