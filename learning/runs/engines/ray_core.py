"""The jobs of a sweep on a Ray cluster: the runs that learn in step are one task, on one core.

All nodes must see the directory of the sweep under the same path, as on a shared file system; each task looks whether
they do. So the coordinator sends a task the configurations of its runs and gets their last metrics back, and nothing
else: weights and logs are where every engine has them. When a node is lost, Ray gives its tasks to others, which go on
from the runs' last checkpoints, as any run does. Ray itself is imported only here, and only when an engine runs.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import socket
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from swimmer_mj.learning.runs import registry
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.engines.local import LocalEngine
from swimmer_mj.learning.runs.jobs import PATIENCE, Job, News, packs, unfinished

__all__ = ["Assignment", "RayEngine", "carry_out", "gather", "is_installed"]

RETRIES = 100
"""How many lost nodes, or workers that die, one task survives."""
WAIT = 0.5
"""s between two looks at what has ended."""
LOOK_AT_NODES = 5.0
"""s between two looks at which nodes are there."""
OBJECT_STORE = 80 * 2**20
"""Bytes of /dev/shm for an instance that is started here. Tasks and their answers are too small to go through it."""


def is_installed() -> bool:
    """Whether Ray is there."""
    return importlib.util.find_spec("ray") is not None


@dataclass(frozen=True)
class Assignment:
    """What a task needs to know, wherever it runs."""

    jobs: tuple[tuple[str, dict[str, Any]], ...]
    """Name and configuration of each job, as JSON."""
    directory: str
    """Of the sweep."""
    trials: int
    mark: str
    """A file in the directory, by which a node sees that it is the same one."""
    version: str
    modules: tuple[str, ...]
    """Of one's own, that problems and methods are in."""
    path: str
    """The folder in which they may be."""


@dataclass(frozen=True)
class RayEngine:
    """The cluster at ``address``, or one that Ray finds, or all cores of this machine.

    Parameters
    ----------
    address : str, optional
        Of the head node, as host:port. Without it: that of the environment variable ``RAY_ADDRESS``, else that of a
        cluster that was started on this machine, else a new one that ends with the sweep.
    modules : tuple of str
        Modules of one's own to import on the nodes.
    """

    address: str | None = None
    modules: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not is_installed():
            raise ValueError('the engine ray needs Ray: pip install "swimmer-mj[cluster]"')
        address = self.address or os.environ.get("RAY_ADDRESS", "")
        if "://" in address:
            raise ValueError(
                f"the address of a Ray cluster must be host:port, got {address!r}; a Ray Client (ray://) cannot see "
                f"the nodes' directory: start the sweep on a node of the cluster"
            )

    def run(
        self,
        jobs: Sequence[Job],
        directory: Path,
        trials: int,
        report: Callable[[News], None],
        stop: Callable[[], bool],
    ) -> None:
        """See :class:`~swimmer_mj.learning.runs.jobs.Engine`; news when all runs of a task have ended.

        Raises
        ------
        ConnectionError
            When there is no cluster at the address.
        ValueError
            When a node does not see the directory, or has another version of this package.
        """
        todo = unfinished(jobs, directory, trials)
        if not todo:
            return
        with _connected(self.address) as ray, _marked(directory) as mark:
            cores = int(ray.cluster_resources().get("CPU", 1))
            learn = ray.remote(max_retries=RETRIES)(carry_out)
            tasks = {}
            for pack in packs(todo, cores):
                assignment = Assignment(
                    tuple((job.name, job.config.to_json()) for job in pack),
                    str(directory.absolute()),
                    trials,
                    mark,
                    version("swimmer-mj"),
                    self.modules,
                    os.getcwd(),
                )
                task = learn.options(name=pack[0].name, **_needs(pack)).remote(assignment)
                tasks[task] = pack[0].name
            gather(ray, tasks, report, stop)


def _needs(pack: Sequence[Job]) -> dict[str, float]:
    """A core; and a GPU, which Ray hides from tasks that do not ask for one, if the learners compute there."""
    cuda = any(getattr(job.config.method, "device", "cpu") == "cuda" for job in pack)
    return {"num_cpus": 1, "num_gpus": 1} if cuda else {"num_cpus": 1}


