"""Rewards restated in torch are the environments' own, at random states and controls."""

import csv
import json
import sys

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from swimmer_mj.cli import main
from swimmer_mj.cli.training import changed, configured
from swimmer_mj.learning.problems.forms import EnvironmentForm, EpisodeForm
from swimmer_mj.learning.problems.mujoco import MujocoProblem, Starts
from swimmer_mj.learning.problems.mujoco.episodes import known_task, open_episode
from swimmer_mj.learning.problems.mujoco.task import MujocoTask
from swimmer_mj.learning.problems.mujoco.tasks import dm_control, gymnasium
from swimmer_mj.learning.runs.config import RunConfig

COUNT = 1000


def restated(environment, model, starts):
    """The problem that learns the environment's own reward, at these states."""
    task = known_task(environment)

    def draw(rng, count):
        return Starts(*(None if part is None else part[:count] for part in starts))

    problem = MujocoProblem(model, task.reward, control_cost=task.cost, draw=draw, without=(), threads=1)
    return problem, problem.states(starts)


@pytest.mark.parametrize("name", dm_control.TASKS)
def test_dm_control(name):
    suite = pytest.importorskip("dm_control.suite")

    environment = suite.load(*name.split("/"), task_kwargs={"random": 0})
    task, physics = known_task(f"dm_control/{name}"), environment.physics
    rng = np.random.default_rng(0)
    qpos, qvel, goals, controls, expected = [], [], [], [], []
    for k in range(COUNT):
        if k % 10 == 0:
            environment.reset()
        with physics.reset_context():
            spread = 0.02 if k % 3 == 0 else 0.3 if k % 3 == 1 else 3.0  # near what pays, and anywhere
            physics.data.qpos[:] = (k % 2) * physics.data.qpos + rng.normal(size=physics.model.nq) * spread
            physics.data.qvel[:] = rng.normal(size=physics.model.nv) * spread * 2
        physics.set_control(rng.uniform(-1, 1, physics.model.nu))
        goal = task.goal(physics.model.ptr, physics.data)
        qpos.append(task.relative(np.array(physics.data.qpos), goal))
        qvel.append(np.array(physics.data.qvel))
        goals.append(goal)
        controls.append(np.array(physics.data.ctrl))
        expected.append(environment.task.get_reward(physics))
    kept = None if task.relative is not known_task("dm_control/reacher/easy").relative else np.array(goals)
    goal = kept if kept is not None and kept.shape[1] else None
    starts = Starts(np.array(qpos), np.array(qvel), goal)
    problem, x = restated(f"dm_control/{name}", physics.model.ptr, starts)
    found = problem.reward(x) - (problem.control_cost(x) * np.array(controls) ** 2).sum(axis=1)
    assert np.abs(found - expected).max() < 1e-9
    assert 0 < np.count_nonzero(np.array(expected) > 0.01)


@pytest.mark.parametrize("name", gymnasium.TASKS)
def test_gymnasium(name):
    """Of Swimmer-v5, with the velocity that it pays for in place of the mean over a step: the next test is of that."""
    inner = gym.make(name).unwrapped
    inner.reset(seed=0)
    rng, model, data = np.random.default_rng(0), inner.model, inner.data
    qpos = inner.init_qpos + rng.normal(size=(COUNT, model.nq)) * rng.choice([0.1, 1.0], (COUNT, 1))
    qvel = rng.normal(size=(COUNT, model.nv))
    controls = rng.uniform(-1, 1, (COUNT, model.nu))
    expected = []
    for k, (q, v, u) in enumerate(zip(qpos, qvel, controls, strict=True)):
        inner.set_state(q, v)
        if name == "InvertedPendulum-v5":  # which pays for the state that it comes to
            expected.append(inner.step(u)[1])
            qpos[k], qvel[k] = data.qpos, data.qvel
        elif name == "InvertedDoublePendulum-v5":
            x, _, y = data.site_xpos[0]
            expected.append(inner._get_rew(x, y, y <= 1)[0])
        elif name == "Swimmer-v5":
            expected.append(inner._get_rew(v[0], u)[0])
        else:
            expected.append(inner._get_rew(u)[0])
    problem, x = restated(f"gymnasium/{name}", model, Starts(qpos, qvel))
    found = problem.reward(x) - (problem.control_cost(x) * controls**2).sum(axis=1)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert len(np.unique(expected)) > 1


