"""TensorBoard's events are the rows of metrics.csv."""

import csv
import struct

import pytest

from swimmer_mj.cli import main
from swimmer_mj.learning.runs import events

pytest.importorskip("tensorboardX")
SMALL = ["--problem", "pendulum", "--neurons", "4", "--set", "trial_duration=0.5", "--evaluate-every", "10"]


def read_events(directory):
    """{tag: [(trial, seconds, value)]} of the one file in ``directory``, by the format of its records."""
    from tensorboardX.proto.event_pb2 import Event

    (file,) = directory.iterdir()
    data, found = file.read_bytes(), {}
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        event = Event.FromString(
            data[12 : 12 + length]
        )  # its length and a checksum stand before, a checksum after
        data = data[16 + length :]
        for value in event.summary.value:
            found.setdefault(value.tag, []).append((event.step, event.wall_time, value.simple_value))
    return found


def assert_same_rows(run):
    found = read_events(run / events.EVENTS)
    with open(run / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert found.keys() == {"mean_value", "mean_squared_hamiltonian", "speed"}
    for name, column in found.items():
        wanted = [(int(row["trial"]), float(row["seconds"]), float(row[name])) for row in rows]
        assert column == [pytest.approx(row, rel=1e-6) for row in wanted]
    return len(rows)


def test_events_say_what_the_log_says_after_resuming_too(tmp_path, capsys):
    run = tmp_path / "run"
    assert main(["train", "--out", str(run), *SMALL, "--trials", "20", "--tensorboard"]) == 0
    assert assert_same_rows(run) == 2
    assert main(["train", "--out", str(run), "--resume", "--trials", "30"]) == 0  # the events lack a row now
    assert main(["train", "--out", str(run), "--resume", "--trials", "50", "--tensorboard"]) == 0
    assert assert_same_rows(run) == 5


def test_without_the_package_it_says_so_before_anything_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(events.importlib.util, "find_spec", lambda name: None)
    assert main(["train", "--out", str(tmp_path / "run"), *SMALL, "--tensorboard"]) == 2
    assert 'needs tensorboardX: pip install "swimmer-mj[tensorboard]"' in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
