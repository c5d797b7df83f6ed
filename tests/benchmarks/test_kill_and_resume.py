"""A short version of benchmarks/kill_and_resume.py: its long one is run by hand."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "benchmarks" / "kill_and_resume.py"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the tool forks")


def test_runs_that_are_killed_compute_the_same_bits():
    command = [
        sys.executable,
        "-W",
        "ignore",
        TOOL,
        "--kills",
        "3",
        "--targets",
        "td",
        "--kinds",
        "random",
        "files",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    found = json.loads(done.stdout)
    assert (done.returncode, found["wrong"]) == (0, []), done.stderr
    assert found["kills while learning"] == found["kills while saving all the time"] == 3
    assert found["kills at a file"] >= 3 * 9


def test_a_difference_is_noticed():
    from kill_and_resume import differences

    one = {"weight": b"12", "files": ["a"], "only": 1}
    assert differences(one, dict(one)) == []
    assert differences(one, {"weight": b"13", "files": ["a"]}) == ["only", "weight"]
