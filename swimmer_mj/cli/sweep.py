"""``sweep``: a grid or a random search over any settings, and seeds, from one file."""

from __future__ import annotations

import dataclasses
import json as json_module
import re
import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import check_directory, trust_modules
from swimmer_mj.cli.output import make_console, print_json, print_line
from swimmer_mj.cli.signals import StoppedError, asked_to_stop
from swimmer_mj.cli.training import OPTIONS, changed, configured, parse_seeds, train, without_warnings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from swimmer_mj.learning.runs.jobs import Engine, Job, News

__all__ = ["TABLE", "read_jobs", "sweep"]

TABLE, PICTURE, SCRIPT = "sweep.csv", "sweep.png", "sweep.sbatch"
MOST_JOBS = 10_000
KEYS = ("problem", "method", "trials", "seeds", "evaluate_every", "set", "grid", "random")


@without_warnings()
def sweep(
    file: Positional[Path],
    out: Path,
    engine: Literal["local", "ray", "slurm"] = "local",
    address: str | None = None,
    parts: int | None = None,
    part: str | None = None,
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Train a run for each combination of settings and seeds that a file asks for, on all cores.

    Each has a directory in --out, and a row in its sweep.csv: settings, trials, seconds, speed. The same command goes
    on where it stopped. docs/sweeps.md has the form of the file.

    Args:
        file: What to run, as TOML.
        out: Directory of the runs, the table and a picture of it.
        engine: Where they run: local is this machine, ray a Ray cluster; slurm writes the script of an array of jobs.
            All machines must see --out under the same path.
        address: Of the Ray cluster, host:port; without it RAY_ADDRESS, else one that runs here, else a new one.
        parts: Of slurm: jobs in the array; as few as hold all runs by default.
        part: Train a part only, such as 3/20, the third of twenty, and leave table and picture alone.
        trust: Modules of one's own that may run when the file names them.
        json: Print one JSON object.
    """
    check_directory(out)
    trust_modules(trust)
    _require_own(engine, address, parts, part)
    jobs, trials = read_jobs(file)
    where = _engine(engine, file, address, parts, part, trust)

    import torch

    from swimmer_mj.learning.problems.caution import caution_of
    from swimmer_mj.learning.runs.sweep import as_they_began, rows_of, run_jobs, write_rows

    if part is not None:
        jobs = _part(as_they_began(jobs, out), part)

    torch.set_num_threads(1)  # the learners are the parallelism
    console = make_console(json)
    said = (caution_of(job.config.problem) for job in jobs)
    for line in dict.fromkeys(line for line in said if line is not None):
        print_line(console, line)

    def report(news: News) -> None:
        if news.warning is not None:
            print_line(console, f"{news.job}: {news.warning}" if news.job else news.warning)
        if (row := news.metrics) is not None:
            print_line(
                console,
                f"{news.job}  trials {row.trial:,}  speed {row.speed:.3f}  best {news.best_speed:.3f}",
            )

    with asked_to_stop() as signal_number:
        run_jobs(jobs, out, trials, engine=where, report=report, stop=lambda: signal_number() is not None)
        rows = rows_of(jobs, out, trials)
        if part is None:
            write_rows(rows, out / TABLE)
        stopped_by = signal_number()
    if stopped_by is not None:
        options = {"--engine": None if engine == "local" else engine, "--address": address, "--part": part}
        how = [word for name, value in options.items() if value is not None for word in (name, value)]
        how += ["--trust", *trust] if trust else []
        again = shlex.join(["swimmer-mj", "sweep", str(file), "--out", str(out), *how])
        raise StoppedError(stopped_by, f"saved; go on with: {again}")
    report_of = _conclude(console, jobs, rows, out, whole=part is None)
    if engine == "slurm" and report_of["unfinished"]:
        report_of["submit"] = shlex.join(["sbatch", str(out / SCRIPT)])
        print_line(console, f"submit what is left, then give this command again: {report_of['submit']}")
    if json:
        print_json(report_of)


def _require_own(engine: str, address: str | None, parts: int | None, part: str | None) -> None:
    """ValueError if an option is of another engine."""
    for name, value, own in (
        ("--address", address, "ray"),
        ("--parts", parts, "slurm"),
        ("--part", part, "local"),
    ):
        if value is not None and engine != own:
            raise ValueError(f"{name} is of --engine {own}, got it with --engine {engine}")


def _engine(
    name: str, file: Path, address: str | None, parts: int | None, part: str | None, trust: tuple[str, ...]
) -> Engine:
    """The engine of that name; ValueError if it is not to be had."""
    from swimmer_mj.learning.runs.engines.local import LocalEngine
    from swimmer_mj.learning.runs.engines.ray_core import RayEngine
    from swimmer_mj.learning.runs.engines.slurm import SlurmEngine
    from swimmer_mj.learning.runs.jobs import PATIENCE

    if name == "ray":
        return RayEngine(address, trust)
    if name == "slurm":
        return SlurmEngine(file, trust, parts)
    return LocalEngine(patience=0.0 if part is None else PATIENCE)


def _part(jobs: Sequence[Job], text: str) -> list[Job]:
    """The part of ``jobs`` that "3/20" names."""
    from swimmer_mj.learning.runs.jobs import part

    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise ValueError(f"--part must be like 3/20, the third of twenty, got {text!r}")
    return part(jobs, int(match[1]), int(match[2]))


def _conclude(
    console: Console, jobs: Sequence[Job], rows: list[dict[str, Any]], out: Path, whole: bool
) -> dict[str, Any]:
    """Say what came out, and draw it if these are all jobs and any was evaluated; what --json prints."""
    from swimmer_mj.learning.problems.forms import SwimmerForm
    from swimmer_mj.render.sweep import draw_sweep

    learned = [row for row in rows if row["speed"] is not None]
    best = max(learned, key=lambda row: row["speed"], default=None)
    states = {
        state: [row["state"] for row in rows].count(state) for state in ("done", "diverged", "unfinished")
    }
    left = f", {states['unfinished']} unfinished" if states["unfinished"] else ""
    print_line(console, f"{states['done']} of {len(rows)} runs done, {states['diverged']} diverged{left}")
    if best is not None:
        print_line(console, f"best: {out / best['job']}, {best['speed']:.3f} in an evaluation")
    report = {
        "out": str(out),
        "jobs": len(rows),
        **states,
        "best": None if best is None else {**best, "run": str(out / best["job"])},
    }
    if whole and learned:
        swimmers = all(job.config.problem.form(SwimmerForm) is not None for job in jobs)
        draw_sweep(rows, out / PICTURE, "swimming speed  (m/s)" if swimmers else "mean reward")
        print_line(console, f"  {out / TABLE}\n  {out / PICTURE}")
        report |= {"table": str(out / TABLE), "picture": str(out / PICTURE)}
    return report


def read_jobs(path: Path) -> tuple[list[Job], int]:
    """The jobs that a file asks for, and the trials of each; ValueError in one line if it is not as it should be."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        asked = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not TOML: {error}") from None
    try:
        return _jobs(asked)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


