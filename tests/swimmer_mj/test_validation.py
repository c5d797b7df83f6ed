import math

import pytest

from swimmer_mj import viscous
from swimmer_mj.validation import Check, physics_report


@pytest.mark.parametrize("seed", range(3))
def test_the_physics_passes(seed):
    report = physics_report(seed, n_states=50)
    assert [check.name for check in report if not check.passed] == []
    assert len({check.name for check in report}) == len(report) >= 6


def test_without_friction_in_mujoco_the_checks_that_need_it_fail(monkeypatch):
    monkeypatch.setattr(viscous._shared, "acquire", lambda: None)
    monkeypatch.setattr(viscous._shared, "release", lambda: None)
    failed = {check.name.split(":")[0] for check in physics_report(0, n_states=50) if not check.passed}
    assert failed == {"accelerations", "trajectory of 0.2 s", "a rod sideways"}


def test_an_error_that_is_no_number_fails():
    assert not Check("", math.nan, 1.0, "").passed
    assert Check("", 1.0, 1.0, "").passed
