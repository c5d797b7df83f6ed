"""Does a learned policy live on its model's exact numbers? Finer integration, and a swimmer that is 10 % off.

    python benchmarks/robustness.py RUN

evaluates the best weights of each seed in a directory of runs of 5 links that ``swimmer-mj train`` made, on MuJoCo:

- by the definition of swimming speed: RK4 at 0.01 s, controls held for 0.01 s;
- with ten RK4 steps of 0.001 s for each control;
- with one parameter of the simulated swimmer 10 % up or down, while the policy goes on computing its controls with the
  parameters it learned with;
- with the mass, length and torque limit of every link and joint, and the friction, drawn from -10 % to 10 %.

One CSV with a row a seed and change, and a table of means and 95 % intervals over seeds.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from yardstick import CONTROL_TIMESTEP, swimming_speed

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.networks.actors import BatchActor
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import SwimmerForm
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, N_EPISODES, SETTLING_TIME
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.runs.run import load_policy
from swimmer_mj.parameters import PAPER, SwimmerParameters

Array = NDArray[np.float64]

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "robustness.csv"
COLUMNS = ("seed", "change", "speed")
FINER = 10
N_DRAWS = 4
OFF = 0.1

N_STEPS, N_SETTLING = (round(t / CONTROL_TIMESTEP) for t in (EPISODE_DURATION, SETTLING_TIME))


def changed_swimmers() -> Iterator[tuple[str, SwimmerParameters]]:
    """What is changed, and the swimmer that has it."""
    yield "none", PAPER
    for sign, word in ((1, "up"), (-1, "down")):
        factor = 1 + sign * OFF
        yield f"mass {word}", dataclasses.replace(PAPER, mass=factor)
        yield f"length {word}", dataclasses.replace(PAPER, length=factor)
        yield f"friction {word}", dataclasses.replace(PAPER, viscous_friction=10.0 * factor)
        yield f"torque limit {word}", dataclasses.replace(PAPER, torque_limit=5.0 * factor)
    n = PAPER.n_links
    for draw in range(N_DRAWS):
        rng = np.random.default_rng(draw)
        mass, length, torque = (rng.uniform(1 - OFF, 1 + OFF, count).tolist() for count in (n, n, n - 1))
        yield (
            f"all, draw {draw}",
            SwimmerParameters(
                n, mass, length, 10.0 * rng.uniform(1 - OFF, 1 + OFF), [5.0 * u for u in torque]
            ),
        )


def quick(policy: GreedyPolicy) -> Callable[[Array], Array]:
    """The policy as actions in [-1, 1], by compiled code where there is some for its network."""
    actor = BatchActor(policy.problem, policy.network)
    weights = torch.cat([w.detach().flatten() for w in policy.network.parameters()])
    return lambda states: actor.control(weights, states) / policy.problem.control_limits


def speed_with_finer_steps(act: Callable[[Array], Array]) -> float:
    """Mean over the evaluation's episodes, m/s, with :data:`FINER` steps of MuJoCo for each control."""
    from swimmer_mj.environments import suite  # which needs dm_control; what else is here does not

    starts = evaluation_states(PAPER.n_links)
    remaining = iter(starts)
    environments = [
        suite.swim(
            PAPER,
            time_limit=float("inf"),
            initial_states=lambda _: next(remaining),
            environment_kwargs={"n_sub_steps": FINER},
        )
        for _ in starts
    ]
    for environment in environments:
        environment.physics.model.opt.timestep = CONTROL_TIMESTEP / FINER
        environment.reset()
    rewards = np.zeros((N_STEPS, N_EPISODES))
    for t in range(N_STEPS):
        states = np.array([environment.physics.reduced_state() for environment in environments])
        actions = act(states)
        rewards[t] = [
            environment.step(action).reward for environment, action in zip(environments, actions, strict=True)
        ]
    for environment in environments:
        environment.physics.free()
    return float(rewards[N_SETTLING:].mean())


def print_table(rows: list[tuple[int, str, float]], console: Console) -> None:
    """Speed of each change, and its share of the unchanged swimmer's, seed by seed."""
    table = Table(
        "change", "speed, m/s [95 %]", "of its own speed", "lowest", title="Swimming speed over seeds"
    )
    own = {seed: speed for seed, change, speed in rows if change == "none"}
    for change in dict.fromkeys(change for _, change, _ in rows):
        speeds = {seed: speed for seed, what, speed in rows if what == change}
        speed = mean_and_interval_text(np.array(list(speeds.values())), ".3f")
        shares = np.array([speed / own[seed] for seed, speed in speeds.items()])
        table.add_row(change, speed, f"{shares.mean():.3f}", f"{shares.min():.3f}")
    console.print(table)


def read(out: Path) -> list[tuple[int, str, float]]:
    """The rows of the CSV so far."""
    if not out.exists():
        return []
    with out.open(newline="") as file:
        return [(int(row["seed"]), row["change"], float(row["speed"])) for row in csv.DictReader(file)]


def append(out: Path, rows: list[tuple[int, str, float]]) -> None:
    """Add the rows of a seed to the CSV."""
    out.parent.mkdir(parents=True, exist_ok=True)
    new = not out.exists()
    with out.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerows((seed, change, f"{speed:.4f}") for seed, change, speed in rows)
    note_made(out)


def main(
    run: tyro.conf.Positional[Path],
    seeds: Sequence[int] = tuple(range(10)),
    out: Path = OUT,
) -> None:
    """Evaluate the best weights of each seed under changes that they were not learned with.

    Args:
        run: Directory with runs ``seed-0``, ``seed-1`` and so on, of 5 links.
        seeds: Which of them; what is in the CSV already is not done again.
        out: CSV to append to, a seed at a time.
    """
    torch.set_num_threads(1)
    console = Console()
    done = {seed for seed, *_ in read(out)}
    if known := sorted(done & {*seeds}):
        console.print(f"{out} has seeds {', '.join(map(str, known))}; --out FILE evaluates those of {run}")
    for seed in (seed for seed in seeds if seed not in done):
        policy, config, _ = load_policy(run / f"seed-{seed}")
        swimmer = config.problem.form(SwimmerForm)
        if swimmer is None or swimmer.parameters != PAPER or not isinstance(policy, GreedyPolicy):
            raise SystemExit(f"{run}/seed-{seed} is not a run of the paper's swimmer of 5 links")
        act = quick(policy)
        rows = [(seed, change, swimming_speed(act, changed).mean) for change, changed in changed_swimmers()]
        rows.append((seed, f"steps of {CONTROL_TIMESTEP / FINER} s", speed_with_finer_steps(act)))
        append(out, rows)
        console.print(f"seed {seed}: {rows[0][2]:.3f} m/s, {rows[-1][2]:.3f} m/s with finer steps")
    print_table(read(out), console)


if __name__ == "__main__":
    tyro.cli(main)
