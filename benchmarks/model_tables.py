"""What value gradients make of MuJoCo models, in numbers, as ``docs_tables.py`` writes them into the pages."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.summaries import Summary
from swimmer_mj.learning.problems.mujoco.task import ADVICE

__all__ = [
    "any_model",
    "any_model_variants",
    "jacobian_cost",
    "linear_policies",
    "mean_words",
    "own_models",
    "published",
    "reacher_bound",
    "round_cost",
    "several_seeds",
    "swimmer_as_mjcf",
    "swimmer_coordinates",
    "task_settings",
    "td_on_mujoco",
]

RESULTS = Path(__file__).parent / "results"


def _rows(name: str) -> list[dict[str, str]]:
    with (RESULTS / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def published() -> dict[str, list[tuple[str, float]]]:
    """The best return of each learner that others have published, by task: (learner, mean return), the best first."""
    found: dict[str, dict[str, float]] = {}
    for row in _rows("published-returns.csv"):
        known = found.setdefault(row["task"], {})
        known[row["learner"]] = max(float(row["return"]), known.get(row["learner"], -np.inf))
    return {task: sorted(of.items(), key=lambda one: -one[1]) for task, of in found.items()}


def _kept(name: str) -> tuple[dict[str, list[float]], dict[str, float]]:
    """By task: each seed's return with what its best look kept, and the longest time that was looked after, s."""
    kept: dict[str, list[float]] = {}
    seconds: dict[str, float] = {}
    for row in _rows(name):
        if row["look"] == "best":
            kept.setdefault(row["task"], []).append(float(row["return_mean"]))
        else:
            seconds[row["task"]] = max(seconds.get(row["task"], 0.0), float(row["cpu_seconds"]))
    return kept, seconds


def fell_back(rows: Sequence[Mapping[str, str]], share: float = 0.1) -> dict[str, int]:
    """By task: how many seeds are at their last look more than a share of it below their best look."""
    looks: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if row["look"] != "best":
            looks.setdefault((row["task"], row["seed"]), []).append(float(row["return_mean"]))
    fallen: dict[str, int] = {}
    for (task, _), returns in looks.items():
        best = max(returns)
        fallen[task] = fallen.get(task, 0) + (returns[-1] < best - share * abs(best))
    return fallen


def mean_words(values: NDArray[np.float64], digits: str) -> str:
    """Mean and 95 % interval; of a few seeds, which have none to speak of, each."""
    if len(values) < 5:
        return ", ".join(f"{value:{digits}}" for value in values)
    return mean_and_interval_text(values, digits)


def any_model() -> Summary:
    """Return of what each seed's best look kept, in other episodes, beside what others have published."""
    kept, seconds = _kept("any-model.csv")
    nothing = {row["task"]: float(row["of_those_judged"]) for row in _rows("without-control.csv")}
    fallen = fell_back(_rows("any-model.csv"))
    others, rows = published(), []
    for task, returns in kept.items():
        values = np.array(returns)
        rivals = others.get(task, [])
        best = rivals[0][1] if rivals else np.nan
        bar = best - 0.05 * abs(best)
        reached = f"{(values >= bar).sum()} of {len(values)}" if rivals else "—"
        digits = ".0f" if abs(values).max() > 20 else ".1f"
        rows.append(
            (
                f"`{task}`",
                str(len(values)),
                f"{seconds[task]:.0f}",
                mean_words(values, digits),
                f"{values.min():{digits}}",
                f"{nothing[task]:{digits}}",
                ", ".join(f"{name} {value:{digits}}" for name, value in rivals) or "—",
                reached,
                str(fallen[task]),
            )
        )
    head = (
        "task",
        "seeds",
        "seconds of a core",
        "return",
        "worst seed",
        "without control",
        "listed",
        "seeds at 95 % of the best listed",
        "seeds 10 % below their best in the end",
    )
    return Summary("", head, rows)


def td_on_mujoco() -> Summary:
    """As :func:`any_model`, of TD(lambda), with the steps that it was given in all."""
    kept, seconds = _kept("td-on-mujoco.csv")
    looks = _rows("td-on-mujoco.csv")
    fallen, others, rows = fell_back(looks), published(), []
    gradients, _ = _kept("any-model.csv")
    for task, returns in kept.items():
        values = np.array(returns)
        steps = np.median(
            [int(row["simulation_steps"]) for row in looks if (row["task"], row["look"]) == (task, "best")]
        )
        rows.append(
            (
                f"`{task}`",
                str(len(values)),
                f"{seconds[task]:.0f}",
                f"{steps:,.0f}",
                mean_words(values, ".0f"),
                f"{values.min():.0f}",
                str(fallen[task]),
                f"{np.mean(gradients[task]):.0f}",
                ", ".join(f"{name} {value:.0f}" for name, value in others.get(task, [])) or "—",
            )
        )
    head = (
        "task",
        "seeds",
        "seconds of a core",
        "steps, median",
        "return",
        "worst seed",
        "seeds 10 % below their best in the end",
        "value gradients",
        "listed",
    )
    return Summary("", head, rows)


