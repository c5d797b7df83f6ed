"""By what logs were made."""

import csv
import platform
import re
import shlex
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest

from swimmer_mj.learning.experiments import EXPERIMENTS, LOGS, made

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "benchmarks" / "results"


@pytest.mark.parametrize(
    ("argv", "command"),
    [
        (["/somewhere/benchmarks/x.py", "--seeds", "1"], "python benchmarks/x.py --seeds 1"),
        (["x.py", "--out", "/somewhere/y.csv", "--seconds", "2"], "python benchmarks/x.py --seconds 2"),
        (["x.py", "--out=/somewhere/y.csv", "a b"], "python benchmarks/x.py 'a b'"),
        (["/somewhere/bin/swimmer-mj", "validate"], "swimmer-mj validate"),
    ],
)
def test_commands_are_told_without_places(argv, command):
    assert made.command_line(argv) == command


def test_each_way_is_noted_once(tmp_path, monkeypatch):
    for command in ("one", "two", "one"):
        made.note_made(tmp_path / "log.csv", command)
    made.note_made(tmp_path / "other.csv", "one")
    monkeypatch.setattr(made, "version", lambda package: f"later {package}")
    made.note_made(tmp_path / "log.csv", "one")
    found = made.ways(tmp_path)
    assert [way["command"] for way in found["log.csv"]] == ["one", "two", "one"]
    assert [way["mujoco"] for way in found["log.csv"]] == [version("mujoco")] * 2 + ["later mujoco"]
    assert found["other.csv"][0]["python"] == platform.python_version()
    assert made.ways(tmp_path / "nowhere") == {}


def test_the_commit_of_the_code_is_noted(tmp_path, monkeypatch):
    def git(*arguments):
        name = ("-c", "user.name=one", "-c", "user.email=one@example.org")
        subprocess.run(["git", *name, *arguments], cwd=tmp_path, check=True, capture_output=True)

    code = tmp_path / "folder" / "code.py"
    code.parent.mkdir()
    code.write_text("one = 1")
    assert made.commit(code) == ""
    git("init")
    assert made.commit(code) == "", "it is in no commit"
    git("add", ".")
    git("commit", "-m", "one")
    head = made.commit(code)
    assert re.fullmatch("[0-9a-f]{7,}", head)
    (code.parent / "log.csv").write_text("results change nothing")
    (tmp_path / "other.py").write_text("nor does what git does not know")
    assert made.commit(code) == head
    code.write_text("one = 2")
    assert made.commit(code) == f"{head}+"
    monkeypatch.setenv("PATH", "")
    assert made.commit(code) == ""


@pytest.mark.parametrize("folder", [RESULTS, LOGS])
def test_every_log_says_how_it_was_made(folder):
    logs = {path.name for path in folder.iterdir()} - {made.MADE}
    assert {*made.ways(folder)} == logs


@pytest.mark.parametrize("folder", [RESULTS, LOGS])
def test_what_made_them_is_there(folder):
    with (folder / made.MADE).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert all(row["swimmer-mj"] and row["commit"] for row in rows)
    for row in rows:
        first, *rest = shlex.split(row["command"])
        if first == "python":
            assert (ROOT / rest[0]).is_file(), row
        elif rest[0] == "figures":
            assert row["log"] in EXPERIMENTS[rest[1]].logs, row
