"""TorchRL's environment checker, unmodified, on every task."""

import pytest
from torchrl.envs import DMControlEnv, DMControlWrapper, GymEnv
from torchrl.envs.utils import check_env_specs

import swimmer_mj
import swimmer_mj.gymnasium
from swimmer_mj.environments.swimming import TASKS


@pytest.fixture
def domain(suite):
    swimmer_mj.register()
    yield suite.DOMAIN
    swimmer_mj.unregister()


@pytest.mark.parametrize("task", TASKS)
def test_dm_control_env(domain, task):
    assert task in dict(DMControlEnv.available_envs)[domain]  # pyright: ignore[reportCallIssue, reportArgumentType]
    check_env_specs(DMControlEnv(domain, task), seed=0)


@pytest.mark.parametrize("task", TASKS)
def test_dm_control_wrapper(suite, task):
    check_env_specs(DMControlWrapper(suite.load(task)), seed=0)


def test_gym_env():
    check_env_specs(GymEnv("swimmer_mj/Swim5-v0"), seed=0)
