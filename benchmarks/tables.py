"""The results of the benchmarks in numbers, as ``docs_tables.py`` writes them into the pages."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import compare_learners
import numpy as np
import robustness
from compare_learners import Curve, reached
from numpy.typing import NDArray
from open_loop_wave import OUT as WAVE_LOG
from planners import OUT as PLANNERS_LOG

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.long_runs import SWIMMERS
from swimmer_mj.learning.experiments.made import ways
from swimmer_mj.learning.experiments.summaries import Summary
from swimmer_mj.learning.experiments.tables import LOGS, read_table

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
SPEED = RESULTS / "learning-speed.json"
PLATFORMS_LOG = RESULTS / "platforms.csv"
KILLED_NODE = RESULTS / "killed-node.log"
START_UP = RESULTS / "start-up.json"
PLANNER_NAMES = {"ilqr": "iLQR", "ddp": "DDP", "mppi": "MPPI"}
PAPER_RATE = 2.5e6 * 500 / (7 * 86400)  # steps/s: 2.5 million trials in a week


# Learners beside each other ---------------------------------------------------------------------------------------


def within(curve: Curve, seconds: float) -> Curve:
    """What was seen of a learner in its first seconds; a look may come a little late."""
    seen = curve.cpu_seconds <= 1.02 * seconds
    return Curve(*(column[seen] for column in curve))


def budget(curves: Sequence[Curve]) -> float:
    """Processor time that all of them had, s."""
    return min(curve.cpu_seconds[-1] for curve in curves)


def last_windows(curves: Sequence[Curve]) -> NDArray[np.float64]:
    """Of each learner the mean of its looks in the second half of the time that all of them had, m/s."""
    half = budget(curves) / 2
    return np.array([curve.speed[curve.cpu_seconds >= half].mean() for curve in curves])


def time_words(curves: Sequence[Curve], speed: float) -> str:
    """Median over seeds; mean where all got there, else how many did."""
    what = reached(curves, speed, "cpu_seconds")
    there = int(np.isfinite(what.spent).sum())
    if not there:
        return "none"
    digits = ".1f" if what.median < 10 else ".0f"
    median = f"{'' if what.known else '> '}{what.median:{digits}}"
    if there < len(curves):
        return f"{median}; {there} seed{'s' * (there > 1)}"
    return f"{median}; {mean_and_interval_text(what.spent, digits)}"


def learners() -> Summary:
    """Processor time to each speed, and the last window, in the time that all seeds of a learner had."""
    rows = []
    for name, curves in compare_learners.read(compare_learners.RESULTS).items():
        equal = [within(curve, budget(curves)) for curve in curves]
        last = mean_and_interval_text(last_windows(equal))
        times = (time_words(equal, speed) for speed in compare_learners.SPEEDS)
        label = "TD(λ), η = 0.16" if name == "td" else compare_learners.NAMES[name]
        rows.append((label, str(len(curves)), f"{budget(curves):.0f}", *times, last))
    speeds = (f"{speed} m/s" for speed in compare_learners.SPEEDS)
    return Summary("", ("learner", "seeds", "seconds for each", *speeds, "second half, m/s"), rows)


def deepest_fall(curve: Curve) -> str:
    """Where a learner was furthest below its best until then."""
    best = np.maximum.accumulate(curve.speed)
    at = int(np.argmax(best - curve.speed))
    return f"{best[at]:.2f} to {curve.speed[at]:.2f}, at {curve.cpu_seconds[at]:.1f} s"


def value_gradient_seeds() -> Summary:
    """Value gradients, seed by seed: seconds and millions of steps until a speed is first seen."""
    speeds = (1.0, 1.5, 1.8, 2.0)
    rows = []
    for seed, curve in enumerate(compare_learners.read(compare_learners.RESULTS)["value-gradient"]):
        cells = []
        for speed in speeds:
            fast = curve.speed >= speed
            at = int(np.argmax(fast))
            sign = "≤ " if at == 0 else ""
            steps = curve.simulation_steps[at] / 1e6
            cells.append(f"{sign}{curve.cpu_seconds[at]:.1f} s, {steps:.2f}" if fast.any() else "none")
        ends = f"{curve.speed.max():.2f}", f"{curve.speed[-1]:.2f}"
        rows.append((str(seed), *cells, *ends, deepest_fall(curve)))
    header = (
        *(f"{speed} m/s" for speed in speeds),
        "best, m/s",
        "last, m/s",
        "deepest fall from the best so far, m/s",
    )
    return Summary("", ("seed", *header), rows)


def changed_swimmers() -> Summary:
    """Policies in simulations that they were not learned in."""
    looks = robustness.read(robustness.OUT)
    own = {seed: speed for seed, change, speed in looks if change == "none"}
    rows = []
    for change in dict.fromkeys(change for _, change, _ in looks):
        of_seed = {seed: speed for seed, what, speed in looks if what == change}
        shares = np.array([speed / own[seed] for seed, speed in of_seed.items()])
        speed = mean_and_interval_text(np.array([*of_seed.values()]))
        label = (
            "nothing"
            if change == "none"
            else change.replace(" up", " 10 % up").replace(" down", " 10 % down")
        )
        rows.append((label, speed, f"{shares.mean():.3f}", f"{shares.min():.3f}"))
    return Summary("", ("changed", "m/s", "share of its own speed", "of the worst seed"), rows)


# Policies ---------------------------------------------------------------------------------------------------------


def policies() -> Summary:
    """The shipped policies by all measures."""
    table = read_table(RESULTS / "policies.csv")
    rows = [
        (f"`{name}`", *(f"{table[measure][i]:.2f}" for measure in ("speed", "steady_speed", "first_5s_speed")),
         f"{table['discounted_return'][i]:.2f}", f"{table['s_gamma'][i]:g}", f"{table['seed'][i]:.0f}",
         f"{table['trials'][i]:,.0f}")
        for i, name in enumerate(table["policy"].tolist())
    ]  # fmt: skip
    header = (
        "policy",
        "swimming speed, m/s",
        "steady speed, m/s",
        "first 5 s, m/s",
        "discounted return, m",
        "s_gamma, 1/s",
        "seed",
        "trials",
    )
    return Summary("", header, rows)


def coverage() -> Summary:
    """Of the mean, by three kinds of intervals."""
    table = read_table(RESULTS / "interval-coverage.csv")
    kinds = "t", "percentile", "bca"
    rows = [
        (str(law), f"{table['n'][i]:.0f}", *(f"{table[kind][i]:.3f}" for kind in kinds))
        for i, law in enumerate(table["law"].tolist())
    ]
    return Summary(
        "", ("law of the values", "n", "Student's t", "bootstrap, percentile", "bootstrap, BCa"), rows
    )


# Steps per second -------------------------------------------------------------------------------------------------

ENGINES = {
    "mj_step": "bare `mj_step` (Euler, no friction)",
    "mj_step_viscous": "`mj_step` with the compiled friction",
    "reference": "torch reference",
    "fused": "fused, one learner, one core",
    "fused_all_cores": "fused, a learner on each of 2 cores",
    "population": "population, 16 learners, one core",
    "population_all_cores": "population, 16 learners on each of 2 cores",
}


def thousands(rate: float) -> str:
    """Rounded to a thousand where there are many."""
    return f"{round(rate, -3):,.0f}" if rate >= 1e4 else f"{rate:,.0f}"


def speeds() -> dict[str, Any]:
    """What ``learning_speed.py`` measured."""
    return json.loads(SPEED.read_text(encoding="utf-8"))


def engines() -> Summary:
    """Steps per second, 5 links, 60 neurons."""
    rates = speeds()["engines"]
    bare = rates["mj_step"]
    rows = [(label, thousands(rates[name]), f"{rates[name] / bare:.2g}") for name, label in ENGINES.items()]
    rows.append(("the paper: 2.5 million trials of 500 in one week", f"{PAPER_RATE:,.0f}", "-"))
    return Summary("", ("what", "steps/s", "per bare `mj_step`"), rows)


def against(what: str) -> Summary:
    """Steps per second with more neurons or links."""
    data = speeds()
    rows = []
    for count, rates in data[what].items():
        bare = rates.get("mj_step", data["engines"]["mj_step"])
        cells = (f"{thousands(rates[name])} ({rates[name] / bare:.2g})" for name in ("fused", "population"))
        rows.append((count, thousands(bare), *cells))
    return Summary("", (what, "`mj_step`", "fused", "population"), rows)


PARTS: dict[str, Mapping[str, str]] = {
    "fused": {
        "dynamics": "dynamics: drift and control matrix",
        "forward": "forward, with its part of the update",
        "backward": "backward, with its part of the update",
        "rest": "control, H, state, statistics, trial's ends",
        "step": "**step**",
        "chain of tanh": "for comparison: the chain of tanh alone",
        "forward alone": "for comparison: forward without the update",
        "backward alone": "for comparison: backward without the update",
        "update alone": "for comparison: the update as a pass of its own",
    },
    "population": {
        "dynamics": "dynamics and control",
        "forward": "forward, with the update",
        "backward": "backward",
        "rest": "inputs, slopes, H, state, statistics, packing, unpacking",
        "step": "**step**",
        "forward alone": "for comparison: forward without the update",
    },
}


def parts(engine: str) -> Summary:
    """Where the time of a step goes."""
    times = speeds()["parts"][engine]
    if times.keys() != PARTS[engine].keys():
        raise ValueError(f"the parts of {engine} are {', '.join(times)}")
    rows = [(label, f"{times[name]:.2f}") for name, label in PARTS[engine].items()]
    return Summary("", ("part of a step of one learner", "µs"), rows)


def memory() -> Summary:
    """Weights and traces."""
    rows = [
        (count, *(f"{row[name]:,.0f}" for name in ("connections", "fused", "population")))
        for count, row in speeds()["memory_KiB"].items()
    ]
    return Summary("", ("neurons", "connections", "fused", "population, 16 learners"), rows)


def devices() -> Summary:
    """Rounds of value gradients in a second, by engine and device."""
    table = read_table(RESULTS / "devices.csv")
    rows = [
        (f"{table['engine'][i]}, {table['dtype'][i]}", str(table["device"][i]), f"{n:.0f}", f"{rate:.1f}")
        for i, (n, rate) in enumerate(zip(table["trajectories"], table["rounds_per_second"], strict=True))
    ]
    return Summary("", ("engine, network", "device", "trajectories", "rounds/s"), rows)


def device_speeds() -> Summary:
    """What was learned in the same time, by device."""
    table = read_table(RESULTS / "device-speeds.csv")
    rows = [
        (str(device), *(f"{speed:.2f}" for speed in table["speed"][table["device"] == device]))
        for device in dict.fromkeys(table["device"])
    ]
    return Summary("", ("device", *(f"seed {s:.0f}" for s in dict.fromkeys(table["seed"]))), rows)


def cluster_scale() -> Summary:
    """What the coordinator of a sweep on a Ray cluster has to do, by the number of nodes."""
    measured = json.loads((RESULTS / "cluster-scale.json").read_text(encoding="utf-8"))
    services = "Ray's services: s a task"
    rows = [
        (
            thousands(row["nodes"]),
            thousands(row["nodes"] * measured["pack"]["runs in a pack"]),
            f"{1e3 * row['driver: s a task']:.1f}",
            f"{1e3 * row[services]:.1f}",
            f"{100 * row['driver: share of a core while it waits']:.1f}",
        )
        for row in measured["coordinator"]
    ]
    header = (
        "nodes",
        "runs at a time",
        "driver, ms a task",
        "Ray's services, ms a task",
        "driver while it waits, % of a core",
    )
    return Summary("", header, rows)


def run_cost() -> Summary:
    """What a run of the paper's learner costs in a pack, and leaves."""
    measured = json.loads((RESULTS / "cluster-scale.json").read_text(encoding="utf-8"))
    pack = measured["pack"]
    rows = [
        ("runs a core-hour, of 100,000 trials", f"{3600 / pack['s a run']:.0f}"),
        ("bytes a run on disk", thousands(pack["bytes a run"])),
        ("files a run", f"{pack['files a run']:.0f}"),
        (
            "looking at a run, at the beginning and the end of a sweep, ms",
            f"{1e3 * pack['s to look at a run']:.0f}",
        ),
        ("bytes to a task, of 16 runs", thousands(measured["bytes to a task"])),
        ("bytes back", thousands(measured["bytes from a task"])),
    ]
    return Summary("", ("what", "value"), rows)


