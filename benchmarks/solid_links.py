"""What if links could not pass through each other? How much speed that costs.

    python benchmarks/solid_links.py [--seeds 180 181 ...] [--seconds 60]

adds to benchmarks/results/solid-links.csv: value gradients learn the 5-link swimmer from its MJCF, with links that pass
through each other, as the paper's do, and with solid ones (``mjcf(PAPER, solid=True)``). Then each policy swims in both
models, from 16 initial states in which no links cross. One learner on one core; compilation is not counted. A seed that
is there already is not learned again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from swimmer_as_mjcf import S_GAMMA, centre_velocity
from swimmer_as_mjcf import starts as in_mujoco
from yardstick import Row, fill, looks

from swimmer_mj import state as st
from swimmer_mj.environments.swimming import wrap_angle
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.mujoco import MujocoProblem
from swimmer_mj.learning.problems.mujoco.starts import Starts
from swimmer_mj.learning.problems.swim.environment import SPEED
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.viscous import viscous_friction

OUT = Path(__file__).parent / "results" / "solid-links.csv"
COLUMNS = ("learned", "seed", "cpu_seconds", "simulation_steps", "swims", "speed", "touching")
Links = Literal["passing", "solid"]
EPISODES = 16
INPUTS: dict[str, float | Literal["angle"]] = {
    f"hinge_{i}": "angle" for i in range(1, PAPER.n_links + 1)
}  # of joints that have a range, too

Array = NDArray[np.float64]


def model(links: Links) -> mujoco.MjModel:
    """The paper's swimmer, its friction as a passive force."""
    return mujoco.MjModel.from_xml_string(mjcf(PAPER, solid=links == "solid"))


def touching(solid: mujoco.MjModel, qpos: Array) -> bool:
    """Whether links would touch there if they were solid."""
    data = mujoco.MjData(solid)
    data.qpos[:] = bent(qpos)
    mujoco.mj_forward(solid, data)
    return data.nefc > 0


def bent(qpos: Array) -> Array:
    """The same posture with joint angles in (-pi, pi], where their ranges are."""
    return np.concatenate([qpos[..., :3], wrap_angle(qpos[..., 3:])], axis=-1)


def draw(rng: np.random.Generator, count: int) -> Starts:
    """Initial states as the built-in problem has them, but for those in which links touch."""
    solid, found = model("solid"), []
    while len(found) < count:
        z = random_initial_state(rng, PAPER.n_links)
        if not touching(solid, in_mujoco(st.expand(PAPER, z)).qpos):
            found.append(z)
    begin = in_mujoco(st.expand(PAPER, np.array(found)))
    return begin._replace(qpos=bent(begin.qpos))


def problem(links: Links) -> MujocoProblem:
    """To be learned."""
    return MujocoProblem(
        model(links),
        centre_velocity,
        name=f"swim{PAPER.n_links} with {links} links",
        draw=draw,
        s_gamma=S_GAMMA,
        inputs=INPUTS,
        threads=1,
    )


def swim(links: Links, act: Callable[[Starts], Array]) -> tuple[float, float]:
    """Mean velocity along x over the last 10 of 20 s (m/s), and the share of that time in which links touch."""
    made, solid = model(links), model("solid")
    begin = draw(np.random.default_rng(0), EPISODES)
    datas = [mujoco.MjData(made) for _ in range(EPISODES)]
    for data, qpos, qvel in zip(datas, begin.qpos, begin.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
    first, last = (round(t / made.opt.timestep) for t in SPEED)
    centres, touches = np.zeros((last + 1, EPISODES)), 0
    body = made.body("link_1").id
    with viscous_friction():
        for t in range(last + 1):
            for i, data in enumerate(datas):
                mujoco.mj_forward(made, data)
                centres[t, i] = data.subtree_com[body, 0]
            if t >= first and t % 10 == 0:
                touches += sum(touching(solid, data.qpos) for data in datas)
            now = Starts(*(np.array([getattr(data, name) for data in datas]) for name in ("qpos", "qvel")))
            for data, ctrl in zip(datas, act(now), strict=True):
                data.ctrl[:] = ctrl
                mujoco.mj_step(made, data)
    looked = len(range(first, last + 1, 10)) * EPISODES
    return float((centres[last] - centres[first]).mean() / (SPEED[1] - SPEED[0])), touches / looked


def learn(links: Links, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each model in which the learned policy swims."""
    own = problem(links)
    generator = torch.Generator().manual_seed(seed)
    network = Multilayer(own.n_inputs, (64, 64), generator=generator, dtype=torch.float32)
    settings = ValueGradientSettings(trajectories=256, minibatch=256)
    learner = ValueGradientLearner(own, network, settings, seed=seed)
    learner.step()  # compiles
    (clock,) = looks(learner.step, (), seconds)
    act = learner.policy().acting()
    rows: list[Row] = []
    places: tuple[Links, ...] = ("passing", "solid")
    for place in places:
        speed, share = swim(place, lambda now: act(own.states(now)) / own.control_limits)
        spent = f"{clock.before[0]:.1f}"
        rows.append((links, seed, spent, learner.simulation_steps, place, f"{speed:.4f}", f"{share:.4f}"))
        console.print(*rows[-1])
    return rows


def main(
    learned: tuple[Links, ...] = ("passing", "solid"),
    seeds: Sequence[int] = tuple(range(180, 185)),
    seconds: float = 60.0,
    out: Path = OUT,
) -> None:
    """Learn with both kinds of links and each seed.

    Args:
        learned: Which links.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((links, seed) for seed in seeds for links in learned)
    fill(out, COLUMNS, keys, lambda links, seed: learn(links, seed, seconds, console))


if __name__ == "__main__":
    tyro.cli(main)
