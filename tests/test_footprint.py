"""What the commands touch: no network, and no file outside what they are told and the user's caches."""

import os
import socket
import sys
import tempfile
from pathlib import Path

import matplotlib
import pytest

from swimmer_mj.cli import main
from swimmer_mj.compiled import cache

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
CHANGING = (
    "os.mkdir",
    "os.rename",
    "os.remove",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
)
NETWORK = ("socket.connect", "socket.sendto", "socket.bind", "socket.getaddrinfo", "socket.gethostbyname")
seen: list[str] | None = None
"""Paths and addresses while somebody watches; an audit hook cannot be taken away again."""


def watch(event, arguments):
    if seen is None:
        return
    if event in NETWORK:
        seen.append(f"{event} {arguments[1:]}")
        raise PermissionError("there is no network here")
    if event == "open" and isinstance(arguments[2], int) and arguments[2] & WRITING:
        note(arguments[0])
    elif event in CHANGING:
        note(arguments[0])
        if event == "os.rename":
            note(arguments[1])


def note(path):
    if isinstance(path, str | bytes | os.PathLike) and os.fsdecode(path) != os.devnull:
        seen.append(os.path.abspath(os.fsdecode(path)))


@pytest.fixture(scope="module", autouse=True)
def hook():
    sys.addaudithook(watch)


@pytest.fixture
def touched(monkeypatch, tmp_path):
    """Everything that is touched during a test, but for the run's directory and the caches."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "temporary").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(sys.modules[__name__], "seen", [])
    allowed = [tmp_path / "run", tmp_path / "temporary", cache.directory(), Path(matplotlib.get_cachedir())]

    def others():
        found = {place for place in seen if "__pycache__" not in place}  # Python's own
        return sorted(
            place for place in found if not any(Path(place).is_relative_to(inside) for inside in allowed)
        )

    yield others
    assert not list((tmp_path / "elsewhere").iterdir())
    assert not list((tmp_path / "temporary").iterdir())


SMALL = ["--problem", "pendulum", "--neurons", "4", "--set", "trial_duration=0.5", "--evaluate-every", "10"]


def test_a_run_and_its_pictures_touch_its_directory_alone(tmp_path, touched, capsys):
    run = str(tmp_path / "run")
    assert main(["train", "--out", run, *SMALL, "--trials", "20"]) == 0
    assert main(["train", "--out", run, "--resume", "--trials", "30"]) == 0
    assert main(["evaluate", run, "--episodes", "2"]) == 0
    assert main(["info", run]) == 0
    assert main(["render", run, "--picture", "learning-curve"]) == 0
    assert (tmp_path / "run" / "learning-curve.png").exists()
    assert touched() == []


def test_a_page_is_one_file(tmp_path, touched, capsys):
    (tmp_path / "run").mkdir()
    assert main(["page", "swim3-value-gradient", "--out", str(tmp_path / "run" / "swim.html")]) == 0
    assert touched() == []


STIFF = """<mujoco><option timestep="0.05"/>
<worldbody><body><joint name="hinge" axis="0 1 0" stiffness="1e5"/><geom size="0.1"/></body></worldbody>
<actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator></mujoco>"""


def test_mujoco_writes_no_log_of_its_own(tmp_path, touched, monkeypatch, capsys):
    """It would without passing by Python: MUJOCO_LOG.TXT where the process is."""
    (tmp_path / "run").mkdir()
    (tmp_path / "stiff.xml").write_text(STIFF)
    (tmp_path / "my_reward.py").write_text("def reward(at):\n    return -(at.qpos[..., 0] ** 2)\n")
    monkeypatch.syspath_prepend(tmp_path)
    model = ["--problem", str(tmp_path / "stiff.xml"), "--reward", "my_reward:reward", "--method", "td"]
    run = ["--out", str(tmp_path / "run"), "--neurons", "4", "--trials", "2"]
    assert main(["train", *model, *run]) == 1
    said = capsys.readouterr()
    assert "unstable" not in said.out
    assert said.err.count("MuJoCo: ") == 1  # of several alike
    assert "no longer finite" in said.err


def test_what_is_touched_elsewhere_would_be_noticed(tmp_path, touched):
    (tmp_path / "file").write_text("")
    (tmp_path / "file").rename(tmp_path / "other")
    os.mkdir(tmp_path / "folder")
    with pytest.raises(PermissionError), socket.socket() as one:
        one.connect(("127.0.0.1", 9))
    assert [Path(place).name for place in touched() if place.startswith("/")] == ["file", "folder", "other"]
    assert any("socket.connect" in place for place in touched())
