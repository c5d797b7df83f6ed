"""dm_control's test of its own suite, unmodified, with our domain in the suite."""

import pytest

import swimmer_mj

suite = pytest.importorskip("dm_control.suite", reason="there is no dm_control here")

OURS = tuple((swimmer_mj.environments.suite.DOMAIN, task) for task in swimmer_mj.SUITE)

# suite_test takes its list of tasks from these two when it is imported. It gets only ours: the other domains
# are dm_control's to test. No other test finds the domain registered.
swimmer_mj.register()
with pytest.MonkeyPatch.context() as patch:
    patch.setattr(suite, "ALL_TASKS", OURS)
    patch.setattr(suite, "REWARD_VIZ", OURS)
    from dm_control.suite.suite_test import SuiteTest
swimmer_mj.unregister()

__all__ = ["SuiteTest"]


@pytest.fixture(autouse=True)
def _domain():
    swimmer_mj.register()
    yield
    swimmer_mj.unregister()


def test_the_suite_has_our_domain():
    assert set(OURS) <= set(suite.ALL_TASKS)
