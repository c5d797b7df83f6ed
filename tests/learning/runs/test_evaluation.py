import dataclasses

import numpy as np
import pytest
import torch

from swimmer_mj import state as st
from swimmer_mj.cli.output import make_console, print_evaluation
from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import BatchPolicy, CostForm, EnvironmentForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import (
    SwimmingPolicy,
    evaluate_swimming,
    evaluation_states,
    observed_state,
    record_episode,
)
from swimmer_mj.learning.runs import evaluation
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.evaluation import evaluate_run, monte_carlo_value
from swimmer_mj.learning.runs.run import Metrics, TrainingRun, evaluation_sample
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.parameters import SwimmerParameters

THREE = SwimmerParameters(n_links=3)


@dataclasses.dataclass(frozen=True)
class Dear(Pendulum):
    """One whose torque costs."""

    def form(self, kind):
        return CostForm(lambda x: np.full((*x.shape[:-1], 1), 0.1)) if kind is CostForm else None


@pytest.fixture(scope="module")
def policy():
    """Of an untrained network whose value nevertheless depends on the state."""
    problem = Swimming(THREE)
    network = Cascade(problem.n_inputs, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    with torch.no_grad():
        network.weight[-1] = torch.randn(network.weight.shape[1], generator=torch.Generator().manual_seed(1))
    return GreedyPolicy(problem, network)


def test_evaluation_starts_from_the_64_states_of_seed_0():
    states = evaluation_states(5)
    assert states.shape == (64, 12)
    assert (states == Swimming().initial_states(np.random.default_rng(0), 64)).all()


def test_speed_is_displacement_over_time_in_the_second_half(suite, policy):
    agent = SwimmingPolicy(policy)
    result = evaluate_swimming(agent, THREE, n_episodes=2)
    start = evaluation_states(3)[1]
    environment = suite.load("swim3", task_kwargs={"time_limit": 20.0, "initial_states": lambda _: start})
    step = environment.reset()
    while environment.physics.time() < 10 - 1e-9:
        step = environment.step(agent(step.observation))
    halfway = environment.physics.center_of_mass()[0]
    while not step.last():
        step = environment.step(agent(step.observation))
    assert environment.physics.time() == pytest.approx(20.0)
    displacement = environment.physics.center_of_mass()[0] - halfway
    environment.physics.free()
    assert result.speeds[1] == pytest.approx(displacement / 10, rel=1e-9)
    assert result.mean == pytest.approx(result.speeds.mean())


def test_threads_share_the_episodes_without_changing_them(policy):
    agent = SwimmingPolicy(policy, batches=True)
    alone = evaluate_swimming(agent, THREE, n_episodes=4)
    shared = evaluate_swimming(agent, THREE, n_episodes=4, workers=2)
    assert (shared.speeds == alone.speeds).all()


def test_scores_are_those_of_an_episode_in_dm_control(suite):
    """Of a smooth policy, whose episodes rounding does not lead astray; rewards are mean velocities of a step."""
    problem, gain = Swimming(THREE, s_gamma=0.5), np.array([[1.0, -2.0, 0.3], [0.5, 1.0, -1.0]])

    class Waver:
        def __init__(self):
            self.problem = problem

        def __call__(self, x):
            return 5.0 * np.tanh(x[..., 3:6] @ gain.T + np.sin(x[..., :3]) @ gain.T)

    found = {one.measure: one for one in problem.form(EnvironmentForm).scores(Waver(), 2, 1)}
    start = evaluation_states(3)[1]
    environment = suite.load("swim3", task_kwargs={"time_limit": 60.0, "initial_states": lambda _: start})
    agent, step, rewards = SwimmingPolicy(Waver()), environment.reset(), []
    while not step.last():
        step = environment.step(agent(step.observation))
        rewards.append(step.reward)
    environment.physics.free()
    rewards = np.array(rewards)
    expected = {
        "speed": rewards[1000:2000].mean(),
        "steady_speed": rewards[3000:6000].mean(),
        "first_5s_speed": rewards[:500].mean(),
        "discounted_return": (0.01 * np.exp(-0.005 * np.arange(6000)) * rewards).sum(),
    }
    assert [*found] == [*expected]
    for measure, value in expected.items():
        assert found[measure].values[1] == pytest.approx(value, abs=1e-7), measure
        assert found[measure].unit == ("m" if measure == "discounted_return" else "m/s")
    assert len({round(value, 4) for value in expected.values()}) == 4


def test_an_episode_that_blows_up_is_refused(policy):
    wild = SwimmerParameters(n_links=3, torque_limit=1e9)
    with pytest.raises(FloatingPointError, match="MuJoCo"):
        evaluate_swimming(SwimmingPolicy(policy), wild, n_episodes=1)


def test_batches_are_acted_on_as_single_states(policy):
    states = evaluation_states(3)
    assert isinstance(policy, BatchPolicy)
    assert (policy.acting()(states) == np.stack([policy(x) for x in states])).mean() > 0.99


def test_recorded_episode_is_the_evaluated_one(policy):
    agent = SwimmingPolicy(policy)
    trajectory = record_episode(policy, THREE, evaluation_states(3)[0])
    assert trajectory.duration == pytest.approx(20.0)
    assert trajectory.speed(after=10.0) == pytest.approx(
        evaluate_swimming(agent, THREE, n_episodes=1).mean, rel=1e-9
    )
    z = st.reduce(THREE, trajectory.states[7])
    judged = policy.judge(z)
    assert trajectory.values[7] == pytest.approx(judged.value, rel=1e-9)
    assert trajectory.hamiltonians[7] == pytest.approx(judged.hamiltonian, rel=1e-7)
    assert (trajectory.controls[7] == judged.control).all()


def test_a_policy_for_x_swims_in_any_direction(policy):
    """Turning the initial state and the target together turns the whole episode."""
    angle = 2.1
    start = evaluation_states(3)[0]
    z = st.split_reduced(start, 3)
    turned = st.join_reduced(z.angles + angle, z.angular_velocities, st.rotate(z.velocity, angle))
    straight = record_episode(policy, THREE, start, 1.0)
    rotated = record_episode(policy, THREE, turned, 1.0, lambda time: angle)
    assert rotated.speed() == pytest.approx(straight.speed(), abs=1e-8)
    assert rotated.centers_of_mass() == pytest.approx(st.rotate(straight.centers_of_mass(), angle), abs=1e-8)


def test_observed_state_is_the_reduced_state_in_the_targets_frame(suite):
    environment = suite.load("steer3", task_kwargs={"random": 3})
    observation = environment.reset().observation
    z = st.split_reduced(environment.physics.reduced_state(), 3)
    direction = environment.physics.target_direction()
    environment.physics.free()
    seen = st.split_reduced(observed_state(observation), 3)
    assert np.cos(seen.angles) == pytest.approx(np.cos(z.angles - direction))
    assert seen.velocity == pytest.approx(st.rotate(z.velocity, -direction))


def test_monte_carlo_value_of_a_linear_system_is_its_closed_form():
    """dx/dt = -x, r = x: V = x / (s_gamma + 1)."""

    class Linear:
        s_gamma = 0.8

        def drift_and_control_matrix(self, x):
            return -x, np.zeros((*x.shape, 1))

        def reward(self, x):
            return x[..., 0]

        def form(self, kind):
            return CostForm(lambda x: np.full_like(x, 0.3)) if kind is CostForm else None

    states = np.array([[1.0], [-2.0], [0.3]])
    for u in (0.0, 2.0):  # which moves nothing here, and costs 0.3 u^2 all the time
        estimate = monte_carlo_value(Linear(), lambda x, u=u: np.full((len(x), 1), u), states, tolerance=1e-6)
        assert estimate == pytest.approx(states[:, 0] / 1.8 - 0.3 * u**2 / 0.8, rel=1e-4)


def test_a_recorded_episode_has_what_its_controls_cost_taken_off():
    problem = Dear()
    network = Cascade(3, 6, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    torch.nn.init.constant_(network.weight[-1], 0.5)
    episode = evaluation.record_episode(GreedyPolicy(problem, network), 0.1)
    assert np.abs(episode.controls).max() > 0
    rewards = np.cos(episode.states[:-1, 0]) - 0.1 * episode.controls[:, 0] ** 2
    assert episode.rewards[:-1] == pytest.approx(rewards, rel=1e-12)


def test_monte_carlo_value_agrees_with_the_compiled_rollout():
    problem = Pendulum(s_gamma=2.0)
    network = Cascade(3, 6, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    with torch.no_grad():
        network.weight[-1] = torch.randn(network.weight.shape[1], generator=torch.Generator().manual_seed(3))
    states = problem.initial_states(np.random.default_rng(0), 4)
    estimate = monte_carlo_value(problem, GreedyPolicy(problem, network), states, tolerance=np.exp(-6.0))
    compiled = FusedTD(problem, network).rollout(states, 3.0).discounted_return
    assert estimate == pytest.approx(compiled, abs=2e-4)


def test_returns_of_a_run_with_logistic_neurons_are_those_of_its_policy(tmp_path, capsys):
    """Equation 1 as a sum over greedy RK4 steps of 0.01 s, written out here; s_gamma 25 1/s makes it 40 of them."""
    method = TemporalDifferences(neurons=4, sigmoid="logistic", dtype="float64")
    config = RunConfig(Swimming(THREE, s_gamma=25.0), method)
    run = TrainingRun(tmp_path / "run", config)
    with torch.no_grad():
        run.learning.network.weight.normal_(generator=torch.Generator().manual_seed(1)).mul_(
            run.learning.network.connected
        )
    run.save(Metrics(0, 0.0, 0.0, 0.0, 0.0))  # what it learned is not of interest here
    result = evaluate_run(run.directory, "last", 1)

    problem, policy = run.problem, GreedyPolicy(run.problem, run.learning.network)
    x = evaluation_sample(problem)
    total = np.zeros(len(x))
    for k in range(40):
        u = policy(x)

        def f(y, u=u):
            a, B = problem.drift_and_control_matrix(y)
            return a + np.einsum("npq,nq->np", B, u)

        total += np.exp(-0.25 * k) * 0.01 * problem.reward(x)
        x = rk4_step(f, x, 0.01)
    assert result["mean_return"] == pytest.approx(total.mean(), rel=1e-9)
    bias = policy.judge(evaluation_sample(problem)).value.mean() - total.mean()
    assert result["value_bias"] == pytest.approx(bias, rel=1e-9)
    assert result["speed_ci95"] is None  # of a single episode
    print_evaluation(make_console(quiet=False), result)
    assert "m/s (1 episode)\n" in capsys.readouterr().out


def test_without_an_environment_there_are_64_episodes_at_most(tmp_path):
    config = RunConfig(Pendulum(s_gamma=25.0), TemporalDifferences(neurons=3))
    run = TrainingRun(tmp_path / "run", config)
    run.save(Metrics(0, 0.0, 0.0, 0.0, 0.0))
    assert evaluate_run(run.directory, "last", 100)["n_episodes"] == 64
