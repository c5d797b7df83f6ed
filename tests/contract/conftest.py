import gc

import pytest

from swimmer_mj.environments.simulation import Accessors


@pytest.fixture(scope="module", autouse=True)
def release_the_friction():
    """Other people's suites leave environments behind; while they live, the friction is in force."""
    yield
    gc.collect()
    for left in gc.get_objects():
        if issubclass(type(left), Accessors) and (release := vars(left).get("_friction")):
            release()
