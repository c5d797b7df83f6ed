"""TorchRL's environment checker, unmodified, on every task."""

import pytest
from torchrl.envs import DMControlEnv, DMControlWrapper, GymEnv
from torchrl.envs.utils import check_env_specs

import swimmer_mj
import swimmer_mj.gymnasium


@pytest.fixture
def domain():
    swimmer_mj.register()
    yield swimmer_mj.environments.suite.DOMAIN
    swimmer_mj.unregister()


@pytest.mark.parametrize("task", swimmer_mj.SUITE)
def test_dm_control_env(domain, task):
    assert task in dict(DMControlEnv.available_envs)[domain]  # pyright: ignore[reportCallIssue, reportArgumentType]
    check_env_specs(DMControlEnv(domain, task), seed=0)


@pytest.mark.parametrize("task", swimmer_mj.SUITE)
def test_dm_control_wrapper(task):
    check_env_specs(DMControlWrapper(swimmer_mj.load(task)), seed=0)


def test_gym_env():
    check_env_specs(GymEnv("swimmer_mj/Swim5-v0"), seed=0)