def open_loop_wave() -> Summary:
    """The best wave that looks at nothing."""
    with WAVE_LOG.open(newline="", encoding="utf-8") as file:
        rows = [
            (row["links"], *(f"{float(row[name]):.2f}" for name in ("speed_on_mujoco", "period", "lag")))
            for row in csv.DictReader(file)
        ]
    return Summary("", ("links", "speed, m/s", "period, s", "lag, rad"), rows)


def logs_made() -> Summary:
    """Every committed log: by which commands, at which commits, with which seeds."""
    rows = []
    for folder in (RESULTS, LOGS):
        place = folder.relative_to(ROOT)
        for log, found in sorted(ways(folder).items()):
            commands = "; ".join(dict.fromkeys(f"`{way['command']}`" for way in found))
            commits = ", ".join(dict.fromkeys(way["commit"] for way in found))
            rows.append((f"`{place}/{log}`", commands, commits, seeds_of(folder / log)))
    return Summary("", ("log", "made by", "commit", "seeds"), rows)


def seeds_of(log: Path) -> str:
    """Those in a log, in ranges; nothing if it has no such column."""
    if log.suffix != ".csv":
        return ""
    with log.open(newline="", encoding="utf-8") as file:
        seeds = sorted({int(row["seed"]) for row in csv.DictReader(file) if row.get("seed")})
    ranges: list[list[int]] = []
    for seed in seeds:
        if ranges and seed == ranges[-1][-1] + 1:
            ranges[-1].append(seed)
        else:
            ranges.append([seed])
    return ", ".join(f"{some[0]} to {some[-1]}" if len(some) > 1 else f"{some[0]}" for some in ranges)


