import dataclasses
import json
import math
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar, get_args, get_type_hints

import numpy as np
import pytest

from swimmer_mj.cli import COMMANDS, main, output, pictures, viewing
from swimmer_mj.cli.runs import free_directory
from swimmer_mj.cli.training import parse_seeds, train
from swimmer_mj.learning.pretrained import pretrained_card, pretrained_swimmers
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import read_config
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.render.backend import default_backend
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
    learning = ["--links", "3", "--neurons", "6", "--trials", "60", "--evaluate-every", "30"]
    assert main(["train", "--out", str(out), *learning]) == 0
    return out


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from swimmer_mj.cli import main; status = main(['--help']);"
        "heavy = {'numpy', 'scipy', 'torch', 'numba', 'mujoco', 'dm_control', 'matplotlib'} & set(sys.modules);"
        "sys.exit(status or (f'imported {heavy}' if heavy else 0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    commands = (
        "demo",
        "train",
        "evaluate",
        "render",
        "report",
        "page",
        "view",
        "figures",
        "validate",
        "bench",
        "info",
        "doctor",
    )
    for command in commands:
        assert command in done.stdout


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "demo, train, sweep, evaluate"),
        (["fly"], "swimmer-mj: Unrecognized options: fly. Available subcommands: demo"),
        (["train"], "--out"),
        (["train", "--out", "r", "--links", "five"], "five"),
        (["train", "--out", "r", "--links", "0"], "n_links must be at least 1, got 0"),
        (["train", "--out", "r", "--links", "1"], "at least 2 links to have a joint to move, got 1"),
        (["train", "--out", "r", "--eta", "-1"], "eta must be positive and finite, got -1.0"),
        (["train", "--out", "r", "--seeds", "3-1"], "--seeds must be like 0-7 or 1,4,9; got '3-1'"),
        (["train", "--out", "r", "--seeds", "1,1"], "names a seed twice"),
        (["train", "--out", "r", "--seed", "1", "--seeds", "0-3"], "--seed or --seeds, not both"),
        (["train", "--out", "r", "--trials", "0"], "--trials must be positive and finite, got 0"),
        (["train", "--out", "r", "--seconds", "nan"], "--seconds must be positive and finite, got nan"),
        (["train", "--out", "r", "--seconds", "inf"], "--seconds must be positive and finite, got inf"),
        (
            ["train", "--out", "/proc/x"],
            "--out cannot be /proc/x: /proc is not to be written to; choose another",
        ),
        (["train", "--out", ""], "--out must not be empty, got ''; is a variable of the shell not set?"),
        (["train", "--out="], "--out must not be empty, got ''"),
        (["evaluate", ""], "an argument must not be empty, got ''"),
        (["render", "swim5-paper", "--out", "r/v.avi"], "a picture is written as .mp4, .mkv"),
        (["train", "--out", "r", "--seeds", "0-100000"], "--seeds names more than 1,000 seeds: '0-100000'"),
        (["train", "--out", "r", "--seed", "99999999999999999999"], "--seed must be less than 2**63"),
        (["train", "--out", "r", "--links", "100000000"], "n_links must be at most 1000, got 100000000"),
        (
            ["train", "--out", "r", "--neurons", "1000000"],
            "neurons must be an integer of at most 4096, got 1000000",
        ),
        (["train", "--out", "r", "--set", "dt=fast"], "dt must be of type float, got 'fast'"),
        (["train", "--out", "r", "--set", "held=False"], "held must be true or false, got 'False'"),
        (["train", "--out", "r", "--set", "dt=NaN"], "dt must be positive and finite, got nan"),
        (
            ["train", "--out", "r", "--set", "trial_duration=1e300"],
            "a trial must have at most 10,000,000 steps",
        ),
        (["render", "nowhere", "--duration", "1e9"], "--duration must be at most 3600 s"),
        (
            ["train", "--out", "r", "--device", "tpu"],
            "swimmer-mj: invalid choice 'tpu' for argument '--device'. Exp",
        ),
        (
            ["train", "--out", "r", "--device", "cuda"],
            "--device is no option of problem 'swim', nor of method 'td'",
        ),
        (["train", "--out", "r", "--resume"], "is not a run directory"),
        (["train", "--out", "swim5-value-gradient", "--resume"], "is not a run directory"),
        (["evaluate", "nowhere"], "nowhere is not a run directory"),
        (["train", "--out", "r", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["train", "--out", "r", "--resume", "--eta", "0.3", "--links", "4"], "leave out --eta, --links"),
        (["train", "--out", "r", "--resume", "--seeds", "0-3"], "leave out --seeds"),
        (
            ["train", "--out", "r", "--problem", "pendulum", "--links", "3"],
            "--links is no option of problem 'pendulum', nor of method 'td'",
        ),
        (["demo", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["validate", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["validate", "--html", "."], "--html must be a file in an existing directory, got ."),
        (["validate", "--html", "no/report.html"], "--html must be a file in an existing directory, got no/"),
        (["render", "nowhere", "--duration", "0"], "--duration must be finite and at least 1 s, got 0.0"),
        (["render", "nowhere", "--duration", "inf"], "--duration must be finite and at least 1 s, got inf"),
        (["render", "nowhere", "--duration", "nan"], "--duration must be finite and at least 1 s, got nan"),
        (["render", "nowhere", "--fps", "0"], "--fps must be at least 1, got 0"),
        (["info", "nowhere"], "nor is it one of the pretrained policies cartpole-swingup, swim3-paper"),
        (["view"], "{swim3,swim4,swim5,steer3,steer4,steer5}"),
        (["view", "swim6"], "swim6"),
        (["view", "swim5", "--seed", "-1"], "--seed must not be negative, got -1"),
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


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_the_parsers_box_is_taken_off(encoding):
    done = subprocess.run(
        [sys.executable, "-m", "swimmer_mj", "fly"],
        env=os.environ | {"PYTHONIOENCODING": encoding},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    names = ", ".join(command.__name__ for command in COMMANDS)
    assert done.stderr == (
        f"swimmer-mj: Unrecognized options: fly. Available subcommands: {names}. "
        "For full helptext, run swimmer-mj --help\n"
    )


def test_bad_seeds_and_paths_are_refused_before_any_work(tmp_path, monkeypatch, capsys):
    from swimmer_mj import validation

    def worked(*_):
        raise AssertionError

    monkeypatch.setattr(validation, "full_report", worked)
    monkeypatch.setattr(validation, "physics_report", worked)
    for arguments in (
        ["validate", "--seed", "-1"],
        ["validate", "--html", tmp_path],
        ["demo", "--seed", "-1"],
    ):
        assert run(capsys, *arguments)[0] == 2


AWKWARD = "[bold]a[/bold] :smile: [/red] " + "long " * 30
"""Markup, a name of an emoji, the end of no markup, and more than a line of a narrow console."""


def test_lines_are_printed_as_they_are(capsys):
    console = output.make_console(False)
    output.print_line(console, AWKWARD)
    output.print_line(console, AWKWARD, style="red")
    assert capsys.readouterr().out == 2 * f"{AWKWARD}\n"
    assert output.status(console, AWKWARD).renderable.text.plain == AWKWARD


def test_paths_are_printed_as_they_are(tmp_path, monkeypatch, capsys, trained):
    from swimmer_mj import validation
    from swimmer_mj.render import backend

    folder = tmp_path / ("[bold]" + 100 * "a") / "[" / "red]"
    folder.mkdir(parents=True)
    monkeypatch.setattr(pictures, "render_run", lambda *_: {"video": folder / "swimmer.mp4"})
    status, out, _ = run(capsys, "render", trained)
    assert (status, out) == (0, f"  {folder / 'swimmer.mp4'}\n")

    monkeypatch.setattr(validation, "full_report", lambda seed: [])
    status, out, _ = run(capsys, "validate", "--html", folder / "report.html")
    assert (status, out) == (0, f"  {folder / 'report.html'}\n")

    def no_library(name):
        raise backend.BackendError(str(folder))

    monkeypatch.setattr(backend, "probe", no_library)
    status, out, _ = run(capsys, "doctor")
    assert status == 1
    assert re.search(r"^ +rendering +FAILED *$", out, re.MULTILINE)
    assert out.endswith(f"\nrendering: {folder}\n")


def test_parse_seeds():
    assert parse_seeds("0-7") == list(range(8))
    assert parse_seeds("4, 1-2,9") == [4, 1, 2, 9]


def test_a_taken_directory_gets_a_number(tmp_path):
    assert free_directory(tmp_path / "demo") == tmp_path / "demo"
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo-2").mkdir()
    assert free_directory(tmp_path / "demo") == tmp_path / "demo-3"


def test_validate(capsys, tmp_path):
    page = tmp_path / "report.html"
    status, out, _ = run(capsys, "validate", "--json", "--html", page)
    report = json.loads(out)
    assert status == 0
    assert report["passed"] is True
    assert len(report["checks"]) > 50
    assert len({check["section"] for check in report["checks"]}) >= 6
    assert "data:image/png;base64," in page.read_text()


@pytest.mark.skipif(os.name == "nt", reason="pipes break otherwise there")
@pytest.mark.parametrize("buffered", ["", "1"])
@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["info"], ["info", "--json"]])
def test_a_reader_that_has_read_enough_is_no_error(arguments, buffered):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "swimmer_mj", *arguments],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": buffered},
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize("arguments", [["--help"], ["info", "--json"]])
def test_a_full_or_closed_output_has_no_traceback(arguments):
    command = [sys.executable, "-m", "swimmer_mj", *arguments]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (2, "swimmer-mj: No space left on device\n")
    closed = ["sh", "-c", 'exec "$@" >&-', "sh", *command]
    assert subprocess.run(closed, stderr=subprocess.PIPE).stderr == b""


@pytest.mark.parametrize(
    ("variable", "said"),
    [
        ("MUJOCO_GL", "invalid value for environment variable MUJOCO_GL: 7; set it to osmesa or egl, or unset it"),
        ("NUMBA_DISABLE_JIT", "NUMBA_DISABLE_JIT is set, and there is no other form of compiled code; unset it\n"),
    ],
)  # fmt: skip
def test_variables_that_leave_nothing_to_run_are_named(variable, said):
    command = [sys.executable, "-m", "swimmer_mj", "evaluate", "swim3-paper", "--episodes", "1"]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, variable: "7"})
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert f"{line}\n".startswith(f"swimmer-mj: {said}")