def any_model_variants() -> Summary:
    """Return of the last look at each seed, by task and settings."""
    looks: dict[tuple[str, str], dict[str, dict[str, str]]] = {}
    for row in _rows("any-model-variants.csv"):
        if row["look"] != "best":
            looks.setdefault((row["task"], row["settings"]), {})[row["seed"]] = row
    table = []
    for (task, settings), last in looks.items():
        values = np.array([float(row["return_mean"]) for row in last.values()])
        seconds = np.mean([float(row["cpu_seconds"]) for row in last.values()])
        each = ", ".join(f"{value:.0f}" for value in values)
        changed = ", ".join(f"`{one}`" for one in settings.split()) or "as `train`"
        table.append((f"`{task}`", changed, f"{seconds:.0f}", f"{values.mean():.0f}", each))
    head = ("task", "settings", "seconds of a core", "return of the last look", "each seed")
    return Summary("", head, table)


def round_cost() -> Summary:
    """What a round spends its time on."""
    found = json.loads((RESULTS / "round-cost.json").read_text(encoding="utf-8"))
    table = []
    for task, parts in found.items():
        states = parts.pop("states")
        whole = sum(parts.values())
        shares = (f"{100 * spent / whole:.0f} %" for spent in parts.values())
        table.append((f"`{task}`" if "/" in task else task, f"{states:,}", f"{whole:,.0f}", *shares))
    head = (
        "task",
        "states a round",
        "ms a round",
        "V and its slope",
        "choice of controls",
        "MuJoCo's steps",
        "reward and its slope",
        "costates",
        "fit",
    )
    return Summary("", head, table)


def task_settings() -> Summary:
    """How smooth each task is, and what its settings differ in from those that all tasks have."""
    table = []
    for row in _rows("task-settings.csv"):
        known = ADVICE | {"dt": float(row["control_timestep"])}
        changed = {
            name: value
            for name, value in json.loads(row["settings"]).items()
            if known.get(name, ...) != value
        }
        words = ", ".join(f"`{name}={json.dumps(value)}`" for name, value in changed.items()).replace(" ", "")
        share = f"{100 * float(row['constrained_share']):.0f} %"
        table.append(
            (
                f"`{row['task']}`",
                share,
                row["control_timestep"],
                row["s_gamma"],
                words.replace(",`", ", `") or "-",
            )
        )
    head = ("task", "states with an active constraint", "control step, s", "s_gamma, 1/s", "other settings")
    return Summary("", head, table)


def own_models() -> Summary:
    """By model and processor time: share of episodes that end at the goal, mean over seeds and the worst; distance."""
    rows = _rows("own-models.csv")
    head = ("model", "seeds", "seconds of a core", "episodes that end at the goal, %", "worst seed")
    share = _by_time(rows, "model", lambda row: 100 * float(row["at_the_goal_share"]), head)
    away = _by_time(rows, "model", lambda row: float(row["distance_mean"]), head, ".2f")
    both = [(*row, other[3]) for row, other in zip(share.rows, away.rows, strict=True)]
    return Summary("", (*head, "from the goal in the last second, m"), both)


def swimmer_as_mjcf() -> Summary:
    """Swimming speed of the paper's swimmer as MJCF, by friction and processor time."""
    return _by_time(
        _rows("swimmer-as-mjcf.csv"),
        "algorithm",
        lambda row: float(row["speed"]),
        ("swim5 as MJCF", "seeds", "seconds of a core", "speed, m/s", "worst seed"),
        ".2f",
    )


def swimmer_coordinates() -> Summary:
    """Steady speed of value gradients by coordinates, torques and processor time."""
    return _by_time(
        _rows("swimmer-coordinates.csv"),
        "name",
        lambda row: float(row["steady_speed"]),
        ("V of, torques", "seeds", "seconds of a core", "steady speed, m/s", "worst seed"),
        ".2f",
    )


def solid_links() -> Summary:
    """Speeds of what was learned with links that pass through each other, and with solid ones, in both."""
    rows, table = _rows("solid-links.csv"), []
    for learned in dict.fromkeys(row["learned"] for row in rows):
        mine = [row for row in rows if row["learned"] == learned]
        cells = []
        for place in ("passing", "solid"):
            there = [row for row in mine if row["swims"] == place]
            cells.append(", ".join(f"{float(row['speed']):.2f}" for row in there))
            cells.append(", ".join(f"{100 * float(row['touching']):.0f}" for row in there))
        table.append((learned, str(len({row["seed"] for row in mine})), *cells))
    head = ("learned with links that are", "seeds", "among passing links, m/s", "% of the time touching",
            "among solid links, m/s", "% of the time touching")  # fmt: skip
    return Summary("", head, table)


