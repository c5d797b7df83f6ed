"""Sweeps: what a file asks for, that the same command goes on where it stopped, and the table."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from swimmer_mj.cli import main
from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.cli.training import changed, configured
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import read_config
from swimmer_mj.learning.runs.engines.local import LocalEngine
from swimmer_mj.learning.runs.lock import RunInUseError, locked
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.runs.sweep import grid, random_search, rows_of, run_jobs, settings_name
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.render.sweep import sweep_plot

FILE = """
problem = "pendulum"
trials = 20
seeds = "0-1"
evaluate_every = 10

[set]
neurons = 6
trial_duration = 0.5
dtype = "float64"

[grid]
eta = [0.02, 0.08]
mass = [1.0, 2.0]
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "sweep.toml").write_text(FILE)
    return tmp_path / "sweep.toml"


def table(out):
    with open(out / "sweep.csv", newline="") as text:
        return list(csv.DictReader(text))


def test_a_grid_is_all_combinations():
    assert grid({"a": [1, 2], "b": ["x"]}) == [{"a": 1, "b": "x"}, {"a": 2, "b": "x"}]
    assert grid({}) == [{}]


def test_random_draws_keep_to_their_law_and_repeat():
    laws = {"eta": {"low": 1e-3, "high": 1.0, "scale": "log"}, "k": {"low": 2, "high": 9}, "kind": ["a", "b"]}
    draws = random_search(laws, 400, seed=1)
    assert draws[:10] == random_search(laws, 10, seed=1)
    assert draws[:10] != random_search(laws, 10, seed=2)
    eta, k = np.array([draw["eta"] for draw in draws]), np.array([draw["k"] for draw in draws])
    assert ((eta >= 1e-3) & (eta <= 1)).all()
    assert 0.3 < (eta < 10**-1.5).mean() < 0.7  # the middle of the logarithm
    assert {*k.tolist()} == {*range(2, 10)}
    assert all(type(draw["k"]) is int for draw in draws)
    assert {draw["kind"] for draw in draws} == {"a", "b"}


def test_names_of_directories_say_the_settings_on_any_system():
    assert settings_name({"eta": 0.02, "layers": [8, 8], "law": "a:b/c"}) == "eta-0.02_layers-8-8_law-a-b-c"
    assert settings_name({}) == "run"
    negative = {"offset": -1, "shift": [-0.5, 2], "slope": [1, -2], "low": -1e-7}
    assert settings_name(negative) == "offset--1_shift--0.5-2_slope-1--2_low--1e-07"


def test_a_file_becomes_jobs(file):
    jobs, trials = read_jobs(file)
    assert (len(jobs), trials) == (8, 20)
    assert [job.name for job in jobs[:3]] == [
        "eta-0.02_mass-1.0/seed-0", "eta-0.02_mass-1.0/seed-1", "eta-0.02_mass-2.0/seed-0",
    ]  # fmt: skip
    config = jobs[2].config
    assert (config.problem.mass, config.method.settings.eta, config.seed) == (2.0, 0.02, 0)
    assert (config.method.neurons, config.method.settings.trial_duration, config.evaluate_every) == (
        6,
        0.5,
        10,
    )


def test_more_samples_keep_the_directories_of_the_first(tmp_path):
    """Else what is learned there would be learned again."""
    path, text = tmp_path / "sweep.toml", "trials = 1\n[random]\nsamples = {}\neta = [0.1, 0.2]"
    names = []
    for samples in (10, 11):
        path.write_text(text.format(samples))
        names.append([job.name for job in read_jobs(path)[0]])
    assert names[1][:10] == names[0]
    assert len({*names[1]}) == 11


