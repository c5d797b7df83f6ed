"""``render`` and ``report``, from the command line to the files."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from swimmer_mj.cli import main
from swimmer_mj.cli.pictures import record
from swimmer_mj.cli.shots import Shot, parse_steering
from swimmer_mj.learning.problems.forms import SwimmerForm
from swimmer_mj.learning.runs.config import RunConfig, read_config
from swimmer_mj.learning.runs.run import load_policy

RUNS = Path(__file__).parent / "learning" / "runs" / "version-0.1"
PENDULUM, SWIMMER = RUNS / "td", RUNS / "value-gradient"


def run(capsys, *arguments):
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_a_steered_episode_has_its_directions():
    policy, config, _ = load_policy(SWIMMER)
    swimmer = config.problem.form(SwimmerForm)
    trajectory = record(policy, swimmer, Shot(1.0, steering=parse_steering("90,-45@0.4s")))
    expected = np.where(trajectory.times < 0.4 - 1e-9, np.pi / 2, -np.pi / 4)
    np.testing.assert_array_equal(trajectory.target_directions, expected)
    assert trajectory.duration == pytest.approx(1.0)


def test_two_swimmers_are_steered_slowly_in_a_gif(tmp_path, capsys):
    out = tmp_path / "race.gif"
    options = [
        "--steer",
        "0,180@0.5s",
        "--compare",
        "swim3-value-gradient",
        "--overlay",
        "--slow",
        "--fps",
        "5",
    ]
    status, reply, err = run(capsys, "render", SWIMMER, "--out", out, *options, "--json")
    assert status == 0, err
    assert json.loads(reply) == {"run": str(SWIMMER), "video": str(out)}
    with Image.open(out) as picture:
        assert (picture.size, picture.n_frames) == ((640, 480), 20)
    assert [path.name for path in tmp_path.iterdir()] == ["race.gif"]


@pytest.mark.parametrize(
    ("name", "options", "head"),
    [
        ("strip.svg", ["--duration", "1"], b"<?xml"),
        (
            "v.pdf",
            ["--duration", "1", "--picture", "value-map", "--over", "theta1", "vy", "--at", "0.5"],
            b"%PDF-",
        ),
        ("curve.png", ["--picture", "learning-curve", "--compare", "swim3-paper"], b"\x89PNG"),
    ],
)
def test_a_picture_is_written_as_its_suffix_says(tmp_path, capsys, name, options, head):
    status, reply, err = run(capsys, "render", SWIMMER, "--out", tmp_path / name, *options)
    assert (status, reply, err) == (0, f"  {tmp_path / name}\n", "")
    assert (tmp_path / name).read_bytes().startswith(head)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([PENDULUM, "--overlay"], "--overlay is for swimmers, and .* learned 'pendulum'"),
        ([PENDULUM, "--compare", "swim3-paper"], "--compare is for swimmers"),
        ([PENDULUM, "--steer", "0,90@2"], "--steer is for swimmers"),
        ([PENDULUM, "--picture", "gait"], "of which there is no gait; there are episode, learning-curve"),
        (["swim3-paper", "--compare", PENDULUM], "learned 'pendulum'; only swimmers are compared"),
        (["swim3-paper", "--compare", "nowhere"], "nowhere is not a run directory"),
        (["swim3-paper", "--over", "theta9", "vx"], "there is no coordinate 'theta9' of 3 links"),
        (["swim3-paper", "--picture", "gait", "--duration", "1"], "no stroke .* draw a longer"),
        (["nowhere", "--steer", "0,90"], "--steer must be directions"),
        (["nowhere", "--steer", "0,90@2", "--duration", "3"], "--steer takes 4 s, --duration is 3 s"),
        (["nowhere", "--out", "a.gif", "--fps", "60"], "--fps must be at most 50 for a GIF"),
        (["nowhere", "--size", "20x20"], "invalid choice '20x20'"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(tmp_path, monkeypatch, capsys, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, "render", *arguments)
    assert (status, out) == (2, "")
    assert re.search(complaint, err)
    assert err.count("\n") == 1
    assert list(tmp_path.rglob("*.*")) == []


def test_figures_into_a_file_are_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert run(capsys, "figures", "linear", "--out", out) == (
            2, "", f"swimmer-mj: {tmp_path / 'file'} is a file; choose another directory with --out\n",
        )  # fmt: skip


def test_the_report_of_a_swimmer(tmp_path, capsys):
    out = tmp_path / "new" / "report.html"
    status, reply, err = run(
        capsys, "report", SWIMMER, "--out", out, "--episodes", "2", "--duration", "1", "--json"
    )
    assert status == 0, err
    found = json.loads(reply)
    text = out.read_text(encoding="utf-8")
    assert found["bytes"] == len(text.encode())
    assert (found["passed"], found["n_episodes"]) == (True, 2)
    parts = ["swimming", "steer", "curves", "gait", "evaluation", "physics", "configuration", "reproduce"]
    assert re.findall(r'<section id="(\w+)">', text) == found["parts"] == parts
    assert f"it swims at {found['speed_mean']:.2f} m/s" in text
    assert text.count("data:image/svg+xml") == 6
    assert "There is no gait diagram: no stroke" in text
    assert "data:video/mp4;base64,AAAA" in text
    assert "window.swimmer" in html.unescape(re.search(r'srcdoc="([^"]*)"', text)[1])
    assert "accelerations along the episode: A.3 and MuJoCo + callback" in text
    said = html.unescape(re.search(r"json\.loads\(r(.*?)\)\)\n", text, re.DOTALL)[1]).strip('"')
    assert RunConfig.from_json(json.loads(said)) == read_config(SWIMMER)
    for address in re.findall(r'(?:src|href|poster)="([^"]*)"', text):
        assert address.startswith(("data:", "#"))


def test_the_report_of_another_problem(tmp_path, capsys):
    out = tmp_path / "report.html"
    status, reply, err = run(
        capsys, "report", PENDULUM, "--out", out, "--episodes", "2", "--duration", "1", "--json"
    )
    assert status == 0, err
    assert json.loads(reply)["parts"] == ["curves", "evaluation", "configuration", "reproduce"]
    assert "its mean reward is" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--episodes", "65"], "--episodes must be between 1 and 64, got 65"),
        (["--duration", "0"], "--duration must be finite and at least 1 s, got 0.0"),
        (["--out", "report.pdf"], r"--out must be a file whose name ends with \.html, got report\.pdf"),
        ([], "nowhere is not a run directory"),
    ],
)
def test_a_report_that_cannot_be_is_refused(tmp_path, monkeypatch, capsys, options, complaint):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, "report", "nowhere", *options)
    assert (status, out) == (2, "")
    assert re.search(complaint, err)
    assert err.count("\n") == 1
