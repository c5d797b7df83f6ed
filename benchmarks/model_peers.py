"""Learners that use the model, beside each other: value gradients, SHAC, APG and cFVI on the same compiled equations.

    python benchmarks/model_peers.py tune      # some settings of each around the best known, on seeds of their own
    python benchmarks/model_peers.py final     # the best of them, on fresh seeds
    python benchmarks/model_peers.py draw      # docs/images/model-peers.png

The first two add rows to benchmarks/results/model-peers.csv, one for each look at a learner; what is there already is
not done again. The clock is the processor time of one core, evaluation not counted: the same for all, as is the number
of settings that are tried. The first setting is the best known, the others are drawn around it; the one that swims
fastest at its last look goes into the final. ``ours-torch`` is value gradients without compiled code, by the same
settings.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import torch
import tyro
from compare_learners import Curve, draw
from numpy.typing import NDArray
from peers.apg import Apg, ApgSettings
from peers.cfvi import Cfvi, CfviSettings
from peers.ours import Ours, OursSettings
from peers.shac import Shac, ShacSettings
from rich.console import Console
from yardstick import Clock, swimming_speed

from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.sweep import random_search
from swimmer_mj.parameters import PAPER
from swimmer_mj.render.figures import save_figure

OUT = Path(__file__).parent / "results" / "model-peers.csv"
COLUMNS = (
    "stage", "algorithm", "sample", "settings", "seed", "cpu_seconds", "wall_seconds", "simulation_steps",
    "gradient_evaluations", "speed",
)  # fmt: skip
PLOT = Path(__file__).parents[1] / "docs" / "images" / "model-peers.png"
Stage = Literal["tune", "final"]
Name = Literal["ours", "ours-torch", "shac", "apg", "cfvi"]
TUNING_SEED = 1000
"""Seeds from here on are for tuning alone."""
FIRST_LOOK, GROWTH = 1.0, 1.3
"""s; of the time from look to look."""
Array = NDArray[np.float64]


class Learner(Protocol):
    """What is timed."""

    hold: Any
    simulation_steps: Any
    gradient_evaluations: Any

    def learn(self) -> None:
        """A little more."""
        ...

    def policy(self) -> Callable[[Array], Array]:
        """From states (N, p) to torques (N, q)."""
        ...


class Peer(NamedTuple):
    """A learner, and what is tried of its settings."""

    make: Callable[[Swimming, Any, int], Learner]
    settings: Callable[..., Any]
    laws: Mapping[str, Any]


def log(low: float, high: float) -> dict[str, Any]:
    """Uniform in the logarithm."""
    return {"low": low, "high": high, "scale": "log"}


DISCOUNTS, WIDTHS = [0.3, 0.5, 1.0], [64, 96, 128]
OURS = Peer(
    Ours,
    OursSettings,
    {
        "trajectories": [256, 512, 1024], "steps": [15, 25, 40], "s_gamma": DISCOUNTS, "s_lambda": log(0.5, 4.0),
        "minibatch": [256, 512, 1024], "rate": log(1e-3, 4e-3), "half_life": [250.0, 500.0, 1000.0], "hidden": WIDTHS,
    },
)  # fmt: skip
PEERS: dict[Name, Peer] = {
    "ours": OURS,
    "ours-torch": OURS,
    "shac": Peer(
        Shac,
        ShacSettings,
        {
            "trajectories": [64, 128, 256], "horizon": [16, 32, 64], "hold": [1, 2, 4], "s_gamma": DISCOUNTS,
            "lam": [0.8, 0.9, 0.95], "actor_rate": log(1e-3, 1e-2), "critic_rate": log(5e-4, 5e-3),
            "decay": log(1e-4, 1e-2), "critic_passes": [2, 4, 8, 16], "log_spread": [-2.0, -1.0, 0.0],
            "hidden": WIDTHS, "unit": ["tanh", "elu"],
        },
    ),
    "apg": Peer(
        Apg,
        ApgSettings,
        {
            "trajectories": [32, 64, 128], "horizon": [40, 80, 150], "hold": [1, 2, 4], "s_gamma": DISCOUNTS,
            "rate": log(1e-3, 1e-2), "decay": log(1e-4, 1e-2), "log_spread": [-4.0, -2.0, -1.0], "hidden": WIDTHS,
            "unit": ["tanh", "elu"],
        },
    ),
    "cfvi": Peer(
        Cfvi,
        CfviSettings,
        {
            "trajectories": [256, 512, 1024], "steps": [25, 50, 100], "s_gamma": DISCOUNTS, "s_lambda": log(0.3, 4.0),
            "passes": [2, 4, 8, 16], "minibatch": [256, 512], "rate": log(3e-4, 3e-3), "decay": log(1e-4, 1e-1),
            "flips": [0.0, 0.05, 0.1], "hidden": WIDTHS,
        },
    ),
}  # fmt: skip


def tried(name: Name, samples: int) -> list[dict[str, Any]]:
    """The settings of the tuning: none, which is the best known, then draws."""
    return [{}, *random_search(PEERS[name].laws, samples - 1, seed=0)]


def read(out: Path) -> list[dict[str, str]]:
    """All rows so far; an empty table is made where there is none."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    with out.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def best(rows: Sequence[Mapping[str, str]], name: Name) -> tuple[int, dict[str, Any]]:
    """The sample that swam fastest at its last look in the tuning, and its settings."""
    if name == "ours-torch":
        sample, settings = best(rows, "ours")
        return sample, settings | {"engine": "torch"}
    last = {row["sample"]: row for row in rows if (row["stage"], row["algorithm"]) == ("tune", name)}
    if not last:
        raise SystemExit(f"{name} has not been tuned: run model_peers.py tune first")
    row = max(last.values(), key=lambda row: float(row["speed"]))
    return int(row["sample"]), json.loads(row["settings"])


