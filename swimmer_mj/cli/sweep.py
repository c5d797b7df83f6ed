"""``sweep``: a grid or a random search over any settings, and seeds, from one file."""

from __future__ import annotations

import dataclasses
import json as json_module
import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import check_directory, trust_modules
from swimmer_mj.cli.output import make_console, print_json, print_line
from swimmer_mj.cli.signals import StoppedError, asked_to_stop
from swimmer_mj.cli.training import OPTIONS, changed, configured, parse_seeds

if TYPE_CHECKING:
    from swimmer_mj.learning.runs.sweep import Job
    from swimmer_mj.learning.runs.together import Report

__all__ = ["TABLE", "read_jobs", "sweep"]

TABLE, PICTURE = "sweep.csv", "sweep.png"
MOST_JOBS = 10_000
KEYS = ("problem", "method", "trials", "seeds", "evaluate_every", "set", "grid", "random")


def sweep(
    file: Positional[Path],
    out: Path,
    engine: Literal["local"] = "local",
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Train a run for each combination of settings and seeds that a file asks for, on all cores.

    Each has a directory in --out, and a row in its sweep.csv: settings, trials, seconds, speed. The same command goes
    on where it stopped. docs/sweeps.md has the form of the file.

    Args:
        file: What to run, as TOML.
        out: Directory of the runs, the table and a picture of it.
        engine: Where they run: local is this machine.
        trust: Modules of one's own that may run when the file names them.
        json: Print one JSON object.
    """
    check_directory(out)
    trust_modules(trust)
    jobs, trials = read_jobs(file)

    import torch

    from swimmer_mj.learning.problems.forms import SwimmerForm
    from swimmer_mj.learning.runs.sweep import rows_of, run_jobs, write_rows
    from swimmer_mj.render.sweep import draw_sweep

    torch.set_num_threads(1)  # the learners are the parallelism
    console = make_console(json)

    def report(news: Report) -> None:
        name = news.run.directory.relative_to(out).as_posix()
        if news.warning is not None:
            print_line(console, f"{name}: {news.warning}")
        if (row := news.metrics) is not None:
            print_line(
                console,
                f"{name}  trials {row.trial:,}  speed {row.speed:.3f}  best {news.run.best_speed:.3f}",
            )

    with asked_to_stop() as signal_number:
        run_jobs(jobs, out, trials, report=report, stop=lambda: signal_number() is not None)
        rows = rows_of(jobs, out, trials)
        write_rows(rows, out / TABLE)
        stopped_by = signal_number()
    if stopped_by is not None:
        again = shlex.join(["swimmer-mj", "sweep", str(file), "--out", str(out)])
        raise StoppedError(stopped_by, f"saved; go on with: {again}")
    swimmers = all(job.config.problem.form(SwimmerForm) is not None for job in jobs)
    draw_sweep(rows, out / PICTURE, "swimming speed  (m/s)" if swimmers else "mean reward")
    learned = [row for row in rows if row["speed"] is not None]
    best = max(learned, key=lambda row: row["speed"], default=None)
    states = [row["state"] for row in rows]
    print_line(
        console, f"{states.count('done')} of {len(rows)} runs done, {states.count('diverged')} diverged"
    )
    if best is not None:
        print_line(console, f"best: {out / best['job']}, {best['speed']:.3f} in an evaluation")
    print_line(console, f"  {out / TABLE}\n  {out / PICTURE}")
    if json:
        print_json(
            {
                "out": str(out),
                "jobs": len(rows),
                "done": states.count("done"),
                "diverged": states.count("diverged"),
                "best": None if best is None else {**best, "run": str(out / best["job"])},
                "table": str(out / TABLE),
                "picture": str(out / PICTURE),
            }
        )


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
    from swimmer_mj.learning.runs.sweep import Job, grid, random_search, settings_name

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
        names = [f"{i:0{len(str(len(names) - 1))}d}_{name}" for i, name in enumerate(names)]
    jobs = [
        Job(f"{name}/seed-{seed}", chosen, dataclasses.replace(config, seed=seed))
        for name, chosen, config in zip(names, settings, made, strict=True)
        for seed in seeds
    ]
    return jobs, trials


def _config(asked: dict[str, Any], settings: dict[str, Any], count: int) -> Any:
    """The configuration with ``settings``, by the names of train's options and of --set."""
    from swimmer_mj.learning.runs.registry import METHODS, PROBLEMS, find

    options = {name: value for name, value in settings.items() if name in OPTIONS}
    others = [f"{name}={json_module.dumps(value)}" for name, value in settings.items() if name not in OPTIONS]
    problem, method = asked.get("problem", "swim"), asked.get("method", "td")
    find(problem, PROBLEMS, "problem", importing=False)
    find(method, METHODS, "method", importing=False)
    config = configured(problem, method, options, count)
    config = changed(config, others)
    every = _integer(asked, "evaluate_every", config.evaluate_every)
    return dataclasses.replace(config, evaluate_every=every)


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