def platforms() -> Summary:
    """Where the tests were run, and what came of it."""
    names = ("python", "mujoco", "dm-control", "numpy", "torch", "numba", "dependencies")
    table = []
    with PLATFORMS_LOG.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            system = f"{row['system'].removeprefix('Debian GNU/Linux ')}, {row['processor']}"
            few = row["tests"].split()
            which = few[0] if len(few) == 1 else f"{len(few)} files"
            counts = (row[name] for name in ("passed", "failed", "skipped", "seconds"))
            table.append((system, *(row[name] for name in names), which, *counts))
    head = ("Debian", "Python", "MuJoCo", "dm_control", "NumPy", "torch", "numba", "dependencies", "tests", "passed",
            "failed", "skipped", "s")  # fmt: skip
    return Summary("", head, table)


def start_up() -> Summary:
    """How long it takes to begin, and the package's size."""
    found = json.loads(START_UP.read_text(encoding="utf-8"))
    rows = [(f"`{name}`, ms", f"{1000 * value:.0f}") for name, value in found["seconds"].items()]
    rows.append(
        ("the package on disk, without its dependencies, MB", f"{found['installed_bytes'] / 1e6:.1f}")
    )
    return Summary("", ("what", "value"), rows)


def killed_node() -> str:
    """The log of a sweep that lost a node, as it was printed."""
    return f"```\n{KILLED_NODE.read_text(encoding='utf-8')}```\n"


