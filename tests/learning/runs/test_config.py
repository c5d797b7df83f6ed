"""Configurations as JSON, by name, and those of version 0.1, of which there are two runs beside this file."""

import json
import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from swimmer_mj.cli.training import configured
from swimmer_mj.learning.pretrained import pretrained_directory, pretrained_swimmers
from swimmer_mj.learning.problems.cart_pole import CartPole
from swimmer_mj.learning.problems.differentiable import DifferentiableProblem
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import RunConfig, convert, read_config, value_gradient_config
from swimmer_mj.learning.runs.registry import METHODS, PROBLEMS, find, trust
from swimmer_mj.learning.runs.run import TrainingRun, load_policy
from swimmer_mj.learning.runs.together import Pack
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.learning.td.vario_eta import VarioEta
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import SwimmerParameters

OLD = Path(__file__).parent / "version-0.1"


@dataclass(frozen=True)
class Mine(CartPole):
    """A problem of one's own, in a module that can be imported."""

    wind: float = 0.5


UNEQUAL = SwimmerParameters(3, [1, 2, 3], [0.5, 1, 1], 3.0, [1, 2])
CONFIGS = [
    RunConfig(),
    value_gradient_config(7),
    RunConfig(Swimming(UNEQUAL, 0.7, "mujoco", encoding="angle", initial_law="fast")),
    RunConfig(Pendulum(mass=2.0), TemporalDifferences(TDSettings(vario=VarioEta(beta=0.05)), 12, "float64")),
    RunConfig(CartPole(gravity=0.0), ValueGradients(ValueGradientSettings(s_lambda=np.inf), (8, 4, 2)), 3, 5),
    RunConfig(method=ValueGradients(layers=None, neurons=9, sigmoid="logistic", engine="torch")),
]


def test_value_gradients_of_a_swimmer_are_as_train_has_them():
    for made in (value_gradient_config(), configured("swim", "value-gradient", {}, 1)):
        assert made.method == ValueGradients(ValueGradientSettings(huber=1.0))
    held = configured("swim", "value-gradient", {"held": True}, 1).method
    assert held == ValueGradients(ValueGradientSettings(huber=1.0, trajectories=256, minibatch=256))


@pytest.mark.parametrize("config", CONFIGS)
def test_a_configuration_survives_json(config):
    text = json.dumps(config.to_json())
    assert RunConfig.from_json(json.loads(text)) == config
    assert json.loads(text)["schema"] == 2


def test_every_name_leads_to_a_dataclass_that_keeps_its_name(suite):
    for known, what in ((PROBLEMS, "problem"), (METHODS, "method")):
        for name in known:
            made = find(name, known, what)()
            config = RunConfig(made) if what == "problem" else RunConfig(method=made)
            assert config.to_json()[what]["name"] == name


def test_a_class_of_ones_own_is_named_by_its_place():
    here = Mine.__module__
    assert RunConfig(Mine(wind=2.0)).to_json()["problem"]["name"] == f"{here}:Mine"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 3}, "schema must be 2, got 3: written by a newer version"),
        (
            {"problem": {"name": "fly"}},
            "problem must be one of swim, pendulum, cart-pole, dm_control/DOMAIN/TASK, gymnasium/ID, FILE.xml, or "
            "module:Class; got 'fly'",
        ),
        ({"problem": {"name": "pendulum", "wings": 2}}, "Pendulum has no setting 'wings'"),
        ({"problem": {"name": "pendulum", "mass": -1.0}}, "mass must be positive and finite, got -1.0"),
        ({"method": {"name": "td", "settings": {"rate": 1}}}, "TDSettings has no setting 'rate'"),
        ({"method": {"name": "json:JSONDecoder"}}, "must be a dataclass, whose fields config.json keeps"),
        ({"method": {}}, "'name'"),
    ],
)
def test_refuses_what_it_cannot_read(tmp_path, change, message):
    (tmp_path / "config.json").write_text(json.dumps({**RunConfig().to_json(), **change}))
    with pytest.raises(ValueError, match=message) as refused:
        read_config(tmp_path)
    assert str(refused.value).startswith(f"{tmp_path}/config.json is not the configuration of a run: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def law(:", "fails when it is imported: SyntaxError: "),
        ("1 / 0", "fails when it is imported: ZeroDivisionError: division by zero"),
        ("import sys; sys.exit(0)", "fails when it is imported: SystemExit: 0"),
        ("import nowhere_at_all", "No module named 'nowhere_at_all'; is its folder on Python's path?"),
    ],
)
def test_a_module_of_one_s_own_that_cannot_be_imported_is_refused_in_one_line(
    tmp_path, monkeypatch, text, said
):
    (tmp_path / "broken_code.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for ask, what in (
        (lambda: find("broken_code:Law", PROBLEMS, "problem"), "problem 'broken_code:Law'"),
        (lambda: trust(["broken_code"]), "--trust broken_code"),
    ):
        with pytest.raises(ValueError, match=re.escape(said)) as refused:
            ask()
        assert str(refused.value).startswith(what)
        assert "\n" not in str(refused.value)


