"""What do the commands say when they refuse? Each refusal is run; the page of errors has what was said.

    python benchmarks/refusals.py     # into benchmarks/results/refusals.csv; then python benchmarks/trouble.py

Everything happens in a new directory, in which RUN is a run that has learned a little; the others are damaged copies.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from swimmer_mj.cli import main
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.lock import locked
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences

OUT = Path(__file__).parent / "results" / "refusals.csv"
CASES = (
    "swim",
    "train",
    "train --out new --links 1",
    "train --out new --links 100000",
    "train --out new --links two",
    "train --out new --eta nan",
    "train --out new --neurons 0",
    "train --out new --trials 0",
    "train --out new --seconds inf",
    "train --out new --seed -1",
    "train --out new --seeds 7-0",
    "train --out new --seeds 0-100000",
    "train --out new --halve --seconds 60",
    "train --out new --method value-gradient --coordinates joints --set encoding=angle",
    "train --out new --set mass",
    "train --out new --set weight=2",
    "train --out new --set vario=1",
    "train --out new --problem pendulum --links 3",
    "train --out new --problem nowhere:Problem",
    "train --out new --problem model.xml",
    "train --out new --problem dm_control/fish/fly",
    "train --out new --device cuda",
    "train --out /proc/run",
    "train --out sweep.toml",
    "train --out RUN",
    "train --out RUN --resume --eta 0.1",
    "train --out nothing --resume",
    "train --out HELD --resume",
    "evaluate nothing",
    "evaluate RUN --episodes 0",
    "evaluate EMPTY",
    "evaluate LATER",
    "evaluate ODD",
    "evaluate STRANGER",
    "evaluate CUT",
    "evaluate FLIPPED",
    "train --out FLIPPED-CHECKPOINT --resume",
    "train --out OTHER --resume --trials 8",
    "render RUN --picture gait",
    "render RUN --overlay",
    "render RUN --duration nan",
    "render CUT-LOG --picture learning-curve",
    "page RUN",
    "page swim3-paper --out nowhere/swim.html",
    "figures figure-9",
    "sweep sweep.toml --out new --part 4/3",
    "sweep empty.toml --out new",
    "sweep unknown.toml --out new",
    "sweep sweep.toml --out new --address head:6379",
)
"""What is asked, after ``swimmer-mj``."""


class Refusal(NamedTuple):
    """A row of the log."""

    asked: str
    status: int
    said: str


def prepare(folder: Path) -> None:
    """The files that :data:`CASES` name."""
    method = TemporalDifferences(TDSettings(trial_duration=0.5), 4)
    train_together([TrainingRun(folder / "RUN", RunConfig(Pendulum(), method, 0, 4))], trials=4)
    copies = (
        "HELD",
        "EMPTY",
        "LATER",
        "ODD",
        "STRANGER",
        "CUT",
        "FLIPPED",
        "FLIPPED-CHECKPOINT",
        "OTHER",
        "CUT-LOG",
    )
    for name in copies:
        shutil.copytree(folder / "RUN", folder / name)
    (folder / "EMPTY" / "config.json").write_text("")
    config = json.loads((folder / "RUN" / "config.json").read_text())
    changes = {
        "LATER": {"schema": 99},
        "ODD": {"problem": {**config["problem"], "s_gamma": "fast"}},
        "STRANGER": {"problem": {"name": "strangers:Problem"}},
        "OTHER": {"seed": 1},
    }
    for name, change in changes.items():
        (folder / name / "config.json").write_text(json.dumps({**config, **change}))
    for name, file in (("FLIPPED", "best"), ("FLIPPED-CHECKPOINT", "checkpoint"), ("CUT", "best")):
        path = folder / name / f"{file}.safetensors"
        data = bytearray(path.read_bytes())
        data[-1] ^= 1
        path.write_bytes(data[:100] if name == "CUT" else data)
    (folder / "CUT-LOG" / "metrics.csv").write_text("trial,seconds\n1,\n")
    (folder / "model.xml").write_text("<mujoco><body/></mujoco>")
    (folder / "empty.toml").write_text("")
    (folder / "sweep.toml").write_text('problem = "pendulum"\ntrials = 20\n')
    (folder / "unknown.toml").write_text("trials = 20\nlearning_rate = 0.1\n")


def refusals() -> Iterator[Refusal]:
    """Ask for each of :data:`CASES`."""
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        prepare(Path(name))
        with locked(Path("HELD")):
            (Path("HELD") / ".owner").write_text("process 4321 on host\n")
            for asked in CASES:
                said, out = io.StringIO(), io.StringIO()
                with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
                    status = main(shlex.split(asked))
                line = said.getvalue().replace(str(Path(name).resolve()), "..").replace(name, "..")
                yield Refusal(asked, status, line.removeprefix("swimmer-mj: ").rstrip("\n"))


def write() -> int:
    """Write the log; 1 if something was not refused."""
    found = list(refusals())
    with replacing(OUT) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([Refusal._fields, *found])
    note_made(OUT)
    return int(any(one.status == 0 for one in found))


if __name__ == "__main__":
    sys.exit(write())
