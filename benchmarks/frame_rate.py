"""How many frames of a video are drawn in a second on one core?

    python benchmarks/frame_rate.py

Draws the same episode of five links at the sizes of ``swimmer-mj render``: the water alone, with the overlay, beside a
second swimmer; and encodes it. Everything runs on one core, ffmpeg too. Frames per second of processor time are what
an idle core makes; the clock's are lower on a machine that has other work. Prints a table and writes
benchmarks/results/frame-rate.json.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.render.backend import use_backend
from swimmer_mj.trajectory import Trajectory

OUT = Path(__file__).parent / "results" / "frame-rate.json"
SIZES = ((640, 480), (1280, 720), (1920, 1080))
FRAMES = {480: 90, 720: 20, 1080: 10}
"""By the height."""
ENCODED = 390
"""As many as a video of 13 s has; the start of ffmpeg and the graphs of the overlay are in its time."""
REPEATS = 3
DURATION = 6.0
"""s of the episode."""


def one_core() -> None:
    """Stay on one core, where the system can say so; children inherit it."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def processor_time() -> float:
    """Of this process and its children that have ended, s."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def rate(work: Callable[[], None], count: int) -> tuple[float, float]:
    """Frames per second of processor time and of the clock: the best of several times."""
    found = []
    for _ in range(REPEATS):
        clock, used = time.perf_counter(), processor_time()
        work()
        found.append((count / (processor_time() - used), count / (time.perf_counter() - clock)))
    processor, wall = zip(*found, strict=True)
    return max(processor), max(wall)


def episodes() -> list[Trajectory]:
    """Of the two policies of five links that come with the package."""
    from swimmer_mj.learning.pretrained import pretrained_directory
    from swimmer_mj.learning.problems.forms import SwimmerForm
    from swimmer_mj.learning.runs.run import load_policy

    found = []
    for name in ("swim5-value-gradient", "swim5-paper"):
        policy, config, _ = load_policy(pretrained_directory(name))
        swimmer = config.problem.form(SwimmerForm)
        assert swimmer is not None
        found.append(swimmer.record(policy, DURATION))
    return found


def main() -> None:
    """Print the table and write the log."""
    one_core()
    backend = use_backend()
    first, second = episodes()

    from swimmer_mj.render.video import frames, write_video

    def draw(count: int, **look: object) -> Callable[[], None]:
        pending: Iterator[object] = frames(first, fps=REPEATS * count / DURATION + 1, **look)  # type: ignore[arg-type]
        next(pending)  # the context and the panel are made

        def some() -> None:
            for _ in itertools.islice(pending, count):
                pass

        return some

    rows = []
    for width, height in SIZES:
        size, samples, count = {"width": width, "height": height}, 0 if height == 480 else 4, FRAMES[height]
        looks = {
            "water": {**size, "samples": samples},
            "overlay": {**size, "samples": samples, "overlay": True},
            "overlay, two swimmers": {**size, "samples": samples, "overlay": True, "against": second},
        }
        for what, look in looks.items():
            rows.append((f"{width}x{height}", what, *rate(draw(count, **look), count)))
    with tempfile.TemporaryDirectory() as folder:
        for suffix, overlay in ((".mp4", False), (".mp4", True), (".gif", True), (".webp", True)):
            path = Path(folder) / f"swim{suffix}"

            def encode(path: Path = path, overlay: bool = overlay) -> None:
                write_video(path, frames(first, overlay=overlay, fps=ENCODED / DURATION), 30)

            what = f"{'overlay' if overlay else 'water'}, drawn and written as {suffix}"
            rows.append(("640x480", what, *rate(encode, ENCODED)))
    table = Table("size", "what", "frames/s of processor time", "frames/s by the clock")
    for size, what, processor, wall in rows:
        table.add_row(size, what, f"{processor:.1f}", f"{wall:.1f}")
    Console().print(table)
    keys = ("size", "what", "frames_per_processor_second", "frames_per_second")
    log = {
        "backend": backend,
        "machine": platform.machine(),
        "frames": FRAMES,
        "rows": [dict(zip(keys, row, strict=True)) for row in rows],
    }
    with replacing(OUT) as partial:
        partial.write_text(json.dumps(log, indent=1) + "\n", encoding="utf-8")
    note_made(OUT)


if __name__ == "__main__":
    main()
