"""How fast can a swimmer be? The best periodic gaits that many starts lead to (docs/gaits.md).

    python benchmarks/best_gaits.py --links 5
    python benchmarks/best_gaits.py --links 5 --refine    # the best ones again, on a grid twice as fine

Needs CasADi (``pip install swimmer-mj[gaits]``). Every solve is a row of learning/experiments/logs/gaits.csv; what is
there is not solved again, so that a run can be stopped and goes on. The best are kept in
learning/experiments/gaits/best. One core.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import tyro

from swimmer_mj.learning.experiments.gaits import starts
from swimmer_mj.learning.experiments.gaits.gait import BEST, GLIDE, Gait, load_gaits, save_gaits
from swimmer_mj.learning.experiments.gaits.transcription import Program, Solution
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import LOGS
from swimmer_mj.learning.pretrained import load_pretrained, pretrained_card, pretrained_swimmers
from swimmer_mj.parameters import SwimmerParameters

LOG = LOGS / "gaits.csv"
COLUMNS = (
    "links", "speed", "start", "intervals", "start_duration", "duration", "pull", "kkt_residual", "iterations",
    "cpu_seconds", "status",
)  # fmt: skip
SPEEDS = (2.0, 1.0, 3.0)
"""m/s, in the order in which they are worked off."""
CONVERGED = 1e-6
"""The largest KKT residual of a gait that is kept."""
Start = tuple[str, Callable[[], Gait]]


def candidates(links: int, speed: float, n_intervals: int) -> Iterator[Start]:
    """Names, and what makes the starts."""
    p = SwimmerParameters(n_links=links)
    for other in sorted(SPEEDS, key=lambda v: abs(v - speed))[1:3]:
        if (gait := load_gaits(place(links)).get(other)) is not None:
            yield f"best at {other:g} m/s, {gait.pull:.4f}", partial(starts.at_speed, gait, speed)
    if (gait := load_gaits(place(links - 1)).get(speed)) is not None:
        yield f"best of {links - 1} links, {gait.pull:.4f}", partial(starts.with_a_link_more, gait)
    for duration, lag in ((2.0, 1.5), (1.0, 1.5), (1.0, 0.9), (2.0, 2.5)):
        yield f"wave {duration:g} s, {lag:g} rad", partial(starts.wave, p, duration, lag, n_intervals)
    rng = np.random.default_rng([links, round(100 * speed)])
    yield "random", partial(starts.random_motion, p, rng, n_intervals)
    for name in pretrained_swimmers():
        steady = pretrained_card(name)["swimming_speed"]
        if name.startswith(f"swim{links}-") and speed == min(SPEEDS, key=lambda v: abs(v - steady)):
            yield name, partial(learned_stroke, name)


def learned_stroke(name: str) -> Gait:
    """Of a shipped policy."""
    return starts.learned_stroke(load_pretrained(name).policy, 0)


def place(links: int) -> Path:
    """Where the best gaits of a swimmer are."""
    return BEST / f"swim{links}.npz"


def solved() -> set[tuple[int, float, str, int]]:
    """What is in the log."""
    if not LOG.exists():
        return set()
    with LOG.open(newline="", encoding="utf-8") as file:
        return {
            (int(r["links"]), float(r["speed"]), r["start"], int(r["intervals"]))
            for r in csv.DictReader(file)
        }


def keep(links: int, speed: float, start: str, began: Gait, n_intervals: int, solution: Solution) -> None:
    """A row in the log; the gait, if it is the best that has converged."""
    gait = solution.gait
    new = not LOG.exists()
    with LOG.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerow(
            (links, f"{speed:g}", start, n_intervals, f"{began.duration:.4g}", f"{gait.duration:.6g}",
             f"{gait.pull:.6g}", f"{solution.kkt_residual:.2g}", solution.iterations, f"{solution.seconds:.1f}",
             solution.status)
        )  # fmt: skip
    note_made(LOG)
    best = load_gaits(place(links))
    swims = solution.kkt_residual <= CONVERGED and gait.pull > GLIDE
    if swims and (speed not in best or gait.pull > best[speed].pull):
        save_gaits({**best, speed: gait}, place(links))


def main(
    links: int = 5,
    intervals: int = 40,
    speeds: tuple[float, ...] = SPEEDS,
    most: int = 100,
    refine: bool = False,
) -> None:
    """Search.

    Args:
        links: Of the swimmer.
        intervals: Of a stroke.
        speeds: Mean speeds along x, m/s.
        most: Starts at each speed.
        refine: Only from the best, on a grid twice as fine; logged, not kept.
    """
    program = Program(SwimmerParameters(n_links=links), intervals)
    if refine:
        program = Program(SwimmerParameters(n_links=links), 2 * intervals)
    for speed in speeds:
        offered: Iterator[Start] = iter([])
        if not refine:
            offered = candidates(links, speed, intervals)
        elif (best := load_gaits(place(links)).get(speed)) is not None:
            offered = iter([("the best", lambda best=best: best)])
        for i, (name, make) in enumerate(offered):
            if i >= most or (links, speed, name, program.n_intervals) in solved():
                continue
            start = starts.at_speed(make(), speed)
            solution = program.solve(start, speed)
            if refine:
                print(f"{solution.gait.pull / start.pull - 1:+.2%} of the pull on the finer grid")
            keep(links, speed, name, start, program.n_intervals, solution)
            gait = solution.gait
            print(
                f"{links} links, {speed:g} m/s, {name}: {gait.pull:.4f} m/s², {gait.duration:.3f} s, "
                f"{solution.status}, KKT {solution.kkt_residual:.1e}, {solution.iterations} iterations, "
                f"{solution.seconds:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    tyro.cli(main)