def test_refuses_to_write_what_it_could_not_read(tmp_path):
    functions = DifferentiableProblem(
        "still", lambda x: 0 * x, lambda x: 0 * x[..., None], lambda x: x[:, 0], (1.0,),
        lambda rng, count: rng.uniform(size=(count, 2)),
    )  # fmt: skip
    with pytest.raises((TypeError, ValueError)):
        TrainingRun(tmp_path / "run", RunConfig(functions, ValueGradients(layers=(4,))))
    assert not (tmp_path / "run" / "config.json").exists()


# Version 0.1 ---------------------------------------------------------------------------------------------------------


def test_runs_of_version_0_1_are_what_they_were():
    td, gradients = read_config(OLD / "td"), read_config(OLD / "value-gradient")
    settings = TDSettings(eta=0.04, trial_duration=1.0, vario=VarioEta(epsilon=0.01, initial_variance=100.0))
    assert td == RunConfig(Pendulum(), TemporalDifferences(settings, 6, "float64", engine="fused"), 3, 20)
    settings = ValueGradientSettings(trajectories=32, steps=10, minibatch=64)
    problem = Swimming(SwimmerParameters(n_links=3), s_gamma=0.5)
    assert gradients == RunConfig(problem, ValueGradients(settings, (8, 8)), 2, 2)


@pytest.mark.parametrize(
    ("old", "problem", "method"),
    [
        ({"physics": "mujoco"}, Swimming(UNEQUAL, 0.5, "mujoco"), None),
        ({"engine": "torch"}, None, {"engine": "torch"}),
        ({"encoding": "angle", "initial_law": "rest"}, {"encoding": "angle", "initial_law": "rest"}, None),
        ({"layers": None, "neurons": 14, "sigmoid": "logistic"}, None,
         {"layers": None, "neurons": 14, "sigmoid": "logistic"}),
        ({"device": "cuda"}, None, {"device": "cuda"}),
    ],
)  # fmt: skip
def test_each_setting_of_version_0_1_finds_its_place(old, problem, method):
    values = json.loads((OLD / "value-gradient" / "config.json").read_text())
    if isinstance(problem, Swimming):
        old = {**old, "parameters": RunConfig(problem).to_json()["problem"]["parameters"]}
    before = RunConfig.from_json(values)
    after = RunConfig.from_json({**values, **old})
    expected = before.problem if problem is None else problem
    if isinstance(expected, dict):
        expected = replace(before.problem, **expected)
    assert after.problem == expected
    assert after.method == (before.method if method is None else replace(before.method, **method))


def test_conversion_leaves_nothing_out():
    """Every setting of version 0.1 is in the converted file, or belonged to the other method."""
    for name, other in (("td", {"value_gradient", "layers", "device"}), ("value-gradient", {"td"})):
        old = json.loads((OLD / name / "config.json").read_text())
        new = convert(old)
        kept = {*new, *new["problem"], *new["method"]}
        renamed = {"td", "value_gradient"} - other  # the method's "settings"
        assert {*old} - kept == other | renamed | (
            {"parameters", "encoding", "initial_law", "physics"} - kept
        )
        assert new["method"]["settings"] == old[renamed.pop()]


@pytest.mark.parametrize("name", ["td", "value-gradient"])
def test_a_run_of_version_0_1_goes_on(tmp_path, name):
    shutil.copytree(OLD / name, tmp_path / "run")
    before = (tmp_path / "run" / "config.json").read_bytes()
    run = TrainingRun(tmp_path / "run", resume=True)
    (row,) = Pack([run]).advance()
    period = run.config.evaluate_every
    assert row.trial == run.trial == 3 * period
    assert len(run.history) == 3
    assert (tmp_path / "run" / "config.json").read_bytes() == before
    again = TrainingRun(tmp_path / "run", resume=True)
    assert again.history == run.history


@pytest.mark.parametrize("name", ["td", "value-gradient"])
def test_a_policy_of_version_0_1_judges_as_it_did(name):
    """<V>_S in the last row of its log is what the last weights say of the same sample."""
    policy, config, info = load_policy(OLD / name, "last")
    V = policy.judge(config.problem.initial_states(np.random.default_rng(1), 1000)).value
    assert V.mean() == pytest.approx(info["mean_value"], rel=1e-4, abs=1e-7)


def test_pretrained_policies_are_read_those_of_version_0_1_too():
    old = 0
    for name in pretrained_swimmers():
        directory = pretrained_directory(name)
        old += "schema" not in json.loads((directory / "config.json").read_text())
        assert read_config(directory).problem.name == name.split("-")[0]
    assert old == 6
