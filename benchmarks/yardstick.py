"""What learners are held against: swimming speed, the time that they took, and a row for each look at them."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.environments.vector import SwimmerVectorEnv
from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.problem import N_EPISODES
from swimmer_mj.learning.problems.swim.environment import (
    SPEED,
    STEADY,
    SwimmingPolicy,
    SwimmingSpeed,
    distances,
    evaluation_states,
    mean_speed,
)
from swimmer_mj.parameters import PAPER, SwimmerParameters

CONTROL_TIMESTEP = 0.01  # s

COLUMNS = (
    "algorithm",
    "seed",
    "cpu_seconds",
    "wall_seconds",
    "simulation_steps",
    "speed",
    "ci95_low",
    "ci95_high",
)

Row = tuple[str | int, ...]


class Clock:
    """Time that runs only between start and stop: of this process's processor, and on the wall."""

    def __init__(self) -> None:
        self.before = (0.0, 0.0)
        self.start()

    def start(self) -> None:
        """Go on."""
        self.started = (time.process_time(), time.perf_counter())

    def read(self) -> tuple[float, float]:
        """Seconds so far."""
        now = (time.process_time(), time.perf_counter())
        processor, wall = (
            before + t - t0 for before, t, t0 in zip(self.before, now, self.started, strict=True)
        )
        return processor, wall

    def stop(self) -> None:
        """Stand still."""
        self.before = self.read()


def looks(learn: Callable[[], object], times: Sequence[float], seconds: float) -> Iterator[Clock]:
    """Learn until each of those ``times`` that come before ``seconds``, and then until that; s of the processor.

    The clock, which stands still during a look.
    """
    clock = Clock()
    for look in (*(at for at in times if at < seconds), seconds):
        while clock.read()[0] < look:
            learn()
        clock.stop()
        yield clock
        clock.start()


def finished(out: Path, columns: tuple[str, ...] = COLUMNS, count: int = 2) -> set[tuple[str, ...]]:
    """The first ``count`` columns of what ``out`` has already; an empty table is made where there is none."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(",".join(columns) + "\n")
    with out.open(newline="") as file:
        return {tuple(row[column] for column in columns[:count]) for row in csv.DictReader(file)}


def append(out: Path, rows: Iterable[Row]) -> None:
    """Add the rows of a learner, when it is done."""
    done = list(rows)
    with out.open("a", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(done)
    note_made(out)


def fill(
    out: Path, columns: tuple[str, ...], keys: Iterable[tuple[Any, ...]], learn: Callable[..., Iterable[Row]]
) -> None:
    """Add ``learn(*key)`` of each key, the first columns of its rows, of which ``out`` has none."""
    for key in keys:
        if tuple(map(str, key)) not in finished(out, columns, len(key)):
            append(out, learn(*key))


def row(algorithm: str, seed: int, clock: Clock, simulation_steps: int, speed: SwimmingSpeed) -> Row:
    """One look at a learner, in the order of :data:`COLUMNS`; the clock stands still."""
    processor, wall = clock.before
    numbers = map("{:.4f}".format, (speed.mean, *speed.ci95))
    return (algorithm, seed, f"{processor:.1f}", f"{wall:.1f}", simulation_steps, *numbers)


def swimming_and_steady_speed(policy: Policy, parameters: SwimmerParameters = PAPER) -> tuple[float, float]:
    """Mean speeds over the last 10 of 20 s and over seconds 30 to 60, m/s, as ``evaluate`` has them, on one core."""
    starts = evaluation_states(parameters.n_links)[:N_EPISODES]
    travelled = distances(SwimmingPolicy(policy, batches=True), parameters, starts, STEADY[1], 1)
    speed, steady = (float(mean_speed(travelled, *span).mean()) for span in (SPEED, STEADY))
    return speed, steady


def swimming_speed(
    act: Callable[[NDArray[np.float64]], NDArray[np.floating]],
    parameters: SwimmerParameters = PAPER,
) -> SwimmingSpeed:
    """The number of ``swimmer_mj.learning.runs.evaluation.evaluate_swimming``, sooner, on one core.

    As :func:`swimming_speeds`, over the last 10 of 20 s.
    """
    (speed,) = swimming_speeds(act, (SPEED,), parameters)
    return speed


def swimming_speeds(
    act: Callable[[NDArray[np.float64]], NDArray[np.floating]],
    spans: Sequence[tuple[float, float]],
    parameters: SwimmerParameters = PAPER,
    *,
    hold: int = 1,
) -> list[SwimmingSpeed]:
    """Mean velocities along x over some spans of time of the same episodes.

    The 64 episodes are one vector environment, whose dynamics and rewards are those of the dm_control task, number
    for number: tests/swimmer_mj/environments/test_gymnasium.py.

    Parameters
    ----------
    act : callable
        From states (64, 2n + 2) to actions in [-1, 1], shape (64, n - 1).
    spans : sequence of (float, float)
        From when to when, s.
    parameters : SwimmerParameters
        The swimmer: 3, 4 or 5 links.
    hold : int
        Control steps for which an action is held.
    """
    starts = iter(evaluation_states(parameters.n_links))
    swimmers = SwimmerVectorEnv(
        f"swim{parameters.n_links}",
        N_EPISODES,
        nthread=1,
        params=parameters,
        frame_skip=hold,
        initial_states=lambda _: next(starts),
    )
    steps = [[round(t / (CONTROL_TIMESTEP * hold)) for t in span] for span in spans]
    n_steps = max(last for _, last in steps)
    rewards = np.zeros((n_steps, N_EPISODES))
    states, _ = swimmers.reset(seed=0)
    for t in range(n_steps):
        states, rewards[t], *_ = swimmers.step(act(states).astype(np.float64))
    swimmers.close()
    speeds = [rewards[first:last].mean(axis=0) for first, last in steps]
    return [SwimmingSpeed(some, *mean_and_interval(some)) for some in speeds]
