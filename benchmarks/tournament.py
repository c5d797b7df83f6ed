"""Learners beside each other: value gradients, those that are given the model too, and those that are not.

    python benchmarks/tournament.py tune   # some settings of each around the best known, on seeds of their own
    python benchmarks/tournament.py final  # the best of them, on fresh seeds
    python benchmarks/tournament.py start  # their first ten seconds once more, looked at more closely
    python benchmarks/tournament.py all    # one after the other, some twenty hours of a core

All add rows to benchmarks/results/tournament.csv, one for each look at a learner; what is there already is
not done again. SHAC, APG and cFVI run on the compiled equations that value gradients use, PPO, SAC and TD3 of
Stable-Baselines3 (extra ``peers``) on MuJoCo. The clock is the processor time of one core, evaluation not counted: the
same for all, as is the number of settings that are tried. The first setting is the best known, the others are drawn
around it; the one that swims fastest in the last window, the second half of its time, goes into the final. A look of
the final is 40 % later than the one before, one of the start 20 %: the same seeds learn the same there.
``ours-torch`` is value gradients without compiled code, by the same settings, and ``ours-thrifty`` simulates less and
learns more from it: that was chosen after the final, on other seeds. ``tournament_results.py`` draws what came of it.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from peers.apg import Apg, ApgSettings
from peers.cfvi import Cfvi, CfviSettings
from peers.ours import Ours, OursSettings
from peers.sb3 import OffPolicySettings, PpoSettings, Td3Settings, ppo, sac, td3
from peers.shac import Shac, ShacSettings
from rich.console import Console
from yardstick import Clock, swimming_speeds

from swimmer_mj import __version__
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import SPEED, STEADY
from swimmer_mj.learning.runs.sweep import random_search
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parent / "results" / "tournament.csv"
COLUMNS = (
    "stage", "algorithm", "sample", "settings", "seed", "version", "given", "cpu_seconds", "wall_seconds",
    "simulation_steps", "gradient_evaluations", "speed", "steady_speed",
)  # fmt: skip
Stage = Literal["tune", "final", "start"]
Name = Literal["ours", "ours-torch", "ours-thrifty", "shac", "apg", "cfvi", "ppo", "sac", "td3"]
TUNING_SEED = 1000
"""Seeds from here on are for tuning alone."""
FINAL_SEEDS = tuple(range(300, 310))
"""Which no setting of any learner was chosen on."""
OTHER_SEEDS: Mapping[Name, tuple[int, ...]] = {"ours-thrifty": tuple(range(310, 320))}
"""Of a learner that was made after the others had shown what they come to with those."""
CLOSER: tuple[Name, ...] = ("ours", "ours-thrifty", "shac", "apg")
"""Those that are fast within seconds, whose start is looked at."""


class Looking(NamedTuple):
    """When a learner is looked at."""

    seconds: float
    """Processor time that it has."""
    first: float
    """s."""
    growth: float
    """Of the time from look to look."""


STAGES: Mapping[Stage, Looking] = {
    "tune": Looking(240.0, 1.0, 1.4),
    "final": Looking(600.0, 1.0, 1.4),
    "start": Looking(10.0, 0.3, 1.2),
}
WINDOW = 0.5
"""The last window begins at this share of the time. There steady speeds are looked at too."""
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
LONGER, HOLDS = [0.03, 0.1, 0.3, 0.5, 1.0], [2, 5, 10]
OFF_POLICY: dict[str, Any] = {
    "s_gamma": LONGER, "hold": HOLDS, "hidden": [128, 256], "n_envs": [4, 8, 16], "gradient_steps": [1, 2, 4, 8],
    "batch_size": [128, 256, 512], "learning_rate": log(3e-4, 2e-3), "tau": [0.005, 0.01, 0.02],
}  # fmt: skip
OURS = Peer(
    Ours,
    OursSettings,
    {
        "form": ["state, instant", "joints, held"], "trajectories": [256, 512, 1024], "steps": [15, 25, 40],
        "s_gamma": DISCOUNTS, "s_lambda": log(0.5, 4.0), "minibatch": [256, 512, 1024], "rate": log(1e-3, 4e-3),
        "half_life": [250.0, 500.0, 1000.0], "huber": [0.5, 1.0, 2.0], "hidden": WIDTHS,
    },
)  # fmt: skip
PEERS: dict[Name, Peer] = {
    "ours": OURS,
    "ours-torch": OURS,
    "ours-thrifty": OURS,
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
    "ppo": Peer(
        ppo,
        PpoSettings,
        {
            "s_gamma": LONGER, "hold": HOLDS, "hidden": [64, 128, 256], "n_envs": [16, 32, 64],
            "n_steps": [32, 64, 128], "batch_size": [256, 512, 1024], "n_epochs": [5, 10, 20],
            "learning_rate": log(1e-4, 1e-3), "gae_lambda": [0.9, 0.95, 0.98], "clip_range": [0.1, 0.2, 0.3],
            "unit": ["tanh", "relu"],
        },
    ),
    "sac": Peer(sac, OffPolicySettings, OFF_POLICY),
    "td3": Peer(td3, Td3Settings, OFF_POLICY | {"noise": [0.05, 0.1, 0.2, 0.3]}),
}  # fmt: skip

LIKE_OURS: Mapping[Name, Mapping[str, Any]] = {
    "ours-torch": {"engine": "torch"},
    "ours-thrifty": {"trajectories": 64, "passes": 2, "half_life": 4000.0},
}
"""Those that are not tuned themselves, but learn by the settings of value gradients except for these."""


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


def last_window(rows: Iterable[Mapping[str, str]]) -> float:
    """Mean speed of the looks at one learner in its last window, m/s."""
    return float(
        np.mean(
            [float(row["speed"]) for row in rows if float(row["cpu_seconds"]) >= WINDOW * float(row["given"])]
        )
    )


def tuned(rows: Sequence[Mapping[str, str]], name: Name) -> dict[int, tuple[float, dict[str, Any]]]:
    """By sample of the tuning: how fast it swam in the last window, and its settings."""
    looks: dict[int, list[Mapping[str, str]]] = {}
    for row in rows:
        if (row["stage"], row["algorithm"]) == ("tune", name):
            looks.setdefault(int(row["sample"]), []).append(row)
    return {sample: (last_window(some), json.loads(some[0]["settings"])) for sample, some in looks.items()}


def best(rows: Sequence[Mapping[str, str]], name: Name) -> tuple[int, dict[str, Any]]:
    """The sample that swam fastest in the tuning, and its settings."""
    if name in LIKE_OURS:
        sample, settings = best(rows, "ours")
        return sample, settings | LIKE_OURS[name]
    samples = tuned(rows, name)
    if not samples:
        raise SystemExit(f"{name} has not been tuned: run tournament.py tune first")
    sample = max(samples, key=lambda sample: samples[sample][0])
    return sample, samples[sample][1]


def speeds_of(policy: Callable[[Array], Array], hold: int, steady: bool) -> tuple[str, str]:
    """On MuJoCo, m/s, of a policy in N m whose torques are held for so many control steps: after 10 to 20 s, steady."""
    spans = (SPEED, STEADY) if steady else (SPEED,)
    found = swimming_speeds(lambda states: policy(states) / PAPER.torque_limits, spans, hold=hold)
    speed, *more = (f"{one.mean:.4f}" for one in found)
    return speed, more[0] if steady else ""


def run(name: Name, settings: Mapping[str, Any], seed: int, looking: Looking) -> list[tuple[Any, ...]]:
    """Learn for so much processor time: rows from ``given`` on, one a look."""
    seconds, look, growth = looking
    peer = PEERS[name]
    chosen = peer.settings(**settings)
    problem = Swimming(s_gamma=chosen.s_gamma)
    peer.make(problem, chosen, seed).learn()  # what is compiled, is compiled now
    learner, rows = peer.make(problem, chosen, seed), []
    clock = Clock()
    while clock.read()[0] < seconds:
        learner.learn()
        if clock.read()[0] >= min(look, seconds):
            clock.stop()
            spent = clock.before
            speeds = speeds_of(learner.policy(), learner.hold, spent[0] >= WINDOW * seconds)
            counts = (learner.simulation_steps, learner.gradient_evaluations)
            rows.append((f"{seconds:g}", *map("{:.2f}".format, spent), *counts, *speeds))
            look *= growth
            clock.start()
    Console().print(name, json.dumps(settings), "seed", seed, ":", *rows[-1])
    return rows


def entries(
    stage: Stage, algorithms: Sequence[Name] | None, samples: int, seeds: Sequence[int] | None
) -> list[tuple[Name, int]]:
    """Who takes part in a stage, with which sample of the tuning or which seed, in turns."""
    if stage == "tune":
        names = [name for name in algorithms or PEERS if name not in LIKE_OURS]
        return [(name, sample) for sample in range(samples) for name in names]
    names = algorithms or (CLOSER if stage == "start" else tuple(PEERS))
    columns = [[(name, seed) for seed in seeds or OTHER_SEEDS.get(name, FINAL_SEEDS)] for name in names]
    return [entry for row in zip(*columns, strict=True) for entry in row]


def main(
    stage: tyro.conf.Positional[Stage | Literal["all"]],
    algorithms: Sequence[Name] | None = None,
    samples: int = 8,
    seeds: Sequence[int] | None = None,
    seconds: float | None = None,
    out: Path = OUT,
) -> None:
    """Tune, or run the final or its start, or all of them.

    Args:
        stage: Which.
        algorithms: Of whom; by default of all, at the start of those that are fast within seconds.
        samples: Settings of each that are tried.
        seeds: Of the final and its start; by default ten, 300 to 309 but for who came later.
        seconds: Processor time of each learner; by default 240 in the tuning, 10 at the start, 600 in the final.
        out: CSV to append rows to, those of a learner when it is done.
    """
    torch.set_num_threads(1)
    if stage == "all":
        for one in STAGES:
            main(one, algorithms, samples, seeds, seconds, out)
        return
    looking = STAGES[stage] if seconds is None else STAGES[stage]._replace(seconds=seconds)
    for name, number in entries(stage, algorithms, samples, seeds):
        rows = read(out)
        if stage == "tune":
            sample, chosen, seed = number, tried(name, samples)[number], TUNING_SEED + number
        else:
            seed = number
            sample, chosen = best(rows, name)
        settings = asdict(PEERS[name].settings(**chosen))
        key = (stage, name, str(sample), json.dumps(settings), str(seed))
        if any(tuple(row[column] for column in COLUMNS[:5]) == key for row in rows):
            continue
        looks = run(name, settings, seed, looking)
        with out.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows((*key, __version__, *look) for look in looks)
        note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
