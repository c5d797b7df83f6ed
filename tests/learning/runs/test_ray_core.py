"""A sweep on a real Ray cluster of three nodes, one of which is killed: the same bits as on this machine."""

import contextlib
import csv
import dataclasses
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path

import pytest
import torch
from filelock import FileLock

from swimmer_mj.cli import main
from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.engines import ray_core
from swimmer_mj.learning.runs.engines.ray_core import Assignment, carry_out
from swimmer_mj.learning.runs.jobs import state_of
from swimmer_mj.learning.runs.sweep import run_jobs

needs_ray = pytest.mark.skipif(not ray_core.is_installed(), reason="Ray is not installed")
FILE = """
problem = "pendulum"
trials = 12_000
seeds = "0-1"
evaluate_every = 500

[set]
neurons = 6
dtype = "float64"

[grid]
eta = [0.02, 0.04]
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "sweep.toml").write_text(FILE)
    return tmp_path / "sweep.toml"


@pytest.fixture
def alone(tmp_path_factory):
    """Hold Ray's place on this machine: a sweep without an address joins whatever cluster runs here."""
    with FileLock(tmp_path_factory.getbasetemp().parent / "ray.lock"):
        yield


@pytest.fixture
def cluster(alone):
    """A head that runs nothing, and two nodes of a core each; all of them end with the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Ray's own
        from ray.cluster_utils import Cluster

    small = {"object_store_memory": 80 * 2**20, "include_dashboard": False}
    quick = {
        "health_check_initial_delay_ms": 0,
        "health_check_period_ms": 500,
        "health_check_failure_threshold": 2,
    }
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **small, "_system_config": quick})
    try:
        cluster.nodes = [cluster.add_node(num_cpus=1, object_store_memory=80 * 2**20) for _ in range(2)]
        yield cluster
    finally:
        cluster.shutdown()


def heed_interrupts():
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(file, out, address):
    """The sweep, in a process and a group of its own, as a shell starts it."""
    return subprocess.Popen(
        [sys.executable, "-m", "swimmer_mj", "sweep", file, "--out", out, "--engine", "ray", "--address", address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )  # fmt: skip


def wait_for(condition, process, seconds=300):
    until = time.monotonic() + seconds
    while not (found := condition()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.02)
    return found


def log(path):
    if not (path / "metrics.csv").exists():
        return []
    with open(path / "metrics.csv", newline="") as text:
        return list(csv.DictReader(text))


def learning_in(path):
    """The process that holds the run in ``path``, if one does."""
    with contextlib.suppress(FileNotFoundError, IndexError):
        return int((path / ".owner").read_text().split()[1])
    return None


def parent(process):
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


def node_of(process, cluster):
    """The node whose raylet started ``process``."""
    (node,) = (
        node for node in cluster.nodes if node.all_processes["raylet"][0].process.pid == parent(process)
    )
    return node


def assert_same_bits(jobs, one, other):
    for job in jobs:
        (weights, info), (weights2, info2) = (
            load_checkpoint(where / job.name / "checkpoint.safetensors") for where in (one, other)
        )
        assert weights.keys() == weights2.keys()
        for name, tensor in weights.items():
            assert torch.equal(tensor, weights2[name]), (job.name, name)
        assert info["trial"] == info2["trial"] == 12_000
        rows, rows2 = ([{**row, "seconds": ""} for row in log(where / job.name)] for where in (one, other))
        assert rows == rows2


@needs_ray
@pytest.mark.skipif(sys.platform != "linux", reason="finds the node of a process in /proc")
def test_interrupted_and_a_node_killed_it_computes_what_one_machine_computes(file, tmp_path, cluster):
    jobs, trials = read_jobs(file)
    out = tmp_path / "ray"

    process = start(file, out, cluster.address)  # the first time it is interrupted
    wait_for(lambda: any(out.glob("*/*/checkpoint.safetensors")), process)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=120)
    again = f"swimmer-mj sweep {file} --out {out} --engine ray --address {cluster.address}"
    assert err == f"swimmer-mj: stopped by SIGINT; saved; go on with: {again}\n"
    assert process.returncode == 130
    assert {state_of(out / job.name, trials) for job in jobs} == {"unfinished"}
    stood = {job.name: len(log(out / job.name)) for job in jobs}

    process = start(*shlex.split(again)[2:5:2], cluster.address)
    job, worker = wait_for(  # a run that has been evaluated since, with a third to go
        lambda: next(
            (
                (job, worker)
                for job in jobs
                if (worker := learning_in(out / job.name))
                and stood[job.name] < len(log(out / job.name)) < trials // 500 - 8
            ),
            None,
        ),
        process,
    )
    before = log(out / job.name)
    cluster.remove_node(node_of(worker, cluster), allow_graceful=False)
    assert state_of(out / job.name, trials) == "unfinished"
    shown, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert "was lost; its runs go on from their last checkpoints" in shown
    assert "4 of 4 runs done, 0 diverged" in shown
    assert log(out / job.name)[: len(before)] == before  # seconds too: it went on, and did not begin again

    run_jobs(jobs, tmp_path / "local", trials)
    assert_same_bits(jobs, out, tmp_path / "local")


def test_a_node_with_another_version_or_directory_is_refused(file, tmp_path):
    jobs, trials = read_jobs(file)
    configs = tuple((job.name, job.config.to_json()) for job in jobs)
    (tmp_path / "mark").touch()
    here = Assignment(configs, str(tmp_path), trials, "mark", version("swimmer-mj"), (), str(tmp_path))
    with pytest.raises(ValueError, match=r"swimmer-mj is .* on node .*, and 9.9 where the sweep was started"):
        carry_out(dataclasses.replace(here, version="9.9"))
    with pytest.raises(ValueError, match="must be on a file system that all share"):
        carry_out(dataclasses.replace(here, mark="another"))
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.toml", "mark"}


@pytest.mark.parametrize(
    ("there", "address", "complaint"),
    [
        (False, (), 'the engine ray needs Ray: pip install "swimmer-mj[cluster]"'),
        (True, ("--address", "ray://head:10001"), "must be host:port, got 'ray://head:10001'"),
    ],
)
def test_without_ray_or_with_a_client_it_says_what_to_do(
    file, tmp_path, capsys, monkeypatch, there, address, complaint
):
    monkeypatch.setattr(ray_core, "is_installed", lambda: there)
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--engine", "ray", *address]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@needs_ray
def test_where_no_cluster_is_it_says_so_at_once(file, tmp_path, capsys):
    with socket.socket() as taken:  # bound, and nobody listens
        taken.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        out = tmp_path / "out"
        assert main(["sweep", str(file), "--out", str(out), "--engine", "ray", "--address", address]) == 2
    err = capsys.readouterr().err
    assert f"there is no Ray cluster at {address}: " in err
    assert err.count("\n") == 1


@needs_ray
@pytest.mark.usefixtures("alone")
def test_an_empty_address_is_none(file, tmp_path):
    """Then there is a new instance, which ends with the sweep."""
    file.write_text(FILE.replace("12_000", "20").replace("500", "10").partition("[grid]")[0])
    command = [
        sys.executable,
        "-m",
        "swimmer_mj",
        "sweep",
        file,
        "--out",
        tmp_path / "out",
        "--engine",
        "ray",
    ]
    done = subprocess.run(command, env={**os.environ, "RAY_ADDRESS": ""}, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 of 2 runs done, 0 diverged" in done.stdout