def test_gymnasiums_swimmer_pays_the_mean_velocity_of_its_head_over_a_step():
    """The restated reward, which is learned, is that velocity at an instant."""
    inner, task = gym.make("Swimmer-v5").unwrapped, known_task("gymnasium/Swimmer-v5")
    inner.reset(seed=0)
    model, data, dt, steps, parts = inner.model, inner.data, inner.dt, 50, 40
    fine = mujoco.MjModel.from_xml_path(inner.fullpath)
    fine.opt.timestep = dt / parts
    problem = MujocoProblem(model, task.reward, without=(), threads=1)
    paid, of_head = [], []
    for k in range(steps):
        u = 0.5 * np.sin([0.3 * k, 0.3 * k + 1])
        between, seen = mujoco.MjData(fine), []
        between.qpos[:], between.qvel[:], between.ctrl[:] = data.qpos, data.qvel, u
        for _ in range(parts + 1):
            seen.append(np.concatenate([between.qpos, between.qvel]))
            mujoco.mj_step(fine, between)
        x = problem.states(Starts(*np.split(np.array(seen), [model.nq], axis=1)))
        of_head.append(np.trapezoid(problem.reward(x)) / parts)
        before = data.qpos[0]
        paid.append(inner.step(u)[1] + 1e-4 * (u @ u))
        assert paid[-1] == pytest.approx((data.qpos[0] - before) / dt, abs=1e-12)
        mujoco.mj_forward(model, data)
        assert data.nefc == 0  # no joint is at its limit, where steps of two lengths differ
    assert task.learned is None
    assert np.allclose(of_head, paid, rtol=0, atol=1e-4 * np.abs(paid).max())
    assert np.abs(paid).max() > 0.1


class Still:
    """A policy that does nothing."""

    def __init__(self, problem):
        self.problem = problem

    def __call__(self, x):
        return np.zeros((len(x), len(self.problem.control_limits)))


def test_a_return_is_that_of_the_environment_itself():
    suite = pytest.importorskip("dm_control.suite")

    problem = MujocoTask("dm_control/reacher/easy")
    duration, skip, dt = problem.form(EpisodeForm)
    assert (duration, skip, dt) == (20.0, 0.0, 0.02)
    environment = problem.form(EnvironmentForm)
    found = environment.evaluate(Still(problem), 3, 1)
    for seed, value in enumerate(found):
        by_hand = suite.load("reacher", "easy", task_kwargs={"random": seed})
        step, total = by_hand.reset(), 0.0
        assert problem.state(open_episode("dm_control/reacher/easy", seed))[-2:] == pytest.approx(
            by_hand.physics.named.model.geom_pos["target", :2]
        )
        while not step.last():
            step = by_hand.step(np.zeros(2))
            total += step.reward
        assert value == total
    assert environment.starts(3).shape == (3, problem.state_size)


def test_returns_of_chosen_seeds_are_those_of_their_episodes():
    problem = MujocoTask("gymnasium/InvertedPendulum-v5")
    found = problem.form(EnvironmentForm).evaluate(Still(problem), 3, 1)
    assert problem.returns(Still(problem), [2, 0]).tolist() == found[[2, 0]].tolist()


def test_three_of_ten_initial_states_are_as_the_environment_begins():
    """Hanging still, where a law that draws any angle and speed hardly ever is."""
    pytest.importorskip("dm_control")
    problem = MujocoTask("dm_control/cartpole/swingup")
    names = problem.problem.layout.names
    x = problem.initial_states(np.random.default_rng(0), 1000)
    angle, rate = x[:, names.index("hinge_1")], x[:, names.index("hinge_1'")]
    hangs = (np.cos(angle) < -0.99) & (np.abs(rate) < 0.05)
    assert 0.25 < hangs.mean() < 0.36  # a binomial law's deviation is 0.015
    assert len(np.unique(angle[hangs])) > 50


def test_light_links_in_water_are_steps_of_a_control_long():
    """swimmer6 under random bang-bang controls for a second; by Euler's method it is not finite after two steps."""
    pytest.importorskip("dm_control")
    problem = MujocoTask("dm_control/swimmer/swimmer6")
    dt, rng = problem.problem.control_timestep, np.random.default_rng(0)
    assert problem.advice["dt"] == dt == pytest.approx(0.03)
    x = problem.initial_states(rng, 20)
    for _ in range(33):
        u = rng.choice([-1.0, 1.0], (20, 5)) * problem.control_limits
        x = problem.step(x, u, dt)
    assert np.abs(x).max() < 100