@pytest.mark.skipif(sys.platform != "linux", reason="there is always a screen")
def test_a_backend_that_cannot_be_used_is_refused_in_one_line(tmp_path):
    clean = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    command = [sys.executable, "-m", "swimmer_mj", "render", "swim3-paper", "--backend", "glfw"]
    done = subprocess.run(command, capture_output=True, text=True, env=clean, cwd=tmp_path)
    message = "swimmer-mj: glfw needs a screen and there is none (DISPLAY is not set); use osmesa or egl\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", message)


def test_facts_that_are_longer_than_a_line_are_whole(capsys):
    path = "/a/path/" + "x" * 100
    output.print_facts(output.make_console(False), {"name": path, "nested": {"fact": 0.1}})
    assert "".join(capsys.readouterr().out.split()) == f"name{path}nested.fact0.1"


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


def test_a_failed_check_of_the_demo_is_reported_before_anything_is_learned(tmp_path, monkeypatch, capsys):
    from swimmer_mj import validation

    good, wrong = validation.Check("good", 0.0, 1.0, ""), validation.Check("wrong", math.nan, 1.0, "")
    monkeypatch.setattr(validation, "physics_report", lambda: [good, wrong])
    status, out, _ = run(capsys, "demo", "--out", tmp_path / "demo", "--json")
    assert status == 1
    assert json.loads(out) == {"passed": False, "checks": [wrong.to_json()]}
    assert list(tmp_path.iterdir()) == []


