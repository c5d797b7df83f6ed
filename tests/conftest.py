import contextlib
import gc
import os

import pytest
from hypothesis import HealthCheck, settings

from swimmer_mj.render.backend import BackendError, use_backend

# Torch's threads would otherwise spin while they wait, on cores that other tests need: up to a hundred times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# MuJoCo binds its OpenGL backend at its first import, in whichever test that is. Without a usable one, only
# the tests that draw fail, and they say what is missing.
with contextlib.suppress(BackendError):
    use_backend()

# How fast an example is depends on the machine and on what else it does.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.fixture(scope="module", autouse=True)
def quick_collections():
    """Else each gc.collect() of a test takes a second, for all that torch, numba and earlier tests have made."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def suite():
    """swimmer_mj.environments.suite; a test that asks for it is skipped where dm_control cannot be installed."""
    return pytest.importorskip("swimmer_mj.environments.suite", reason="there is no dm_control here")
