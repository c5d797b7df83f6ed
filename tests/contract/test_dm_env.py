"""dm_env's test of environments, unmodified, on every task."""

import pytest

import swimmer_mj

absltest = pytest.importorskip("absl.testing.absltest", reason="there is no dm_control here")
test_utils = pytest.importorskip("dm_env.test_utils", reason="there is no dm_control here")


class _Contract(test_utils.EnvironmentTestMixin):
    task: str

    def make_object_under_test(self, **unused_kwargs):
        return swimmer_mj.load(self.task, {"random": 0, "time_limit": 0.05})

    def make_action_sequence(self):
        for _ in range(12):  # two episodes and the start of a third
            yield self.make_action()


class Swim3Test(_Contract, absltest.TestCase):
    task = "swim3"


class Swim4Test(_Contract, absltest.TestCase):
    task = "swim4"


class Swim5Test(_Contract, absltest.TestCase):
    task = "swim5"


class Steer3Test(_Contract, absltest.TestCase):
    task = "steer3"


class Steer4Test(_Contract, absltest.TestCase):
    task = "steer4"


class Steer5Test(_Contract, absltest.TestCase):
    task = "steer5"


def test_every_task_is_tested():
    assert {contract.task for contract in _Contract.__subclasses__()} == set(swimmer_mj.SUITE)
