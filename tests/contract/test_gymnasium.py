"""Gymnasium's and Stable-Baselines3's environment checkers, unmodified, on every environment."""

import gymnasium
import pytest
import stable_baselines3.common.env_checker
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.wrappers import FlattenObservation, TransformAction

import swimmer_mj.gymnasium
from swimmer_mj.environments.swimming import TASKS

IDS = [id for id in gymnasium.registry if id.startswith("swimmer_mj/")]


def task_of(id):
    return id.removeprefix("swimmer_mj/").removesuffix("-v0").lower()


def through_shimmy(id, env, **kwargs):
    """Shimmy's wrapping of our dm_control task, with observations flattened and actions in float32 as ours."""
    shimmy = pytest.importorskip("shimmy", reason="there is no dm_control here")
    wrapped = shimmy.DmControlCompatibilityV0(swimmer_mj.load(task_of(id)), **kwargs)
    return TransformAction(FlattenObservation(wrapped), lambda action: action, env.action_space)


def test_every_task_is_an_environment():
    assert {task_of(id) for id in IDS} == set(TASKS)


# Velocities have no bound. Gymnasium says this of its own MuJoCo environments too.
@pytest.mark.filterwarnings("ignore:.*A Box observation space m(in|ax)imum value is -?infinity")
@pytest.mark.parametrize("id", IDS)
def test_gymnasium_check_env(id):
    env = gymnasium.make(id, render_mode="rgb_array", width=64, height=48).unwrapped
    check_env(env)
    env.close()


@pytest.mark.parametrize("id", IDS)
def test_gymnasium_check_environments_match(id):
    env = gymnasium.make(id)
    other = through_shimmy(id, env)
    check_environments_match(env, other, num_steps=510, info_comparison="superset")
    env.close()
    other.close()


def test_gymnasium_check_environments_match_in_frames():
    id = "swimmer_mj/Steer5-v0"
    env = gymnasium.make(id, render_mode="rgb_array", width=64, height=48)
    render_kwargs = {"width": 64, "height": 48, "camera_id": "tracking"}
    other = through_shimmy(id, env, render_mode="rgb_array", render_kwargs=render_kwargs)
    check_environments_match(env, other, num_steps=3, info_comparison="superset")
    env.close()
    other.close()


@pytest.mark.parametrize("id", IDS)
def test_stable_baselines3_check_env(id):
    env = gymnasium.make(id, render_mode="rgb_array", width=64, height=48)
    stable_baselines3.common.env_checker.check_env(env)
    env.close()
