import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from swimmer_mj import cli
from swimmer_mj.cli import main
from swimmer_mj.render.curves import read_metrics
from swimmer_mj.trajectory import Trajectory


def run(capsys, *arguments):
    """Exit status, standard output, standard error of a command."""
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A run of a swimmer that has hardly learned."""
    out = tmp_path_factory.mktemp("runs") / "run"
    assert main(["train", "--out", str(out), "--trials", "60", "--evaluate-every", "30", "--links", "2"]) == 0
    return out


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from swimmer_mj.cli import main; status = main(['--help']);"
        "heavy = {'numpy', 'scipy', 'torch', 'numba', 'mujoco', 'dm_control', 'matplotlib'} & set(sys.modules);"
        "sys.exit(status or (f'imported {heavy}' if heavy else 0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for command in ("demo", "train", "evaluate", "render", "validate", "bench", "info", "doctor"):
        assert command in done.stdout


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "demo, train, evaluate"),
        (["fly"], "Unrecognized options: fly"),
        (["train"], "--out"),
        (["train", "--out", "r", "--links", "five"], "five"),
        (["train", "--out", "r", "--links", "0"], "n_links must be at least 1, got 0"),
        (["train", "--out", "r", "--links", "1"], "at least 2 links to have a joint to move, got 1"),
        (["train", "--out", "r", "--eta", "-1"], "eta must be positive and finite, got -1.0"),
        (["train", "--out", "r", "--seeds", "3-1"], "--seeds must be like 0-7 or 1,4,9; got '3-1'"),
        (["train", "--out", "r", "--seeds", "1,1"], "names a seed twice"),
        (["train", "--out", "r", "--seed", "1", "--seeds", "0-3"], "--seed or --seeds, not both"),
        (["train", "--out", "r", "--trials", "0"], "--trials must be positive, got 0"),
        (["train", "--out", "r", "--resume"], "is not a run directory"),
        (["evaluate", "nowhere"], "nowhere is not a run directory"),
        (["render", "nowhere", "--duration", "0"], "--duration must be at least 1 s, got 0.0"),
        (["info", "nowhere"], "nowhere is not a run directory"),
    ],
)
def test_bad_usage_is_one_line_on_standard_error(tmp_path, monkeypatch, capsys, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert out == ""
    assert complaint in err
    assert err.startswith("swimmer-mj: ")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_parse_seeds():
    assert cli._parse_seeds("0-7") == list(range(8))
    assert cli._parse_seeds("4, 1-2,9") == [4, 1, 2, 9]


def test_a_taken_directory_gets_a_number(tmp_path):
    assert cli._free_directory(tmp_path / "demo") == tmp_path / "demo"
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo-2").mkdir()
    assert cli._free_directory(tmp_path / "demo") == tmp_path / "demo-3"


def test_validate(capsys, tmp_path):
    page = tmp_path / "report.html"
    status, out, _ = run(capsys, "validate", "--json", "--html", page)
    report = json.loads(out)
    assert status == 0
    assert report["passed"] is True
    assert len(report["checks"]) > 50
    assert len({check["section"] for check in report["checks"]}) >= 6
    assert "data:image/png;base64," in page.read_text()


def test_a_failed_check_is_exit_status_1(monkeypatch, capsys):
    from swimmer_mj import validation

    section = validation.other_models()
    wrong = dataclasses.replace(section.checks[0], error=1.0)
    monkeypatch.setattr(
        validation, "full_report", lambda seed: [dataclasses.replace(section, checks=(wrong,))]
    )
    status, out, _ = run(capsys, "validate", "--json")
    assert status == 1
    assert json.loads(out)["passed"] is False


def test_doctor(capsys):
    status, out, _ = run(capsys, "doctor", "--json")
    report = json.loads(out)
    assert status == 0, report
    assert report["problems"] == []
    assert report["callback"]["passed"] is True
    assert report["rendering"]["backend"] == "osmesa"
    assert report["versions"]["mujoco"].startswith("3.")


def test_info(capsys, trained):
    status, out, _ = run(capsys, "info", "--json")
    assert status == 0
    assert "swim5" in json.loads(out)["tasks"]
    status, out, _ = run(capsys, "info", trained, "--json")
    assert status == 0
    assert json.loads(out)["config"]["parameters"]["n_links"] == 2


def test_train_reports_and_resumes(tmp_path, capsys):
    out = tmp_path / "run"
    arguments = ["train", "--out", out, "--problem", "pendulum", "--neurons", "8", "--evaluate-every", "20"]
    status, printed, _ = run(capsys, *arguments, "--seeds", "0-1", "--trials", "20", "--json")
    assert status == 0
    report = json.loads(printed)
    assert [(r["seed"], r["trials"]) for r in report["runs"]] == [(0, 20), (1, 20)]
    status, printed, _ = run(capsys, "train", "--out", out, "--resume", "--trials", "40")
    assert status == 0
    assert "<H²>" in printed
    assert read_metrics(out / "seed-1" / "metrics.csv")["trial"].tolist() == [20, 40]
    status, _, err = run(capsys, *arguments, "--seeds", "1-2", "--trials", "20")
    assert status == 2
    assert "already holds a run" in err
    status, _, err = run(capsys, "train", "--out", out, "--resume", "--trials", "60", "--eta", "0.3")
    assert status == 2
    assert "--resume goes on with the run's own configuration: leave out td" in err


def test_evaluate(capsys, trained):
    status, out, _ = run(capsys, "evaluate", trained, "--episodes", "2", "--json")
    result = json.loads(out)
    assert status == 0
    assert result["n_episodes"] == 2
    low, high = result["speed_ci95"]
    assert low <= result["speed_mean"] <= high
    assert result["value_rmse"] >= abs(result["value_bias"])
    assert result["value_bias"] == pytest.approx(result["mean_value"] - result["mean_return"])


def test_evaluate_refuses_what_does_not_swim(tmp_path, capsys):
    out = tmp_path / "run"
    run(
        capsys,
        "train",
        "--out",
        out,
        "--problem",
        "pendulum",
        "--neurons",
        "8",
        "--trials",
        "5",
        "--evaluate-every",
        "5",
    )
    status, _, err = run(capsys, "evaluate", out)
    assert status == 2
    assert "swimming speed is defined for swimmers only" in err


def test_render(tmp_path, capsys, trained):
    status, out, _ = run(
        capsys, "render", trained, "--out", tmp_path, "--duration", "1", "--fps", "10", "--json"
    )
    assert status == 0
    paths = json.loads(out)
    assert {p.name for p in tmp_path.iterdir()} == {
        "swimmer.mp4", "film-strip.png", "learning-curve.png", "episode.png", "trajectory.npz",
    }  # fmt: skip
    trajectory = Trajectory.load(paths["trajectory"])
    assert trajectory.duration == pytest.approx(1.0)
    assert np.unique(trajectory.target_directions) == pytest.approx([0, np.pi])
    assert (tmp_path / "film-strip.png").stat().st_size > 20_000


def test_module_is_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "swimmer_mj", "info", "--json"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert json.loads(done.stdout)["version"]