def _of_the_gait(rows: Sequence[Mapping[str, str]], name: str, speed: float) -> str:
    """Speeds against a pull over that of the gait which swims against it, %."""
    shares = 100 * np.array([float(row[name]) for row in rows]) / speed
    return f"{mean_and_interval_text(shares, '.0f')}; {shares.min():.0f}"


def several_seeds() -> Summary:
    """Four learners of which the faster go on, ten times."""
    rows = _rows("several-seeds.csv")
    found: list[tuple[str, ...]] = []
    for links in sorted({row["links"] for row in rows}):
        times = [row for row in rows if row["links"] == links]
        steady = np.array([float(row["steady_speed"]) for row in times])
        shares = (
            _of_the_gait(times, name, speed) for name, speed in (("against_2", 2.0), ("against_3", 3.0))
        )
        folded = sum(float(row["folded"]) > 0.5 for row in times)
        found.append(
            (
                links,
                str(len(times)),
                f"{times[0]['seconds']} s, {times[0]['cores']} cores",
                mean_and_interval_text(steady, ".2f"),
                f"{steady.min():.2f}",
                f"{np.count_nonzero(steady >= 2.6)}",
                f"{np.count_nonzero(steady >= 3.0)}",
                *shares,
                f"{folded}",
            )
        )
    head = (
        "links",
        "times",
        "in",
        "steady speed, m/s",
        "slowest",
        "of 2.6 m/s or more",
        "of 3.0 m/s or more",
        "of the best gait of 2 m/s, %; slowest",
        "of that of 3 m/s, %; slowest",
        "folded",
    )
    return Summary("", head, found)


def _by_time(
    rows: list[dict[str, str]],
    name: str,
    number: Callable[[dict[str, str]], float],
    head: tuple[str, ...],
    digits: str = ".0f",
) -> Summary:
    """A row for each name and time of a look: looks come a little late, so that times are told apart by their order."""
    looks: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        looks.setdefault((row[name], row["seed"]), []).append(row)
    columns: dict[tuple[str, int], list[dict[str, str]]] = {}
    for (who, _), mine in looks.items():
        for k, row in enumerate(mine):
            columns.setdefault((who, k), []).append(row)
    table = []
    for (who, _), mine in sorted(columns.items(), key=lambda item: item[0]):
        values = np.array([number(row) for row in mine])
        seconds = np.mean([float(row["cpu_seconds"]) for row in mine])
        worst = f"{values.min():{digits}}"
        spent = f"{seconds:.0f}" if seconds >= 4.5 else f"{seconds:.1f}"
        table.append((who, str(len(mine)), spent, mean_and_interval_text(values, digits), worst))
    return Summary("", head, table)


def linear_policies() -> Summary:
    """Return of linear feedbacks in thirty episodes that they were not searched in, by task."""
    kept, seconds = _kept("linear-policies.csv")
    head = ("task, by a linear feedback", "seeds", "seconds of a core", "return", "worst seed")
    rows = [
        (
            f"`{task}`",
            str(len(returns)),
            f"{seconds[task]:.0f}",
            mean_and_interval_text(np.array(returns), ".0f"),
            f"{min(returns):.0f}",
        )
        for task, returns in kept.items()
    ]
    return Summary("", head, rows)


def reacher_bound() -> Summary:
    """Mean return in thirty episodes: of learned policies and of plans that know the start."""
    rows = _rows("reacher-bound.csv")
    learned, planned = (np.mean([float(row[name]) for row in rows]) for name in ("learned", "planned"))
    best = published()["gymnasium/Reacher-v5"][0]
    head = ("Reacher-v5, thirty episodes", "mean return")
    return Summary(
        "",
        head,
        [
            ("the best of three policies in each episode", f"{learned:.2f}"),
            ("the best plan found for it, from its known start", f"{planned:.2f}"),
            (f"published: {best[0]}, an older version", f"{best[1]:.2f}"),
        ],
    )


def jacobian_cost() -> Summary:
    """Rates of MuJoCo's steps and of states that are pulled back, by degrees of freedom."""
    found = json.loads((RESULTS / "jacobian-cost.json").read_text(encoding="utf-8"))
    head = (
        "degrees of freedom",
        "mj_step /s",
        "implicit mj_step /s",
        "states with Jacobian /s, 1 thread",
        "2 threads",
        "implicit steps a state",
    )
    rows = [
        (
            str(row["degrees"]),
            f"{row['mj_step']:,.0f}",
            f"{row['implicit_step']:,.0f}",
            f"{row['pull_back_1']:,.0f}",
            f"{row['pull_back_2']:,.0f}",
            f"{row['implicit_step'] / row['pull_back_1']:.1f}",
        )
        for row in found["rows"]
    ]
    return Summary("", head, rows)