def _jobs(asked: dict[str, Any]) -> tuple[list[Job], int]:
    from swimmer_mj.learning.runs.jobs import Job
    from swimmer_mj.learning.runs.sweep import grid, random_search, settings_name

    if unknown := sorted(asked.keys() - {*KEYS}):
        raise ValueError(f"there is no {unknown[0]!r}; there are {', '.join(KEYS)}")
    trials = _integer(asked, "trials", None)
    shared, combinations, random = (_table(asked, name) for name in ("set", "grid", "random"))
    if combinations and random:
        raise ValueError("give [grid] or [random], not both")
    for name, values in combinations.items():
        if not (isinstance(values, list) and values):
            raise ValueError(f"[grid] {name} must be a list of values, got {values!r}")
    if random:
        samples, seed = _integer(random, "samples", None), _integer(random, "seed", 0, least=0)
        laws = {name: law for name, law in random.items() if name not in ("samples", "seed")}
        _require_count(samples)
        settings = random_search(laws, samples, seed)
    else:
        count = 1
        for values in combinations.values():
            count *= len(values)
        _require_count(count)
        settings = grid(combinations)
    seeds = asked.get("seeds", [0])
    seeds = parse_seeds(seeds) if isinstance(seeds, str) else seeds
    integers = isinstance(seeds, list) and all(type(seed) is int and seed >= 0 for seed in seeds)
    if not (integers and seeds and len({*seeds}) == len(seeds)):
        raise ValueError(f'seeds must be like "0-7" or [0, 1, 2], each once, got {asked["seeds"]!r}')
    total = len(settings) * len(seeds)
    _require_count(total)
    made = [_config(asked, {**shared, **chosen}, total) for chosen in settings]
    names = [settings_name(chosen) for chosen in settings]
    if random or len({*names}) < len(names):
        names = [f"{i}_{name}" for i, name in enumerate(names)]  # the same when there are more of them
    jobs = [
        Job(f"{name}/seed-{seed}", chosen, dataclasses.replace(config, seed=seed))
        for name, chosen, config in zip(names, settings, made, strict=True)
        for seed in seeds
    ]
    return jobs, trials


def _config(asked: dict[str, Any], settings: dict[str, Any], count: int) -> Any:
    """The configuration with ``settings``, by the names of train's options and of --set; "null" is None."""
    from swimmer_mj.learning.runs.registry import METHODS, PROBLEMS, find, problem_named, setting

    settings = {name: None if value == "null" else value for name, value in settings.items()}
    options = {name: value for name, value in settings.items() if name in OPTIONS and value is not None}
    others = [f"{name}={json_module.dumps(value)}" for name, value in settings.items() if name not in OPTIONS]
    problem, method = asked.get("problem", "swim"), asked.get("method", "td")
    find(problem_named(problem)[0], PROBLEMS, "problem", importing=False)
    find(method, METHODS, "method", importing=False)
    if "reward" in options:
        _require_trusted(options["reward"])
    options = {name: setting(train, name, value) for name, value in options.items()}
    config = configured(problem, method, options, count)
    config = changed(config, others)
    every = _integer(asked, "evaluate_every", config.evaluate_every)
    return dataclasses.replace(config, evaluate_every=every)


def _require_trusted(reward: Any) -> None:
    """Refuse what is no function's name, or one whose module is not trusted: what a file names is not run."""
    from swimmer_mj.learning.runs.registry import require_imported

    if not (isinstance(reward, str) and ":" in reward):
        raise ValueError(f"reward must be like my_module:reward, got {reward!r}")
    require_imported(reward.partition(":")[0], f"reward {reward!r}")


def _table(asked: dict[str, Any], name: str) -> dict[str, Any]:
    found = asked.get(name, {})
    if not isinstance(found, dict):
        raise ValueError(f"{name} must be a table, [{name}], got {found!r}")
    return found


def _integer(table: dict[str, Any], name: str, default: int | None, least: int = 1) -> int:
    value = table.get(name, default)
    if type(value) is not int or value < least:
        raise ValueError(f"{name} must be an integer of at least {least}, got {value!r}")
    return value


def _require_count(count: int) -> None:
    if count > MOST_JOBS:
        raise ValueError(f"a sweep has at most {MOST_JOBS:,} runs, and this one asks for {count:,}")
