"""Where dm_control is missing, what needs it says so in one line with the way out, and all else works."""

import collections
import subprocess
import sys

import pytest

from swimmer_mj.needs import MissingDmControlError

WITHOUT = """
import sys
sys.modules["dm_control"] = None  # as if it were not installed
from swimmer_mj.render.backend import use_backend
use_backend()
"""


def without_dm_control(code):
    return subprocess.run([sys.executable, "-c", WITHOUT + code], capture_output=True, text=True)


@pytest.mark.parametrize("use", ["swimmer_mj.load('swim5')", "swimmer_mj.register()", "swimmer_mj.SUITE"])
def test_the_tasks_say_what_they_need(use):
    done = without_dm_control(f"import swimmer_mj\n{use}")
    assert "needs dm_control, which" in done.stderr.splitlines()[-1]
    assert "gymnasium.make" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        ["view", "swim5"],
        ["train", "--out", "run", "--problem", "dm_control/cartpole/swingup", "--method", "value-gradient"],
    ],
)
def test_the_commands_say_what_they_need(tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    done = without_dm_control(f"from swimmer_mj.cli import main\nsys.exit(main({arguments}))")
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("swimmer-mj: ")
    assert "needs dm_control, which" in line
    assert not [*tmp_path.iterdir()]


def test_environments_and_evaluation_do_without(tmp_path):
    code = f"""
import gymnasium, numpy as np, swimmer_mj.gymnasium
from swimmer_mj.cli import main
env = gymnasium.make("swimmer_mj/Steer3-v0", render_mode="rgb_array", width=64, height=48)
envs = gymnasium.make_vec("swimmer_mj/Steer3-v0", 2)
env.reset(seed=0), envs.reset(seed=0)
print(env.step(np.ones(2, np.float32))[0].shape, envs.step(np.ones((2, 2), np.float32))[0].shape, env.render().shape)
env.close(), envs.close()
status = main(["evaluate", "swim3-paper", "--episodes", "2"])
status |= main(["page", "swim3-paper", "--out", {str(tmp_path / "swim.html")!r}])
sys.exit(status)
"""
    done = without_dm_control(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("(8,) (2, 8) (48, 64, 3)\n")


@pytest.mark.parametrize(
    ("version", "way"),
    [
        ((3, 12), "is not installed: pip install dm-control"),
        ((3, 14), "from 3.13 on): use Python 3.11 or 3.12"),
    ],
)
def test_the_way_out_is_that_of_the_python(monkeypatch, version, way):
    info = collections.namedtuple("version_info", "major minor")(*version)
    monkeypatch.setattr(sys, "version_info", info)
    assert way in str(MissingDmControlError("view"))
    assert str(MissingDmControlError("view", "render")).endswith(", or render")
