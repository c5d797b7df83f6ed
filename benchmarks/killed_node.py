"""A sweep on a Ray cluster of two nodes, one of them killed, and the same sweep on this machine: the same bits?

    python benchmarks/killed_node.py

Needs Ray (extra ``cluster``) and Linux. A head that runs nothing and two nodes of one core each learn six swimmers of
three links. When a run has been evaluated and has some way to go, all processes of its node get SIGKILL. What is left
goes on, on the other node, from its last checkpoint. Prints what the sweep prints, with the time, and what was
compared; writes both to benchmarks/results/killed-node.log.
"""

from __future__ import annotations

import contextlib
import csv
import platform
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.jobs import Job
from swimmer_mj.learning.runs.sweep import run_jobs

OUT = Path(__file__).parent / "results" / "killed-node.log"
STUDY = """
problem = "swim"
method = "td"
trials = 1200
seeds = "0-2"
evaluate_every = 100

[set]
links = 3
dtype = "float64"

[grid]
eta = [0.02, 0.04]
"""
STORE = 80 * 2**20  # bytes of /dev/shm for a node's objects
HEALTH = {
    "health_check_initial_delay_ms": 0,
    "health_check_period_ms": 500,
    "health_check_failure_threshold": 2,
}


class Log:
    """Lines with the seconds since the start, printed and kept."""

    def __init__(self) -> None:
        self.started = time.monotonic()
        self.lines: list[str] = []

    def __call__(self, text: str) -> None:
        """Print and keep a line."""
        self.lines.append(f"{time.monotonic() - self.started:6.1f} s  {text}")
        print(self.lines[-1], flush=True)


def metrics(run: Path) -> list[dict[str, str]]:
    """The evaluations of a run, without how long they took."""
    with contextlib.suppress(FileNotFoundError), open(run / "metrics.csv", newline="") as file:
        return [{**row, "seconds": ""} for row in csv.DictReader(file)]
    return []


def holder(run: Path) -> int | None:
    """The process that holds a run, if one does."""
    with contextlib.suppress(FileNotFoundError, IndexError):
        return int((run / ".owner").read_text().split()[1])
    return None


def node_of(process: int, cluster: Any) -> Any:
    """The node whose raylet started ``process``."""
    parent = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return next(
        node for node in cluster.worker_nodes if node.all_processes["raylet"][0].process.pid == parent
    )


def follow(printed: Iterable[str], host: str, log: Log) -> None:
    """Put into the log what the sweep prints, but for this host's address and what Ray says of the killed raylet."""
    for line in printed:
        if "raylet" not in line and line.strip() and not line.startswith("    ["):
            log(f"sweep: {line.rstrip().replace(host, 'HOST')}")


def under_way(jobs: list[Job], directory: Path, evaluations: int) -> tuple[Job, int]:
    """Wait for a run that has been evaluated twice and has a third of its way to go: it, and who holds it."""
    while True:
        for job in jobs:
            process = holder(directory / job.name)
            if process and 2 <= len(metrics(directory / job.name)) <= evaluations * 2 / 3:
                return job, process
        time.sleep(0.05)


def on_cluster(study: Path, jobs: list[Job], directory: Path, evaluations: int, log: Log) -> None:
    """Run the sweep on a cluster, and kill a node in the middle."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Ray's own
        from ray.cluster_utils import Cluster
    head = {"num_cpus": 0, "object_store_memory": STORE, "include_dashboard": False, "_system_config": HEALTH}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    try:
        for _ in range(2):
            cluster.add_node(num_cpus=1, object_store_memory=STORE)
        log(f"Ray {version('ray')}: a head and 2 nodes of 1 core")
        command = [
            "sweep",
            str(study),
            "--out",
            str(directory),
            "--engine",
            "ray",
            "--address",
            cluster.address,
        ]
        sweep = subprocess.Popen(
            [sys.executable, "-m", "swimmer_mj", *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        reader = threading.Thread(target=follow, args=(sweep.stdout, cluster.address.partition(":")[0], log))
        reader.start()
        job, process = under_way(jobs, directory, evaluations)
        node = node_of(process, cluster)
        trial = metrics(directory / job.name)[-1]["trial"]
        log(
            f"SIGKILL to all processes of node {node.node_id[:8]}, where {job.name} learns, evaluated at {trial}"
        )
        cluster.remove_node(node, allow_graceful=False)
        if sweep.wait() != 0:
            raise SystemExit(f"the sweep ended with {sweep.returncode}")
        reader.join()
    finally:
        cluster.shutdown()


def differing(jobs: list[Job], one: Path, other: Path) -> tuple[int, int, int]:
    """Numbers that were compared in the checkpoints, those of them that differ, and runs whose evaluations differ."""
    compared = different = rows = 0
    for job in jobs:
        (weights, info), (weights2, info2) = (
            load_checkpoint(where / job.name / "checkpoint.safetensors") for where in (one, other)
        )
        if weights.keys() != weights2.keys() or info["trial"] != info2["trial"]:
            raise SystemExit(f"{job.name}: the checkpoints hold different things")
        compared += sum(tensor.numel() for tensor in weights.values())
        different += sum(int(torch.sum(tensor != weights2[name])) for name, tensor in weights.items())
        rows += metrics(one / job.name) != metrics(other / job.name)
    return compared, different, rows


def main() -> None:
    """Both sweeps, and the comparison."""
    log = Log()
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study.toml"
        study.write_text(STUDY, encoding="utf-8")
        jobs, trials = read_jobs(study)
        on_cluster(study, jobs, Path(folder) / "ray", trials // jobs[0].config.evaluate_every, log)
        run_jobs(jobs, Path(folder) / "local", trials)
        log(f"the same {len(jobs)} runs learned on this machine")
        compared, different, rows = differing(jobs, Path(folder) / "ray", Path(folder) / "local")
    log(f"{compared:,} numbers of {len(jobs)} checkpoints compared: {different} differ")
    log(f"evaluations of {len(jobs)} runs compared: those of {rows} differ")
    about = (
        f"# python benchmarks/killed_node.py: swimmer-mj {version('swimmer-mj')}, Python {platform.python_version()}, "
        f"MuJoCo {version('mujoco')}, Ray {version('ray')}, {platform.machine()}"
    )
    with replacing(OUT) as path:
        path.write_text("\n".join([about, *log.lines]) + "\n", encoding="utf-8")
    note_made(OUT)


if __name__ == "__main__":
    main()
