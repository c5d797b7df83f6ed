"""The episodes by which learners of other people's tasks are judged."""

import any_model
import pytest


@pytest.mark.parametrize("task", any_model.TASKS)
def test_no_episode_both_decides_which_weights_are_kept_and_judges_them(task):
    assert not set(any_model.looked_at(task)) & set(any_model.fresh(task))


def test_the_tasks_with_longer_looks_are_tasks():
    assert set(any_model.EPISODES_OF_A_LOOK) <= set(any_model.TASKS)
    assert min(any_model.EPISODES_OF_A_LOOK.values()) > len(any_model.LOOKED_AT)
