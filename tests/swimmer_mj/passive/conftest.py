import gc

import mujoco
import pytest


@pytest.fixture(autouse=True)
def no_trace():
    """Nothing is left behind by a test."""
    gc.collect()  # environments that earlier tests dropped
    assert mujoco.get_mjcb_passive() is None
    yield
    gc.collect()
    left = mujoco.get_mjcb_passive()
    mujoco.set_mjcb_passive(None)
    assert left is None
