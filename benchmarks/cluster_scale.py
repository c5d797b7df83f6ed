"""What does a sweep cost its coordinator on 10, 100 and 1,000 nodes, and what does a run leave on disk?

    python benchmarks/cluster_scale.py

Needs Ray (extra ``cluster``). One pack of runs learns for real: processor time, bytes. Then as many tasks as there
would be nodes carry the pack's real messages through a real Ray instance on this machine and do nothing else: so the
coordinator meets what it would meet, and the nodes do not exist. What Ray's own services do for each node that is there
is not in it. All times are processor time but where it says otherwise. Prints a table and writes
benchmarks/results/cluster-scale.json.
"""

from __future__ import annotations

import json
import os
import pickle
import platform
import tempfile
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.table import Table

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.engines.local import LocalEngine
from swimmer_mj.learning.runs.engines.ray_core import OBJECT_STORE, WAIT, Assignment, gather
from swimmer_mj.learning.runs.jobs import Job, News, unfinished
from swimmer_mj.learning.runs.sweep import rows_of
from swimmer_mj.learning.td.method import TemporalDifferences

OUT = Path(__file__).parent / "results" / "cluster-scale.json"
NODES = (10, 100, 1000)
TRIALS = 2000
"""That the pack learns: to its first evaluation."""
RUN = 100_000
"""Trials of a run that is counted; ``train``'s default."""
POLLS = 5


def pack() -> list[Job]:
    """As many learners of the paper's swimmer as learn in step."""
    method = TemporalDifferences()
    method = method.for_seeds(Swimming(), method.team_size)
    config = RunConfig(Swimming(), method, evaluate_every=TRIALS)
    return [Job(f"seed-{seed}", {}, replace(config, seed=seed)) for seed in range(method.team_size)]


def learned(jobs: list[Job], directory: Path) -> tuple[dict[str, float], list[News]]:
    """Processor time of the pack on one core, bytes of a run, and the news of each."""
    news: list[News] = []
    short = [replace(job, config=replace(job.config, evaluate_every=1)) for job in jobs]  # compiles
    LocalEngine(workers=1).run(short, directory / "before", 1, news.append, lambda: False)
    news.clear()
    used = time.process_time()
    LocalEngine(workers=1).run(jobs, directory, TRIALS, news.append, lambda: False)
    seconds = time.process_time() - used
    files = [path for job in jobs for path in (directory / job.name).iterdir()]
    used = time.process_time()
    left = unfinished(jobs, directory, TRIALS)
    rows = rows_of(jobs, directory, TRIALS)
    looked = time.process_time() - used
    assert not left
    assert len(rows) == len(jobs)
    facts = {
        "runs in a pack": len(jobs),
        "s a run": seconds / len(jobs) / TRIALS * RUN,
        "bytes a run": sum(path.stat().st_size for path in files) / len(jobs),
        "files a run": len(files) / len(jobs),
        "s to look at a run": looked / len(jobs),
    }
    return facts, news


def services() -> dict[int, str]:
    """The processes of Ray's coordinator among this one's children."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = path.read_text().partition("(")[2].rpartition(")")
        except (FileNotFoundError, ProcessLookupError):
            continue
        if name in ("gcs_server", "raylet") and int(rest.split()[1]) == os.getpid():
            found[int(path.parent.name)] = name
    return found


def used_by(processes: dict[int, str]) -> float:
    """Processor time of ``processes`` so far, s."""
    fields = (Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split() for process in processes)
    return sum(int(each[11]) + int(each[12]) for each in fields) / os.sysconf("SC_CLK_TCK")


def replay(assignment: Assignment, news: list[News], seconds: float) -> list[News]:
    """A task that has the messages of a pack and learns nothing."""
    time.sleep(seconds)
    return news


def coordinated(ray: Any, nodes: int, assignment: Assignment, news: list[News]) -> dict[str, float]:
    """What ``nodes`` tasks cost, each with its own message."""
    task = ray.remote(num_cpus=1)(replay)
    processes = services()
    clock, used, theirs = time.perf_counter(), time.process_time(), used_by(processes)
    tasks = {task.remote(replace(assignment, mark=f"{i}"), news, 0.0): f"{i}" for i in range(nodes)}
    submitted = time.perf_counter() - clock
    heard: list[News] = []
    gather(ray, tasks, heard.append, lambda: False)
    assert len(heard) == nodes * len(news)
    facts = {
        "nodes": nodes,
        "s to submit (clock)": submitted,
        "s to the last answer (clock)": time.perf_counter() - clock,
        "driver: s a task": (time.process_time() - used) / nodes,
        "Ray's services: s a task": (used_by(processes) - theirs) / nodes,
    }
    waiting = [task.remote(assignment, news, 3600.0) for _ in range(nodes)]
    ray.wait(waiting, num_returns=nodes, timeout=WAIT)
    used = time.process_time()
    for _ in range(POLLS):
        ray.wait(waiting, num_returns=nodes, timeout=WAIT)
        ray.nodes()
    facts["driver: share of a core while it waits"] = (time.process_time() - used) / (POLLS * WAIT)
    for each in waiting:
        ray.cancel(each, force=True)
    ray.wait(waiting, num_returns=nodes, timeout=60)
    return facts


def measured() -> dict[str, Any]:
    """All of it."""
    import ray

    torch.set_num_threads(1)
    jobs = pack()
    with tempfile.TemporaryDirectory() as place:
        facts, news = learned(jobs, Path(place))
    configs = tuple((job.name, job.config.to_json()) for job in jobs)
    assignment = Assignment(configs, "/shared/study", RUN, ".sweep", version("swimmer-mj"), (), os.getcwd())
    ray.init(
        "local", num_cpus=os.cpu_count(), object_store_memory=OBJECT_STORE, include_dashboard=False,
        log_to_driver=False, logging_level="ERROR",
    )  # fmt: skip
    coordinated(ray, 10, assignment, news)  # workers start
    return {
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "ray": ray.__version__,
        "pack": facts,
        "bytes to a task": len(pickle.dumps(assignment)),
        "bytes from a task": len(pickle.dumps(news)),
        "coordinator": [coordinated(ray, nodes, assignment, news) for nodes in NODES],
    }


def table(result: dict[str, Any]) -> Table:
    """For people."""
    drawn = Table(title="the coordinator of a sweep")
    for name in result["coordinator"][0]:
        drawn.add_column(name)
    for row in result["coordinator"]:
        drawn.add_row(*(f"{value:.3g}" for value in row.values()))
    return drawn


if __name__ == "__main__":
    result = measured()
    with replacing(OUT) as partial:
        partial.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    note_made(OUT)
    Console().print(table(result))
    Console().print({name: value for name, value in result.items() if name != "coordinator"})