def test_an_episode_that_ends_early_pays_no_more():
    problem = MujocoTask("gymnasium/InvertedPendulum-v5")

    class Push(Still):
        def __call__(self, x):
            return np.full((len(x), 1), 3.0)

    pushed = problem.form(EnvironmentForm).evaluate(Push(problem), 2, 1)
    assert (pushed < 100).all()


@pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")
@pytest.mark.parametrize(
    ("environment", "complaint"),
    [
        ("dm_control/cartpole/fly", "has no task 'cartpole/fly': domain 'cartpole' has balance"),
        ("dm_control/cheetah/run", "its reward is not known as a torch function; give --reward"),
        ("gymnasium/Nothing-v5", "gymnasium has no environment 'Nothing-v5'"),
        ("gymnasium/CartPole-v1", "gymnasium/CartPole-v1 is no MuJoCo environment"),
        ("gymnasium/HalfCheetah-v3", "gymnasium has no environment 'HalfCheetah-v3'"),
        ("dm_control/lqr/lqr_2_1", "has no time limit"),
    ],
)
def test_says_in_one_line_what_it_cannot_learn(environment, complaint):
    if environment.startswith("dm_control"):
        pytest.importorskip("dm_control")
    with pytest.raises(ValueError, match=complaint) as caught:
        MujocoTask(environment)
    assert "\n" not in str(caught.value)


def test_a_model_that_is_another_in_each_episode_is_refused():
    pytest.importorskip("dm_control")
    reward = f"{__name__}:_to_the_left"
    with pytest.raises(ValueError, match=r"each episode has another model \(wrap_prm\), and one is learned"):
        MujocoTask("dm_control/point_mass/hard", reward)
    assert MujocoTask("dm_control/point_mass/easy", reward).problem.state_size == 4


def _to_the_left(scene):
    return -scene.geom("pointmass")[:, 0]


POLE = """<mujoco><option timestep="0.002"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.05"/></body></worldbody>
<actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator></mujoco>"""


def _upright(scene):
    return scene.joint("hinge").cos()


@pytest.mark.parametrize("method", ["td", "value-gradient"])
def test_a_control_is_held_for_as_long_as_is_asked(method, tmp_path, monkeypatch):
    (tmp_path / "pole.xml").write_text(POLE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "poles", sys.modules[__name__])
    options = {"reward": "poles:_upright", "control_timestep": 0.02}
    config = configured("pole.xml", method, options, 1)
    assert config.problem.control_timestep == config.problem.form(EpisodeForm).dt == 0.02
    assert config.method.settings.dt == 0.02
    assert changed(config, ["dt=0.01"]).method.settings.dt == 0.01
    own = configured("pole.xml", method, {"reward": "poles:_upright"}, 1)
    assert own.problem.form(EpisodeForm).dt == own.method.settings.dt == 0.002
    assert RunConfig.from_json(json.loads(json.dumps(config.to_json()))) == config


