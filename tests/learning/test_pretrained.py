"""The policies that come with the package swim in dm_control as their cards say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swimmer_mj.learning import load_pretrained
from swimmer_mj.learning.pretrained import (
    pretrained_card,
    pretrained_directory,
    pretrained_names,
    pretrained_swimmers,
)
from swimmer_mj.learning.problems.mujoco.task import MujocoTask
from swimmer_mj.learning.problems.swim.environment import SwimmingPolicy, evaluate_swimming
from swimmer_mj.learning.runs.config import read_config
from swimmer_mj.learning.runs.run import load_policy

N_EPISODES = 12


@pytest.mark.parametrize("name", pretrained_swimmers())
def test_swims_as_fast_as_its_card_says(name):
    """By the card's first episodes: rounding that differs between processors may shift a switch, not the gait."""
    agent, card = load_pretrained(name), pretrained_card(name)
    parameters = agent.policy.problem.parameters
    assert name.startswith(f"swim{parameters.n_links}-")
    assert np.mean(card["episode_speeds"]) == pytest.approx(card["swimming_speed"], abs=1e-4)
    assert len(card["episode_speeds"]) == 64
    found = evaluate_swimming(SwimmingPolicy(agent.policy, batches=True), parameters, n_episodes=N_EPISODES)
    assert_allclose(found.speeds.mean(), np.mean(card["episode_speeds"][:N_EPISODES]), rtol=0.02)
    method = read_config(pretrained_directory(name)).to_json()["method"]["name"]
    assert method == ("td" if name.endswith("-paper") else "value-gradient")
    assert {"seed", "commit", "trial", "chosen", "ci95"} <= set(card)


@pytest.mark.parametrize("name", sorted({*pretrained_names()} - {*pretrained_swimmers()}))
def test_earns_in_its_environment_what_its_card_says(name):
    card = pretrained_card(name)
    pytest.importorskip(card["config"]["problem"]["environment"].partition("/")[0])
    policy, config, _ = load_policy(pretrained_directory(name))
    assert isinstance(config.problem, MujocoTask)
    returns = config.problem.returns(policy, range(N_EPISODES))
    assert_allclose(returns.mean(), np.mean(card["episode_returns"][:N_EPISODES]), rtol=0.02)
    assert np.mean(card["episode_returns"]) == pytest.approx(card["return"], abs=1e-4)
    assert {"seed", "commit", "trial", "chosen", "ci95"} <= set(card)


def test_another_task_s_policy_is_no_swimmer():
    complaint = r"'cartpole-swingup' learned dm_control/cartpole/swingup, and swimmers were asked for; use load_policy"
    with pytest.raises(ValueError, match=complaint):
        load_pretrained("cartpole-swingup")


def test_acts_in_the_task_of_its_links(suite):
    environment = suite.load("swim5", task_kwargs={"random": 0})
    action = load_pretrained("swim5-value-gradient")(environment.reset().observation)
    assert action.shape == environment.action_spec().shape
    assert (np.abs(action) <= 1).all()
    environment.physics.free()


@pytest.mark.parametrize("batches", [False, True])
def test_what_another_swimmer_observes_is_refused(batches):
    policy = load_pretrained("swim5-paper").policy
    agent, seen = SwimmingPolicy(policy, batches), {"angles": np.zeros((2, 3)), "velocity": np.zeros((2, 2))}
    complaint = (
        r"observation must be that of 'swim5', angles of shape \(\.\.\., 5\), got \(2, 3\); take a policy"
    )
    with pytest.raises(ValueError, match=complaint):
        agent({**seen, "angular_velocities": seen["angles"]})
    with pytest.raises(ValueError, match=r"x must have shape \(\.\.\., 12\) for 'swim5', got \(8,\)"):
        policy(np.zeros(8))  # as Gymnasium gives it


def test_each_is_small():
    for name in pretrained_names():
        assert sum(path.stat().st_size for path in pretrained_directory(name).iterdir()) < 80_000


def test_an_unknown_name_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"no pretrained policy 'swim9'; there are .*swim5-value-gradient"):
        load_pretrained("swim9")