def gather(
    ray: Any, tasks: Mapping[Any, str], report: Callable[[News], None], stop: Callable[[], bool]
) -> None:
    """Report what ``tasks`` answer until all have ended; cancel them when ``stop`` says so, or when one fails."""
    left = list(tasks)
    failure: BaseException | None = None
    cancelled = False
    nodes = _Nodes(ray)
    while left:
        ended, left = ray.wait(left, num_returns=len(left), timeout=WAIT)
        for task in ended:
            try:
                for news in ray.get(task):
                    report(news)
            except ray.exceptions.TaskCancelledError:
                pass
            except ray.exceptions.RayTaskError as error:
                failure = failure or error.cause
            except ray.exceptions.RayError as error:
                failure = failure or OSError(
                    f"{tasks[task]}: Ray gave up after {RETRIES} tries: {_first(error)}"
                )
        for address in nodes.lost(last=not left):
            report(News("", warning=f"node {address} was lost; its runs go on from their last checkpoints"))
        if left and not cancelled and (failure is not None or stop()):
            for task in left:
                ray.cancel(task)  # those that run save their runs and answer
            cancelled = True
    if failure is not None:
        raise failure


def _first(error: BaseException) -> str:
    """The first line of what ``error`` says."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


class _Nodes:
    """The nodes of a cluster, looked at now and then."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._looked_at = time.monotonic()
        self._known = self._alive()

    def _alive(self) -> dict[str, str]:
        return {node["NodeID"]: node["NodeManagerAddress"] for node in self._ray.nodes() if node["Alive"]}

    def lost(self, last: bool) -> list[str]:
        """Addresses of nodes that were there at the last look and are not any more; ``last``: look now."""
        if not last and time.monotonic() - self._looked_at < LOOK_AT_NODES:
            return []
        before, self._known = self._known, self._alive()
        self._looked_at = time.monotonic()
        return [address for node, address in before.items() if node not in self._known]


@contextlib.contextmanager
def _connected(address: str | None) -> Iterator[Any]:
    """Ray, connected to a cluster for a block, which keeps its signal handlers."""
    import ray

    if ray.is_initialized():
        yield ray
        return
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    given = address or os.environ.get("RAY_ADDRESS") or None  # empty is as unset
    if given is not None:
        _require_reachable(given)
    with _own_handlers():
        try:
            ray.init(address or "auto", **quiet)
        except (ConnectionError, RuntimeError, ValueError) as error:
            if given is not None:
                raise ConnectionError(f"there is no Ray cluster at {given}: {_first(error)}") from error
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent anywhere
            ray.init("local", include_dashboard=False, object_store_memory=OBJECT_STORE, **quiet)
    try:
        yield ray
    finally:
        ray.shutdown()


def _require_reachable(address: str) -> None:
    """ConnectionError if nothing listens at host:port; Ray would try for some minutes."""
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdigit()):
        return  # "auto", "local"
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except (OSError, OverflowError) as error:
        raise ConnectionError(f"there is no Ray cluster at {address}: {error}") from error


@contextlib.contextmanager
def _own_handlers() -> Iterator[None]:
    """Keep Ray from taking SIGINT and SIGTERM away from who had them before a block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _marked(directory: Path) -> Iterator[str]:
    """The name of a file that is in ``directory`` during a block."""
    directory.mkdir(parents=True, exist_ok=True)
    mark = directory / f".sweep-{uuid.uuid4().hex}"
    mark.touch()
    try:
        yield mark.name
    finally:
        mark.unlink(missing_ok=True)


# On the nodes --------------------------------------------------------------------------------------------------------


def carry_out(assignment: Assignment) -> list[News]:
    """A task: have the runs of ``assignment`` learn what is left of their trials; the last news of each.

    Raises
    ------
    ValueError
        When another version of this package is here, or another directory of that name.
    """
    import torch

    directory = Path(assignment.directory)
    where = f"on node {socket.gethostname()}"
    if (here := version("swimmer-mj")) != assignment.version:
        raise ValueError(
            f"swimmer-mj is {here} {where}, and {assignment.version} where the sweep was started"
        )
    if not (directory / assignment.mark).exists():
        raise ValueError(
            f"{directory} {where} is not that of the sweep: it must be on a file system that all share"
        )
    torch.set_num_threads(1)
    if assignment.path not in sys.path:
        sys.path.append(assignment.path)
    registry.trust(assignment.modules)
    jobs = [Job(name, {}, RunConfig.from_json(config)) for name, config in assignment.jobs]
    last: dict[tuple[str, bool], News] = {}

    def note(news: News) -> None:
        last[news.job, news.warning is None] = news

    engine = LocalEngine(workers=1, patience=PATIENCE)
    with _asked_to_stop() as stop, ThreadPoolExecutor(1) as thread:
        future = thread.submit(engine.run, jobs, directory, assignment.trials, note, stop)
        while not wait([future], timeout=WAIT).done:
            pass  # the main thread must come to itself for an interrupt to be seen
    future.result()
    return list(last.values())


@contextlib.contextmanager
def _asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Says whether the task was cancelled, during a block: Ray interrupts the main thread of its process then."""
    asked = threading.Event()
    before = signal.signal(signal.SIGINT, lambda number, frame: asked.set())
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)
