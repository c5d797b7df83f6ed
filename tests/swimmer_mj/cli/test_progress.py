"""What is seen of runs that learn."""

import math
import re

import pytest
from rich.console import Console

from swimmer_mj.cli.progress import time_left, time_words
from swimmer_mj.cli.training import train_runs
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences


@pytest.mark.parametrize(
    ("trials_left", "trials", "seconds", "left"),
    [(100, 50, 2.0, 4.0), (0, 50, 2.0, 0.0), (-3, 50, 2.0, 0.0), (100, 0, 2.0, math.inf), (None, 5, 2.0, math.inf)],
)  # fmt: skip
def test_time_left_is_as_it_went_so_far(trials_left, trials, seconds, left):
    assert time_left(trials_left, trials, seconds) == left


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (725, "12 min 5 s"),
        (12000, "3 h 20 min"),
        (-1, "0 s"),
    ],
)
def test_times_are_said_as_people_say_them(seconds, words):
    assert time_words(seconds) == words


def train(directory, tmp_path, **terminal):
    method = TemporalDifferences(TDSettings(trial_duration=0.5), 4)
    run = TrainingRun(directory, RunConfig(Pendulum(), method, 0, 40))
    with open(tmp_path / "shown", "w", encoding="utf-8") as file:
        train_runs(Console(file=file, width=150, highlight=False, **terminal), [run], trials=200)
    return (tmp_path / "shown").read_text(encoding="utf-8")


def test_a_terminal_has_a_table_with_the_time_left(tmp_path):
    shown = train(tmp_path / "run", tmp_path, force_terminal=True)
    last = shown.rpartition("left")[2]  # the table as it was drawn last
    assert "\x1b[" in shown
    assert re.search(r"200 +\d+ +[\d a-z]+ +0 s +-?\d\.\d{3}", last)


def test_elsewhere_there_are_plain_lines(tmp_path):
    first, *lines = train(tmp_path / "run", tmp_path).splitlines()
    assert first.startswith("learning begins, ")
    assert len(lines) == 5
    for k, line in enumerate(lines, start=1):
        assert re.fullmatch(
            rf"run run  trials {40 * k}  trials/s \d+  elapsed [\d a-z]+  (left [\d a-z]+  )?"
            r"<V> -?[\d.]+  <H²> [\d.]+  reward -?[\d.]+  best -?[\d.]+",
            line,
        )
    assert "left 0 s" in lines[-1]