def test_doctor_reports_a_callback_that_gives_no_number(monkeypatch, capsys):
    from swimmer_mj import validation

    check = validation.Check("a rod", math.nan, 1e-9, "")
    monkeypatch.setattr(validation, "callback_self_test", lambda: check)
    status, out, _ = run(capsys, "doctor", "--json")
    report = json.loads(out)
    assert status == 1
    assert (report["callback"]["error"], report["callback"]["passed"]) == (None, False)
    assert report["problems"][0].startswith(
        "callback: a rod: error nan exceeds 1e-09; mend it with: pip install "
    )


def test_doctor(capsys):
    status, out, _ = run(capsys, "doctor", "--json")
    report = json.loads(out)
    assert status == 0, report
    assert report["problems"] == []
    assert report["callback"]["passed"] is True
    assert report["rendering"]["backend"] == default_backend()
    assert report["versions"]["mujoco"] == version("mujoco")


def test_doctor_and_info_print_tables_for_people(monkeypatch, capsys, trained):
    status, out, _ = run(capsys, "doctor")
    rows = dict(line.split(maxsplit=1) for line in out.splitlines() if len(line.split()) > 1)
    assert status == 0
    assert rows["mujoco"].strip() == version("mujoco")
    assert rows["rendering"].startswith(f"ok: {default_backend()} drew a frame in ")
    assert rows["callback"].startswith("ok: ")
    status, out, _ = run(capsys, "info", trained)
    rows = dict(line.split(maxsplit=1) for line in out.splitlines() if len(line.split()) > 1)
    assert (status, rows["config.problem.parameters.n_links"].strip()) == (0, "3")
    assert "{" not in out