def planners() -> Summary:
    """Planners without learning: how fast, and at what price."""
    with PLANNERS_LOG.open(newline="", encoding="utf-8") as file:
        rows, tuned = list(csv.DictReader(file)), {}
    for row in rows:
        if row["stage"] == "tune":
            tuned.setdefault(row["planner"], []).append(f"{float(row['10_to_20s']):.2f}")
    table = []
    for row in rows:
        if row["stage"] == "final":
            chosen = ", ".join(f"{key} {short(value)}" for key, value in json.loads(row["settings"]).items())
            speeds = (f"{float(row[window]):.2f}" for window in ("first_5s", "10_to_20s", "30_to_60s"))
            price = f"{float(row['ms_a_control_step']):.1f}"
            tries = ", ".join(tuned[row["planner"]])
            table.append((PLANNER_NAMES[row["planner"]], tries, chosen or "the best known", price, *speeds))
    head = ("planner", "settings tried, m/s", "into the final", "ms a control step", "first 5 s, m/s", "10 to 20 s",
            "30 to 60 s")  # fmt: skip
    return Summary("", head, table)


def short(value: float | str) -> str:
    """Three digits of a number."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def long_runs(logs: Path) -> Summary:
    """How long the long runs took."""
    rows = []
    for name, swimmer in SWIMMERS.items():
        table, size = read_table(logs / f"{name}.csv"), f"{swimmer.links}, {swimmer.neurons}"
        for preset, eta in swimmer.etas.items():
            of_preset = table["preset"] == preset
            seeds = len(np.unique(table["seed"][of_preset]))
            trials, hours = table["trial"][of_preset].max(), table["seconds"][of_preset].max() / 3600
            rows.append((f"`{name}.csv`", size, f"{eta:g}", str(seeds), f"{trials:,.0f}", f"{hours:.1f}"))
    return Summary(
        "", ("log", "links, neurons", "η", "learners", "trials of each", "hours of the pack"), rows
    )