def test_null_leaves_an_option_as_train_does_without_it(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text('method = "value-gradient"\ntrials = 1\n[grid]\nneurons = [30, "null"]')
    cascade, layers = (job.config.method for job in read_jobs(path)[0])
    assert (cascade.neurons, cascade.layers) == (30, None)
    assert layers == configured("swim", "value-gradient", {}, 2).method
    assert layers.layers


def test_an_environment_is_configured_as_train_does_it(tmp_path, suite):
    path, name = tmp_path / "sweep.toml", "dm_control/pendulum/swingup"
    path.write_text(f"problem = '{name}'\nmethod = 'value-gradient'\ntrials = 1\n[set]\npasses = 3")
    (job,), _ = read_jobs(path)
    assert job.config == changed(configured(name, "value-gradient", {}, 1), ["passes=3"])
    settings = job.config.method.settings
    assert (settings.dt, settings.s_lambda, settings.passes) == (0.02, 5.0, 3)  # two of the task's advice


MODEL = """<mujoco><option timestep="0.1"/><worldbody><body><joint name="x" type="slide" damping="1"/><geom size="0.1"/>
</body></worldbody><actuator><motor joint="x" ctrlrange="-1 1"/></actuator></mujoco>"""
OF_MODEL = """
problem = "cart.xml"
method = "value-gradient"
trials = 1
evaluate_every = 1
[set]
reward = "rewards_of_a_sweep:near"
trajectories = 32
minibatch = 32
layers = [4]
[grid]
steps = [5, 8]
"""


def test_a_model_is_swept_with_a_reward_of_ones_own_that_is_trusted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    Path("cart.xml").write_text(MODEL)
    Path("sweep.toml").write_text(OF_MODEL)
    Path("rewards_of_a_sweep.py").write_text("def near(scene):\n    return -scene.joint('x') ** 2\n")
    sweep = ["sweep", "sweep.toml", "--out", "out"]
    assert main(sweep) == 2
    assert "reward 'rewards_of_a_sweep:near' is code that does not come with" in capsys.readouterr().err
    assert not Path("out").exists()
    assert main([*sweep, "--trust", "rewards_of_a_sweep", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["done"] == 2
    problem = read_config("out/steps-8/seed-0").problem
    assert (problem.environment, problem.reward_function) == (
        str(tmp_path / "cart.xml"),
        "rewards_of_a_sweep:near",
    )


def test_the_same_command_goes_on_where_it_stopped(file, tmp_path, capsys):
    """Some runs done, one in the middle, one at its beginning, the others not there: the same bits, and one table."""
    jobs, trials = read_jobs(file)
    run_jobs(jobs, tmp_path / "whole", trials, engine=LocalEngine(workers=1))
    out = tmp_path / "parts"
    done, middle, begun = (TrainingRun(out / job.name, job.config) for job in jobs[:3])
    train_together([done], trials=20, workers=1)
    train_together([middle], workers=1, stop=lambda: middle.trial >= 3)
    assert (done.trial, begun.trial) == (20, 0)
    assert 0 < middle.trial < 20
    before = (out / jobs[0].name / "checkpoint.safetensors").stat().st_mtime_ns
    assert main(["sweep", str(file), "--out", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["jobs"], report["done"], report["diverged"]) == (8, 8, 0)
    assert (out / jobs[0].name / "checkpoint.safetensors").stat().st_mtime_ns == before
    for job in jobs:
        one, other = (
            load_checkpoint(where / job.name / "checkpoint.safetensors")[0]
            for where in (out, tmp_path / "whole")
        )
        assert torch.equal(one["weight"], other["weight"])
    rows = table(out)
    assert list(rows[0]) == [
        "job", "seed", "eta", "mass", "trials", "seconds", "speed", "last_speed", "state",
    ]  # fmt: skip
    assert [(row["job"], float(row["eta"]), row["trials"]) for row in rows] == [
        (job.name, job.settings["eta"], "20") for job in jobs
    ]
    best = max(rows, key=lambda row: float(row["speed"]))
    assert report["best"]["run"] == str(out / best["job"])
    assert report["best"]["speed"] == float(best["speed"])
    assert Path(report["picture"]).read_bytes()[:4] == b"\x89PNG"


def test_a_run_that_diverges_has_its_row_and_the_others_go_on(file, tmp_path, capsys):
    file.write_text(
        FILE.replace("[0.02, 0.08]", "[0.02, 1e9]").replace("20\n", "200\n").replace("10\n", "100\n")
    )
    out = tmp_path / "out"
    for _ in range(2):  # the second time, it is left alone
        assert main(["sweep", str(file), "--out", str(out)]) == 0
        assert {(float(row["eta"]), row["state"]) for row in table(out)} == {
            (0.02, "done"),
            (1e9, "diverged"),
        }
        printed = capsys.readouterr().out
        assert "4 of 8 runs done, 4 diverged" in printed
    assert "is too large" not in printed
    assert "is too large" in (out / "eta-1000000000.0_mass-1.0" / "seed-0" / "diverged.txt").read_text()


def test_the_row_of_a_run_whose_evaluations_gave_no_number(file, tmp_path):
    jobs, trials = read_jobs(file)
    run = TrainingRun(tmp_path / jobs[0].name, jobs[0].config)
    run.save(run.evaluate(0.0)._replace(trial=20, speed=np.nan))
    row = rows_of(jobs[:1], tmp_path, trials)[0]
    assert row["speed"] is None
    assert row["last_speed"] is None


def test_another_sweep_is_not_mixed_in(file, tmp_path, capsys):
    out = tmp_path / "out"
    jobs, _ = read_jobs(file)
    TrainingRun(out / jobs[0].name, jobs[0].config)
    file.write_text(FILE.replace("neurons = 6", "neurons = 7"))
    assert main(["sweep", str(file), "--out", str(out)]) == 2
    assert "holds a run with other settings; choose another directory with --out" in capsys.readouterr().err
    assert read_config(out / jobs[0].name) == jobs[0].config


def test_more_seeds_than_one_engine_has_are_added_to_what_is_there(file, tmp_path, capsys):
    """By default, td has another engine with more than four runs; those that are there keep theirs."""
    out = tmp_path / "out"
    engines = []
    for seeds, trials in (("0-3", 20), ("0-5", 30)):
        file.write_text(FILE.partition("[grid]")[0].replace("0-1", seeds).replace("20\n", f"{trials}\n"))
        for part in (["--part", "1/2"], []):
            assert main(["sweep", str(file), "--out", str(out), *part]) == 0
        jobs, _ = read_jobs(file)
        engines.append([read_config(out / job.name).method.engine for job in jobs])
        assert [row["trials"] for row in table(out)] == [str(trials)] * len(jobs)
    assert engines == [["auto"] * 4, ["auto"] * 4 + ["population"] * 2]


def test_who_is_stopped_while_it_waits_for_a_run_that_another_holds_just_ends(file, tmp_path):
    """A job of SLURM's is put into the queue again then, which it is not after an error."""
    jobs, trials = read_jobs(file)
    TrainingRun(tmp_path / jobs[0].name, jobs[0].config)
    asked = iter([False, True])
    with locked(tmp_path / jobs[0].name):
        LocalEngine(patience=60.0).run(jobs[:1], tmp_path, trials, print, lambda: next(asked))
        with pytest.raises(RunInUseError, match="is in use by process"):
            LocalEngine().run(jobs[:1], tmp_path, trials, print, lambda: False)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("trials", "is not TOML"),
        ("", "trials must be an integer of at least 1, got None"),
        ("trials = 1\nseed = 3", "there is no 'seed'; there are problem, method, trials, seeds"),
        ("trials = true", "trials must be an integer of at least 1, got True"),
        ("trials = 1\nseeds = []", 'seeds must be like "0-7" or [0, 1, 2], each once, got []'),
        ("trials = 1\nseeds = [1, 1]", "each once, got [1, 1]"),
        ("trials = 1\nseeds = '0-99999'", "--seeds"),
        ("trials = 1\n[grid]\neta = 0.1", "[grid] eta must be a list of values, got 0.1"),
        ("trials = 1\n[grid]\neta = [0.1, -1]", "eta must be positive and finite, got -1"),
        ("trials = 1\n[grid]\neta = [inf]", "eta must be positive and finite, got inf"),
        ("trials = 1\n[set]\neta = [0.1, 0.2]", "eta must be of type float | None, got [0.1, 0.2]"),
        ("trials = 1\n[set]\nheld = 3", "held must be true or false, got 3"),
        ("trials = 1\n[set]\nvario_eta = 'false'", "vario_eta must be true or false, got 'false'"),
        ("trials = 1\n[grid]\nwings = [2]", "there is no setting 'wings'"),
        ("trials = 1\n[grid]\neta = [1]\n[random]\nsamples = 3", "give [grid] or [random], not both"),
        ("trials = 1\n[random]\nsamples = 2\neta = {low = 0.0, high = 1.0, scale = 'log'}", "both positive"),
        ("trials = 1\n[random]\nsamples = 2\neta = 3", "[random] eta must be a list, or like"),
        ("trials = 1\n[random]\nsamples = 1000000\neta = [1]", "at most 10,000 runs, and this one asks for 1,000,000"),
        ("trials = 1\nproblem = 'fly'", "problem must be one of swim"),
        ("trials = 1\nproblem = 3", "problem must be named by a string, got 3"),
        ("trials = 1\nproblem = 'a.xml'\n[set]\nreward = 3", "reward must be like my_module:reward, got 3"),
        ("trials = 1\nproblem = 'this:Zen'", "if you trust it, add --trust this"),
    ],
)  # fmt: skip
def test_a_file_that_is_not_as_it_should_be_is_refused_in_one_line(tmp_path, capsys, text, complaint):
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    assert main(["sweep", str(path), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_picture_has_the_best_at_the_top():
    def row(eta, seed, speed, state="done"):
        return {"job": "", "seed": seed, "eta": eta, "trials": 1, "seconds": 1.0, "speed": speed, "last_speed": 0.0,
                "state": state}  # fmt: skip

    rows = [
        row(0.1, 0, 1.0),
        row(0.1, 1, 1.2),
        row(0.3, 0, 2.0),
        row(0.3, 1, None, "diverged"),
        row(9, 0, None),
    ]
    (axes,) = sweep_plot(rows).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["eta 0.3", "eta 0.1", "eta 9"]
    bottom, top = axes.get_ylim()
    assert bottom > top
    assert [text.get_text() for text in axes.texts] == ["1 diverged"]
    many = [row(i, 0, float(i)) for i in range(50)]
    (axes,) = sweep_plot(many).axes
    assert len(axes.get_yticks()) == 40
    assert axes.get_title(loc="left") == "the best 40 of 50 combinations"
