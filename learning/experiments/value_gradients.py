"""Value gradients: what matters to them, how fast other swimmers get, and whether speed lasts.

Three studies of :mod:`swimmer_mj.learning.value_gradient.equations`, ten seeds each:

- ``ablation``: one setting changed at a time, for as much simulated time as the others;
- ``links``: the chosen settings with 3, 4, 5, 6 and 10 links;
- ``lasting``: the chosen settings with 5 links, ten times as long as it takes to learn, and beside them a learning
  rate that stops falling sooner.

A learner is a row of the log at each look at it: the swimming speed (docs/metrics.md) of the averaged weights and of
the last ones, on the compiled model; a learner that diverges has nan from then on. A learner that is done is not
computed again: what is there of a log is kept, so that an interrupted study goes on where it was. A log knows its
learners by name, not by their settings: after a change of the chosen settings, begin new ones.
"""

from __future__ import annotations

import copy
import dataclasses
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from swimmer_mj.learning.experiments.tables import LOGS, read_table, write_table
from swimmer_mj.learning.networks.networks import Cascade, ValueNetwork
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["ABLATION_LOG", "LASTING_LOG", "LINKS_LOG", "Variant", "ablation", "lasting", "links", "run_study"]

ABLATION_LOG = "value-gradient-ablation.csv"
LINKS_LOG = "value-gradient-links.csv"
LASTING_LOG = "value-gradient-lasting.csv"
COLUMNS = (
    "factor",
    "setting",
    "seed",
    "weights",  # of the network
    "simulation_steps",
    "cpu_seconds",  # of one core, looks at it left out
    "speed",  # m/s, by the averaged weights
    "speed_last",  # m/s, by the last weights
)
SEEDS = range(10)
MILLION = 1_000_000

Row = tuple[str | float, ...]


class Variant(NamedTuple):
    """A problem and a method, and what is different in them."""

    factor: str
    setting: str
    problem: Swimming
    method: ValueGradients

    @property
    def label(self) -> str:
        """In one line."""
        return f"{self.factor}: {self.setting}"


def variant(factor: str, setting: str, **changes: Any) -> Variant:
    """The chosen configuration with some settings of its problem, its method or its learner changed."""
    problem, method = Swimming(s_gamma=ValueGradients.s_gamma), ValueGradients()
    of_learner, of_problem = (
        {name: changes.pop(name) for name in list(changes) if hasattr(thing, name)}
        for thing in (method.settings, problem)
    )
    method = dataclasses.replace(
        method, settings=dataclasses.replace(method.settings, **of_learner), **changes
    )
    problem = dataclasses.replace(problem, **of_problem)
    return Variant(factor, setting, problem, method)


EQUAL_WEIGHTS = 87
"""Neurons of the cascade that has as many weights as two layers of 64: 5,307 and 5,377."""

ABLATIONS = (
    variant("as chosen", ""),
    variant("targets", "of V alone (w = 0)", slope_weight=0.0),
    variant("targets", "of the gradient alone", value_weight=0.0),
    variant("lookahead", "none (l = 0)", s_lambda=math.inf),
    variant("lookahead", "to the end (l = 1)", s_lambda=0.0),
    variant("lookahead", "s_lambda 3", s_lambda=3.0),
    variant("horizon", "1,024 trajectories of 12 steps", trajectories=1024, steps=12),
    variant("horizon", "256 trajectories of 50 steps", trajectories=256, steps=50),
    variant("horizon", "128 trajectories of 100 steps", trajectories=128, steps=100),
    variant("batch", "minibatches of 128", minibatch=128),
    variant("batch", "minibatches of 2,048", minibatch=2048),
    variant("batch", "2 passes", passes=2),
    variant("network", "2 layers of 32", layers=(32, 32)),
    variant("network", "2 layers of 128", layers=(128, 128)),
    variant("network", "cascade of 60", layers=None, neurons=60),
    variant("network", f"cascade of {EQUAL_WEIGHTS}", layers=None, neurons=EQUAL_WEIGHTS),
    variant("s_gamma", "0.3", s_gamma=0.3),
    variant("s_gamma", "1", s_gamma=1.0),
    variant("trials", "of 5 s", trial_duration=5.0),
    variant("trials", "of 20 s", trial_duration=20.0),
    variant("exploration", "5 % of controls flipped", flips=0.05),
    variant("learning rate", "constant", half_life=1e9),
    variant("initial states", "straight", initial_law="straight"),
    variant("initial states", "gliding", initial_law="gliding"),
)
LASTING = (ABLATIONS[0], variant("learning rate", "1e-4 at least", final_rate=1e-4))
LINKS = tuple(variant("links", str(n), parameters=SwimmerParameters(n_links=n)) for n in (3, 4, 5, 6, 10))


def count_weights(network: ValueNetwork) -> int:
    """Weights that can change: of a cascade, those of its connections."""
    if isinstance(network, Cascade):
        return int(network.connected.sum())
    return sum(w.numel() for w in network.parameters())


def _reach(learner: ValueGradientLearner, steps: int) -> bool:
    """Learn until so many steps are simulated; False if the learner has diverged."""
    try:
        while learner.simulation_steps < steps:
            learner.step()
    except FloatingPointError:
        return False
    return True


