import gc

import pytest


@pytest.fixture(scope="session", autouse=True)
def quick_garbage_collection():
    """Tests that look for what was left behind collect garbage often; what is imported by now need not be searched."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()