def test_info(capsys, trained):
    status, out, _ = run(capsys, "info", "--json")
    assert status == 0
    assert json.loads(out)["tasks"] == ["swim3", "swim4", "swim5", "steer3", "steer4", "steer5"]
    assert json.loads(out)["problems"] == ["swim", "pendulum", "cart-pole", "mujoco"]
    assert json.loads(out)["methods"] == ["td", "value-gradient"]
    status, out, _ = run(capsys, "info", trained, "--json")
    assert status == 0
    assert json.loads(out)["config"]["problem"]["parameters"]["n_links"] == 3


def test_info_offers_the_tasks_and_problems_there_are(monkeypatch, capsys):
    from swimmer_mj.environments import swimming
    from swimmer_mj.learning.runs import registry

    monkeypatch.setattr(swimming, "TASKS", ["swim99"])
    monkeypatch.setattr(registry, "PROBLEMS", {"swim": "", "fly": ""})
    _, out, _ = run(capsys, "info", "--json")
    assert json.loads(out)["tasks"] == ["swim99"]
    assert json.loads(out)["problems"] == ["swim", "fly"]


def test_train_offers_what_a_run_can_be():
    offered = get_type_hints(train)
    for name, kinds in (
        ("physics", [Swimming]),
        ("dtype", [TemporalDifferences, ValueGradients]),
        ("device", [ValueGradients]),
        ("engine", [TemporalDifferences, ValueGradients]),
    ):
        choices = {choice for part in get_args(offered[name]) for choice in get_args(part)}
        possible = {choice for kind in kinds for choice in get_args(get_type_hints(kind)[name])}
        assert choices == possible - {"auto"}, name