@pytest.mark.parametrize(
    ("problem", "control_timestep", "complaint"),
    [
        ("pole.xml", 0.003, "must be a whole number of the model's steps of 0.002 s, got 0.003"),
        ("pole.xml", 0.0, "must be a whole number of the model's steps of 0.002 s, got 0.0"),
        (
            "gymnasium/InvertedPendulum-v5",
            0.04,
            "holds a control for 0.04 s, and control_timestep is for a model",
        ),
        ("swim", 0.02, "--control-timestep is no option of problem 'swim'"),
    ],
)
def test_a_control_step_that_cannot_be_is_refused(
    problem, control_timestep, complaint, tmp_path, monkeypatch, capsys
):
    (tmp_path / "pole.xml").write_text(POLE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "poles", sys.modules[__name__])
    asked = ["--problem", problem, "--control-timestep", str(control_timestep)]
    reward = ["--reward", "poles:_upright"] if problem == "pole.xml" else []
    assert main(["train", "--out", "never", "--seconds", "1", *asked, *reward]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1
    assert not (tmp_path / "never").exists()


@pytest.mark.parametrize("method", ["td", "value-gradient"])
def test_train_says_once_what_to_heed_and_of_td_that_another_is_fast(method, tmp_path, capsys):
    """The pendulum's cart has a track with ends. What Python is warned of, the command says by itself."""
    brief = [
        "--problem",
        "gymnasium/InvertedPendulum-v5",
        "--method",
        method,
        "--s-gamma",
        "10",
        "--trials",
        "2",
    ]
    brief += ["--evaluate-every", "2", "--set", "trial_duration=0.4", *FEW[method]]
    assert main(["train", "--out", str(tmp_path / "run"), *brief]) == 0
    printed = capsys.readouterr()
    assert printed.out.count("constraints (contacts, joint limits") == 1
    assert printed.out.count("the fast one for it is --method value-gradient") == (method == "td")
    assert printed.err == ""
    assert [row["trial"] for row in _rows(tmp_path / "run")] == ["2"]
    assert main(["train", "--out", str(tmp_path / "json"), *brief, "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["runs"][0]["trials"] == 2
    assert printed.err == ""


FEW = {
    "td": ["--neurons", "4"],
    "value-gradient": ["trajectories=32", "minibatch=32", "steps=10", "layers=[4]"],
}


def _rows(run):
    with (run / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_sweep_says_once_what_to_heed(tmp_path, capsys):
    (tmp_path / "sweep.toml").write_text(
        'problem = "gymnasium/InvertedPendulum-v5"\nmethod = "value-gradient"\ntrials = 1\nevaluate_every = 1\n'
        "[set]\ns_gamma = 10.0\ntrajectories = 32\nminibatch = 32\nlayers = [4]\n[grid]\nsteps = [5, 10]\n"
    )
    assert main(["sweep", str(tmp_path / "sweep.toml"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert printed.out.count("constraints (contacts, joint limits") == 1
    assert printed.err == ""


def test_evaluate_says_what_it_measures(capsys):
    assert main(["evaluate", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Of a task of dm_control or Gymnasium, the return of its episodes" in said


def test_the_commands_learn_judge_draw_and_go_on(tmp_path, monkeypatch, capsys):
    """A model of one's own and a task, by the ordinary commands."""
    (tmp_path / "pole.xml").write_text(
        '<mujoco><option timestep="0.02"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="0.1"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.05"/></body></worldbody>'
        '<actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator></mujoco>'
    )
    (tmp_path / "pole_reward.py").write_text(
        "import torch\n\n\ndef reward(scene):\n    return torch.cos(scene.joint('hinge'))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    small = ["--method", "value-gradient", "--s-gamma", "10", "--trials", "4", "--evaluate-every", "4"]
    small += ["--set", "trajectories=32", "steps=10", "minibatch=32", "dt=0.02"]
    own = ["--problem", "pole.xml", "--reward", "pole_reward:reward"]
    assert main(["train", "--out", "own", *own, *small]) == 0
    assert main(["train", "--out", "task", "--problem", "gymnasium/InvertedPendulum-v5", *small]) == 0
    assert main(["train", "--out", "task", "--resume", "--trials", "8"]) == 0
    capsys.readouterr()
    assert main(["evaluate", "task", "--episodes", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 0 <= found["return_mean"] <= 1000
    assert found["n_episodes"] == 2
    assert main(["evaluate", "own", "--episodes", "2"]) == 0
    assert main(["render", "task", "--duration", "1"]) == 0
    assert (tmp_path / "task" / "episode.mp4").stat().st_size > 1000
    assert main(["train", "--out", "never", "--problem", "mujoco"]) == 2
    assert "problem must name a model" in capsys.readouterr().err
    (tmp_path / "half_reward.py").write_text("def reward(scene:\n")
    for arguments, complaint in (
        (["--problem", "nowhere.xml"], "there is no model"),
        (
            ["--problem", "pole.xml", "--reward", "half_reward:reward"],
            "half_reward fails when it is imported: Syntax",
        ),
    ):
        assert main(["train", "--out", "never", *arguments]) == 2
        err = capsys.readouterr().err
        assert complaint in err
        assert err.count("\n") == 1
    (tmp_path / "pole.xml").write_text((tmp_path / "pole.xml").read_text().replace("0.1", "0.2"))
    assert main(["evaluate", "own", "--episodes", "2"]) == 2
    assert "pole.xml has changed since it was learned from" in capsys.readouterr().err