def learn(one: Variant, seed: int, looks: Sequence[int], threads: int | None = None) -> list[Row]:
    """Learn, and look at the learner when it has simulated so many steps of 0.01 s; rows of :data:`COLUMNS`."""
    if threads is not None:
        torch.set_num_threads(threads)
    problem, settings = one.problem, one.method.settings
    network = one.method.network(problem, seed)
    n_weights = count_weights(network)
    to_compile = ValueGradientLearner(problem, copy.deepcopy(network), settings)
    _reach(to_compile, 1)  # is not timed
    learner = ValueGradientLearner(problem, network, settings, seed=seed)
    states = evaluation_states(problem.parameters.n_links)
    rows: list[Row] = []
    seconds, sound = 0.0, True
    for look in looks:
        started = time.process_time()
        sound = sound and _reach(learner, look)
        seconds += time.process_time() - started
        speed, last = (
            float(learner.rollout(states, EPISODE_DURATION, skip=SETTLING_TIME, averaged=averaged).mean())
            if sound
            else math.nan
            for averaged in (True, False)
        )
        steps = learner.simulation_steps if sound else look
        rows.append((one.factor, one.setting, seed, n_weights, steps, seconds, speed, last))
    return rows


def _logged(log: Path) -> dict[tuple[str, str, int], list[Row]]:
    """The learners of a log, with their rows."""
    if not log.exists():
        return {}
    table = read_table(log)
    rows = list(zip(*(table[name].tolist() for name in COLUMNS), strict=True))
    learners: dict[tuple[str, str, int], list[Row]] = {}
    for row in rows:
        learners.setdefault((str(row[0]), _text(row[1]), int(row[2])), []).append(row)
    return learners


def _text(cell: str | float) -> str:
    """A setting as it was written: tables read numbers where all cells are numbers."""
    return cell if isinstance(cell, str) else f"{cell:g}"


def run_study(
    log: Path,
    variants: Sequence[Variant],
    looks: Sequence[int],
    seeds: Sequence[int],
    report: Callable[[str], None],
    workers: int | None = None,
) -> None:
    """Learn with every variant and seed that ``log`` does not have, on all cores, and write it as they are done.

    Others that are in the log stay there, after those asked for; what there is of an interrupted learner stays until it
    is learned anew.
    """
    learners = _logged(log)
    finished = {key for key, rows in learners.items() if float(rows[-1][4]) >= looks[-1]}
    order = [(one.factor, one.setting, seed) for seed in seeds for one in variants]
    todo = [
        (one, seed) for seed in seeds for one in variants if (one.factor, one.setting, seed) not in finished
    ]

    def write() -> None:
        rows: Iterator[Row] = (
            (row[0], _text(row[1]), *row[2:])
            for key in dict.fromkeys([*order, *learners])
            for row in learners.get(key, [])
        )
        write_table(log, COLUMNS, rows)

    for one, seed, rows in _learned(todo, looks, workers or os.cpu_count() or 1):
        learners[one.factor, one.setting, seed] = rows
        write()
        *_, seconds, speed, _ = rows[-1]
        came_to = "diverged" if math.isnan(float(speed)) else f"{speed:.2f} m/s"
        report(f"{one.label}, seed {seed}: {came_to} after {seconds:.0f} s")
    write()


def _learned(
    todo: Sequence[tuple[Variant, int]], looks: Sequence[int], workers: int
) -> Iterator[tuple[Variant, int, list[Row]]]:
    """Each learner as it is done, one in this process after the other or ``workers`` at a time in others."""
    if workers == 1:
        for one, seed in todo:
            yield one, seed, learn(one, seed, looks)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(learn, one, seed, looks, 1): (one, seed) for one, seed in todo}
        for future in as_completed(futures):
            yield *futures[future], future.result()


def _every(first: int, last: int, factor: float) -> tuple[int, ...]:
    """Looks from ``first`` to ``last``, each ``factor`` times as late as the one before."""
    count = max(1, round(math.log(last / first) / math.log(factor)))
    return tuple(int(look) for look in np.geomspace(first, last, count + 1).round())


def ablation(
    directory: str | os.PathLike[str] = LOGS,
    *,
    variants: Sequence[Variant] = ABLATIONS,
    looks: Sequence[int] = _every(MILLION // 4, 4 * MILLION, 1.5),
    seeds: Sequence[int] = SEEDS,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """One setting changed at a time; 4 million steps each. Some 80 minutes of one core."""
    run_study(Path(directory) / ABLATION_LOG, variants, looks, seeds, report)


def links(
    directory: str | os.PathLike[str] = LOGS,
    *,
    variants: Sequence[Variant] = LINKS,
    looks: Sequence[int] = _every(MILLION // 2, 10 * MILLION, 1.3),
    seeds: Sequence[int] = SEEDS,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """3 to 10 links; 10 million steps each. Some 30 minutes of one core."""
    run_study(Path(directory) / LINKS_LOG, variants, looks, seeds, report)


def lasting(
    directory: str | os.PathLike[str] = LOGS,
    *,
    variants: Sequence[Variant] = LASTING,
    looks: Sequence[int] = tuple(range(MILLION, 150 * MILLION + 1, MILLION)),
    seeds: Sequence[int] = SEEDS,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """150 million steps each. Some 3 hours of one core."""
    run_study(Path(directory) / LASTING_LOG, variants, looks, seeds, report)