def speed_of(policy: Callable[[Array], Array], hold: int) -> float:
    """On MuJoCo, m/s, of a policy in N m whose torques are held for so many control steps."""
    return swimming_speed(lambda states: policy(states) / PAPER.torque_limits, hold=hold).mean


def run(name: Name, settings: Mapping[str, Any], seed: int, seconds: float) -> list[tuple[Any, ...]]:
    """Learn for so much processor time: rows from ``cpu_seconds`` on, one a look."""
    peer = PEERS[name]
    chosen = peer.settings(**settings)
    problem = Swimming(s_gamma=chosen.s_gamma)
    peer.make(problem, chosen, seed).learn()  # what is compiled, is compiled now
    learner, rows, look = peer.make(problem, chosen, seed), [], FIRST_LOOK
    clock = Clock()
    while clock.read()[0] < seconds:
        learner.learn()
        if clock.read()[0] >= min(look, seconds):
            clock.stop()
            speed = speed_of(learner.policy(), learner.hold)
            spent = (f"{part:.1f}" for part in clock.before)
            rows.append((*spent, learner.simulation_steps, learner.gradient_evaluations, f"{speed:.4f}"))
            look *= GROWTH
            clock.start()
    Console().print(name, dict(settings), "seed", seed, ":", *rows[-1])
    return rows


def curves(out: Path = OUT) -> dict[str, list[Curve]]:
    """The looks of the final, by learner, seed by seed."""
    looks: dict[str, dict[str, list[tuple[float, ...]]]] = {}
    for row in read(out):
        if row["stage"] == "final":
            look = tuple(float(row[name]) for name in Curve._fields)
            looks.setdefault(row["algorithm"], {}).setdefault(row["seed"], []).append(look)
    order = [name for name in PEERS if name in looks]
    return {name: [Curve(*np.array(one).T) for one in looks[name].values()] for name in order}


def main(
    stage: tyro.conf.Positional[Literal["tune", "final", "draw"]],
    algorithms: Sequence[Name] = ("ours", "shac", "apg", "cfvi", "ours-torch"),
    samples: int = 8,
    seeds: Sequence[int] = tuple(range(10)),
    seconds: float | None = None,
    out: Path = OUT,
) -> None:
    """Tune, run the final, or draw it.

    Args:
        stage: Which.
        algorithms: Of whom.
        samples: Settings of each that are tried.
        seeds: Of the final.
        seconds: Processor time of each learner; by default 240 in the tuning, 600 in the final.
        out: CSV to append rows to, those of a learner when it is done.
    """
    if stage == "draw":
        save_figure(draw(curves(out)), PLOT)
        return
    torch.set_num_threads(1)
    seconds = seconds or {"tune": 240.0, "final": 600.0}[stage]
    for number in range(samples) if stage == "tune" else seeds:
        for name in algorithms:
            rows = read(out)
            if stage == "tune":
                if name == "ours-torch":
                    continue
                sample, settings, seed = number, tried(name, samples)[number], TUNING_SEED + number
            else:
                seed = number
                sample, settings = best(rows, name)
            key = (stage, name, str(sample), json.dumps(settings), str(seed))
            if any(tuple(row[column] for column in COLUMNS[:5]) == key for row in rows):
                continue
            looks = run(name, settings, seed, seconds)
            with out.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerows((*key, *look) for look in looks)


if __name__ == "__main__":
    tyro.cli(main)
