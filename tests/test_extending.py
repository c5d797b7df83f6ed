"""docs/extending.md: its two files and its commands, as printed, from outside the package."""

import contextlib
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from swimmer_mj.cli import main

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
FILES = re.findall(r"This one goes into `(\w+\.py)`:\n\n```python\n(.*?)```", PAGE, re.DOTALL)
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]


@pytest.fixture(scope="module")
def outside(tmp_path_factory):
    """Where the page's files are, and what its commands print there in their order."""
    folder, printed = tmp_path_factory.mktemp("outside"), {}
    for name, code in FILES:
        (folder / name).write_text(code, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        for command in COMMANDS:
            program, *arguments = shlex.split(command)
            assert program == "swimmer-mj"
            with contextlib.redirect_stdout(io.StringIO()) as text:
                assert main(arguments) == 0, command
            printed[command] = text.getvalue()
    return folder, printed


def test_the_page_has_a_problem_and_a_method_and_uses_them():
    assert [name for name, _ in FILES] == ["double_pendulum.py", "grid_iteration.py"]
    assert {command.split()[1] for command in COMMANDS} == {"train", "evaluate", "render", "info"}
    assert len(COMMANDS) == 12


def test_what_is_learned_holds_the_pendulum_up(outside):
    """Upright is 1. A hanging pendulum is -1, one that turns is 0; seven seeds of value gradients ended above 0.9."""
    _, printed = outside
    rewards = {
        command.split()[2]: [float(found) for found in re.findall(r"mean reward (\S+)", text)]
        for command, text in printed.items()
        if command.startswith("swimmer-mj evaluate")
    }
    assert {run: len(found) for run, found in rewards.items()} == {
        "runs/gradients": 1,
        "runs/grid": 1,
        "runs/seeds": 2,
    }
    assert all(0.8 < reward <= 1 for found in rewards.values() for reward in found)


@pytest.mark.parametrize(
    ("run", "trials"), [("gradients", 400), ("lambda", 2), ("grid", 20), ("seeds/seed-1", 100)]
)
def test_runs_go_on_where_they_were(outside, run, trials):
    folder, _ = outside
    rows = (folder / "runs" / run / "metrics.csv").read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) for row in rows][-1] == trials
    assert len(rows) >= 2


def test_the_console_finds_ones_own_modules_in_the_working_directory(outside):
    folder, _ = outside
    program = Path(sys.executable).with_name("swimmer-mj")
    command = [program, "info", "runs/grid", "--json", "--trust", "double_pendulum", "grid_iteration"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["best"]["trial"] in (10, 20)


def test_a_strangers_run_runs_nothing(outside, tmp_path):
    """Its module stands beside it, where Python would find it."""
    folder, _ = outside
    shutil.copytree(folder / "runs" / "grid", tmp_path / "run")
    for name, code in FILES:
        (tmp_path / name).write_text(f"open('it-ran', 'w')\n{code}", encoding="utf-8")
    command = [sys.executable, "-m", "swimmer_mj", "info", "run"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert "'double_pendulum:DoublePendulum' is code that does not come with swimmer-mj" in done.stderr
    assert "if you trust it, add --trust double_pendulum" in done.stderr
    assert not (tmp_path / "it-ran").exists()
    trusted = [*command, "--trust", "double_pendulum", "grid_iteration"]
    assert subprocess.run(trusted, cwd=tmp_path, capture_output=True).returncode == 0
    assert (tmp_path / "it-ran").exists()


def test_its_runs_know_their_problem_and_method(outside):
    folder, _ = outside
    configs = {
        run: json.loads((folder / "runs" / run / "config.json").read_text())
        for run in ("gradients", "grid", "lambda")
    }
    assert {config["problem"]["name"] for config in configs.values()} == {"double_pendulum:DoublePendulum"}
    assert configs["grid"]["method"] == {
        "name": "grid_iteration:GridIteration", "points": 13, "dt": 0.05, "reach": 2.0,
    }  # fmt: skip
    assert configs["gradients"]["method"]["settings"]["trajectories"] == 64
    assert (configs["lambda"]["problem"]["mass"], configs["lambda"]["method"]["neurons"]) == (0.4, 8)


def test_it_draws(outside):
    folder, _ = outside
    for run in ("gradients", "grid"):
        for picture in ("learning-curve.png", "episode.png"):
            assert (folder / "runs" / run / picture).read_bytes()[:4] == b"\x89PNG"


def test_the_double_pendulum_conserves_energy(outside, monkeypatch):
    """Without damping and torques, kinetic and potential energy written out here from the positions of the masses."""
    monkeypatch.syspath_prepend(outside[0])
    from double_pendulum import DoublePendulum

    problem = DoublePendulum(mass=0.7, length=0.4, damping=0.0)
    x = torch.from_numpy(problem.initial_states(np.random.default_rng(0), 20)).requires_grad_()

    def energy(x):
        theta, omega = x[:, :2], x[:, 2:]
        across, along = 0.4 * omega * torch.cos(theta), -0.4 * omega * torch.sin(theta)
        speeds = across.cumsum(1) ** 2 + along.cumsum(1) ** 2
        heights = (0.4 * torch.cos(theta)).cumsum(1)
        return (0.7 * (speeds / 2 + 9.8 * heights)).sum(1)

    (slope,) = torch.autograd.grad(energy(x).sum(), x)
    assert (slope * problem.drift(x)).sum(1).abs().max() < 1e-10
    power = torch.einsum("np,npq->nq", slope, problem.control_matrix(x))
    omega = x[:, 2:]
    assert torch.allclose(power, torch.stack([omega[:, 0], omega[:, 1] - omega[:, 0]], 1), atol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--problem", "nowhere:Problem"], "problem 'nowhere:Problem': No module named 'nowhere'"),
        (["--problem", "double_pendulum:Pendulum"], "has no attribute 'Pendulum'"),
        (["--problem", "double_pendulum:np"], "must be a dataclass, whose fields config.json keeps"),
        (["--method", "grid"], "method must be one of td, value-gradient, or module:Class; got 'grid'"),
        (
            ["--method", "grid_iteration:GridIteration", "--eta", "1"],
            "--eta is no option of problem 'swim', nor",
        ),
        (["--set", "wings=2"], "there is no setting 'wings'; there are coordinates, dt, dtype"),
        (["--set", "wings"], "--set must be like mass=2, got 'wings'"),
    ],
)
def test_refuses_in_one_line_before_anything_is_written(outside, monkeypatch, capsys, arguments, complaint):
    folder, _ = outside
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert main(["train", "--out", "runs/never", *arguments]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1
    assert not (folder / "runs" / "never").exists()