PENDULUM = ["--problem", "pendulum", "--neurons", "8"]


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Runs of three swimmers that have hardly learned."""
    out = tmp_path_factory.mktemp("runs") / "[runs]"
    learning = ["--links", "3", "--neurons", "4", "--trials", "5", "--evaluate-every", "5"]
    assert main(["train", "--out", str(out), "--seeds", "3-5", *learning]) == 0
    return out


def test_info_describes_each_of_several_runs(capsys, seeds):
    status, out, _ = run(capsys, "info", seeds, "--json")
    report = json.loads(out)
    assert status == 0
    assert report["run"] == str(seeds)
    assert [r["run"] for r in report["runs"]] == [str(seeds / f"seed-{seed}") for seed in (3, 4, 5)]
    assert [r["config"]["seed"] for r in report["runs"]] == [3, 4, 5]


def test_render_and_view_say_which_of_several_runs_is_taken(tmp_path, monkeypatch, capsys, viewer, seeds):
    drawn = []
    monkeypatch.setattr(
        pictures, "render_run", lambda directory, *_: drawn.append(directory) or {"video": tmp_path / "a.mp4"}
    )
    taken = f"{seeds} holds 3 runs; the first is taken: {seeds / 'seed-3'}\n"
    assert run(capsys, "render", seeds, "--out", tmp_path) == (0, f"{taken}  {tmp_path / 'a.mp4'}\n", "")
    _, out, _ = run(capsys, "render", seeds, "--out", tmp_path, "--json")
    assert json.loads(out) == {"run": str(seeds / "seed-3"), "video": str(tmp_path / "a.mp4")}
    assert drawn == 2 * [seeds / "seed-3"]
    status, out, err = run(capsys, "view", "swim4", seeds)
    assert (status, out) == (2, taken)
    assert "learned to move 3 links" in err


def test_a_taken_directory_of_several_is_found_before_the_first_is_written(tmp_path, capsys):
    taken = tmp_path / "seed-1"
    assert run(capsys, "train", "--out", taken, *PENDULUM, "--trials", "5", "--evaluate-every", "5")[0] == 0
    before = {path: path.read_bytes() for path in taken.iterdir()}
    status, _, err = run(capsys, "train", "--out", tmp_path, *PENDULUM, "--seeds", "2,1", "--trials", "5")
    assert status == 2
    assert f"{taken} already holds a run" in err
    (tmp_path / "seed-3").write_text("")
    status, _, err = run(capsys, "train", "--out", tmp_path, *PENDULUM, "--seeds", "2,3", "--trials", "5")
    assert status == 2
    assert f"{tmp_path / 'seed-3'} is a file" in err
    assert not (tmp_path / "seed-2").exists()
    assert {path: path.read_bytes() for path in taken.iterdir()} == before


def test_train_reports_the_trials_that_were_saved(tmp_path, monkeypatch, capsys):
    from swimmer_mj.learning.runs import together

    def one_stretch_too_many(runs, **_):
        for trained in runs:
            together.Pack([trained]).advance()
            assert together.Pack([trained]).advance(stretch=5, stop=lambda: True) is None

    monkeypatch.setattr(together, "train_together", one_stretch_too_many)
    out = tmp_path / "run"
    status, printed, _ = run(capsys, "train", "--out", out, *PENDULUM, "--evaluate-every", "20", "--json")
    assert status == 0
    assert json.loads(printed)["runs"][0]["trials"] == 21
    assert read_metrics(out / "metrics.csv")["trial"].tolist() == [20]


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
    assert "--resume goes on with the run's own configuration: leave out --eta\n" in err


@pytest.mark.parametrize(
    ("options", "eta"), [([], 0.16), (["--vario-eta"], 0.0003), (["--vario-eta", "--eta", "0.01"], 0.01)]
)
def test_the_learning_rate_is_smaller_with_vario_eta(tmp_path, capsys, options, eta):
    out = tmp_path / "run"
    assert (
        run(capsys, "train", "--out", out, *PENDULUM, *options, "--dtype", "float64", "--trials", "5")[0] == 0
    )
    assert read_config(out).method.settings.eta == eta


def test_evaluate(capsys, trained):
    status, out, _ = run(capsys, "evaluate", trained, "--episodes", "2", "--json")
    result = json.loads(out)
    assert status == 0
    assert result["n_episodes"] == 2
    low, high = result["speed_ci95"]
    assert low <= result["speed_mean"] <= high
    assert {"steady_speed_mean", "first_5s_speed_mean", "discounted_return_mean"} < result.keys()
    assert result["units"]["steady_speed"] == result["unit"] == "m/s"
    assert result["value_rmse"] >= abs(result["value_bias"])
    assert result["value_bias"] == pytest.approx(result["mean_value"] - result["mean_return"])


def test_another_problem_is_evaluated_and_drawn(tmp_path, capsys):
    out = tmp_path / "run"
    short = ["--s-gamma", "10", "--trials", "5", "--evaluate-every", "5"]
    assert run(capsys, "train", "--out", out, *PENDULUM, *short)[0] == 0
    status, reply, err = run(capsys, "evaluate", out, "--episodes", "2", "--json")
    assert status == 0, err
    result = json.loads(reply)
    assert (result["n_episodes"], result["measure"]) == (2, "reward")
    assert -1 <= result["reward_ci95"][0] <= result["reward_mean"] <= result["reward_ci95"][1] <= 1
    output.print_evaluation(output.make_console(quiet=False), result)
    assert capsys.readouterr().out.startswith("seed 0, 5 trials: mean reward ")
    status, reply, err = run(capsys, "render", out, "--duration", "1", "--json")
    assert status == 0, err
    pictures = {name: Path(path) for name, path in json.loads(reply).items() if name != "run"}
    assert {"learning_curve", "episode"} == pictures.keys()
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in pictures.values())
    status, _, err = run(capsys, "view", "swim5", out)
    assert status == 2


def test_render(tmp_path, capsys, trained):
    status, out, _ = run(
        capsys, "render", trained, "--out", tmp_path, "--duration", "1", "--fps", "10", "--json"
    )
    assert status == 0
    paths = json.loads(out)
    assert {p.name for p in tmp_path.iterdir()} == {
        "swimmer.mp4", "film-strip.png", "learning-curve.png", "episode.png", "trajectory.npz", "phase-portraits.png",
        "value-map.png",
    }  # fmt: skip
    trajectory = Trajectory.load(paths["trajectory"])
    assert trajectory.duration == pytest.approx(1.0)
    assert np.unique(trajectory.target_directions) == pytest.approx([0, np.pi])
    assert (tmp_path / "film-strip.png").stat().st_size > 20_000


@pytest.mark.parametrize("arguments", [["swim5"], ["steer3", "runs/demo"]])
def test_view_without_a_screen_says_what_to_do_before_heavy_imports(suite, arguments):
    code = (
        f"import sys; from swimmer_mj.cli import main; status = main(['view', *{arguments}]);"
        "heavy = {'numpy', 'torch', 'numba', 'mujoco', 'dm_control', 'matplotlib'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else status)"
    )
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in screens}
    for screen in ({}, {"DISPLAY": ":12345"}):  # none, and one that is not there
        done = subprocess.run(
            [sys.executable, "-c", code], env={**environment, **screen}, capture_output=True, text=True
        )
        assert done.returncode == 2
        assert done.stdout == ""
        reason = ":12345 cannot be opened" if screen else "DISPLAY is not set"
        run = "RUN" if len(arguments) == 1 else arguments[1]
        assert done.stderr == (
            f"swimmer-mj: view needs a screen and {reason}; for a video without one: swimmer-mj render {run}\n"
        )


@pytest.fixture
def viewer(monkeypatch):
    """The calls that the viewer would get on a screen."""
    from swimmer_mj.render import backend

    application = pytest.importorskip("dm_control.viewer.application", reason="there is no dm_control here")

    class Recorder:
        calls: ClassVar[list] = []

        def __init__(self, title):
            self.title = title

        def launch(self, env, policy):
            step, actions = env.reset(), []
            for _ in range(700):  # further than an episode of the task
                actions.append(policy(step))
                step = env.step(actions[-1])
            self.calls.append((self.title, env.physics.parameters.n_links, np.array(actions), step.last()))

    monkeypatch.setattr(viewing, "lacks_screen", lambda: None)
    monkeypatch.setattr(backend, "use_backend", lambda name=None: name)
    monkeypatch.setattr(application, "Application", Recorder)
    Recorder.calls.clear()
    return Recorder


def test_view_shows_random_torques(capsys, viewer):
    for seed in (0, 0, 1):
        assert run(capsys, "view", "steer4", "--seed", seed)[0] == 0
    (title, links, actions, last), (*_, again, _), (*_, other, _) = viewer.calls
    assert title == "steer4: random torques"
    assert (links, actions.shape, last) == (4, (700, 3), False)
    assert -1 <= actions.min() < -0.9 < 0.9 < actions.max() <= 1
    assert np.array_equal(actions, again)
    assert not np.array_equal(actions, other)


def test_view_shows_the_policy_of_a_run(capsys, viewer, trained):
    status, printed, err = run(capsys, "view", "swim3", trained)
    assert (status, err) == (0, "")
    assert "Space: start, pause" in printed
    ((title, links, actions, _),) = viewer.calls
    assert title == f"swim3: {trained}"
    assert links == 3
    assert np.array_equal(np.abs(actions), np.ones((700, 2)))  # bang-bang
    status, _, err = run(capsys, "view", "swim5", trained)
    assert (status, err) == (2, f"swimmer-mj: {trained} learned to move 3 links, and swim5 has 5\n")
    assert run(capsys, "view", "swim5", "nowhere")[0] == 2


def test_view_names_the_tasks_there_are():
    from swimmer_mj.environments.swimming import TASKS

    assert {*get_args(get_type_hints(viewing.view)["task"])} == {*TASKS}


def test_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "swimmer_mj", "--help"], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout.startswith("usage: swimmer-mj ")


def test_figures_draws_what_is_asked_for(tmp_path, capsys):
    status, out, _ = run(capsys, "figures", "section-3.3", "--out", tmp_path, "--json")
    assert status == 0
    assert json.loads(out) == {
        "pictures": {"section-3.3": str(tmp_path / "section-3.3.png")},
        "tables": {"section-3.3": str(tmp_path / "section-3.3.md")},
    }
    assert (tmp_path / "section-3.3.png").read_bytes()[:4] == b"\x89PNG"
    assert "| pendulum | 4,000 | 15 | 8 | 1.09 [" in (tmp_path / "section-3.3.md").read_text()


def test_figures_names_what_there_is(tmp_path, capsys):
    status, _, err = run(capsys, "figures", "figure-9", "--out", tmp_path)
    assert status == 2
    assert "there is no figure 'figure-9'; there are figure-1, " in err
    assert list(tmp_path.iterdir()) == []


def test_trains_value_gradients(tmp_path, capsys):
    out = tmp_path / "run"
    status, _, err = run(capsys, "train", "--out", out, "--method", "value-gradient", "--links", "3", "--trials", "30",
                         "--evaluate-every", "30")  # fmt: skip
    assert status == 0, err
    status, reply, _ = run(capsys, "info", out, "--json")
    config = json.loads(reply)["config"]
    assert (config["method"]["name"], config["method"]["layers"]) == ("value-gradient", [64, 64])
    assert config["problem"]["s_gamma"] == 0.5
    status, _, err = run(
        capsys, "train", "--out", tmp_path / "b", "--method", "value-gradient", "--eta", "0.1"
    )
    assert status == 2
    assert "--eta is no option of problem 'swim', nor of method 'value-gradient'" in err


def test_a_pretrained_policy_keeps_its_name_beside_pictures_of_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (name, *_) = pretrained_swimmers()
    status, _, err = run(capsys, "render", name, "--duration", "1", "--fps", "5")
    assert status == 0, err
    assert (tmp_path / name / "film-strip.png").is_file()
    status, reply, err = run(capsys, "info", name, "--json")
    assert status == 0, err
    assert json.loads(reply)["best"]["trial"] == pretrained_card(name)["trial"]
