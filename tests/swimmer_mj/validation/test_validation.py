import dataclasses
import math

import numpy as np
import pytest

from swimmer_mj import validation, viscous
from swimmer_mj.validation import (
    Check,
    Section,
    accelerations,
    callback_self_test,
    closed_forms,
    invariants,
    limits,
    other_models,
    physics_report,
    symmetries,
    trajectories,
)
from swimmer_mj.validation.records import Worst


def failures(section):
    return [
        (check.name, check.error, check.tolerance, check.worst)
        for check in section.checks
        if not check.passed
    ]


SECTIONS = {
    "accelerations": lambda rng: accelerations(rng, (1, 2, 5, 10), 1, 5),
    "trajectories": lambda rng: trajectories(rng, duration=0.5),
    "invariants": lambda rng: invariants(rng, (1, 3), 5, duration=0.5),
    "symmetries": lambda rng: symmetries(rng, (1, 4, 10), 5),
    "closed forms": lambda rng: closed_forms(duration=0.1),
    "limits": limits,
    "other models": lambda rng: other_models(),
}


@pytest.mark.parametrize("name", SECTIONS)
def test_every_section_of_the_report_passes_at_other_seeds(name):
    section = SECTIONS[name](np.random.default_rng(len(name)))
    assert failures(section) == []
    assert section.passed
    assert len({check.name for check in section.checks}) == len(section.checks)
    assert all(check.reason for check in section.checks)
    for curve in section.curves:
        assert len(curve.x) == len(curve.y) > 0


def test_the_quick_report_passes_and_tells_its_checks_apart():
    report = physics_report(1)
    assert [check.name for check in report if not check.passed] == []
    assert len({check.name for check in report}) == len(report) >= 15
    assert callback_self_test().passed


def test_without_the_callback_what_it_states_fails_and_nothing_else(monkeypatch):
    monkeypatch.setattr(viscous.friction, "acquire", lambda: None)
    monkeypatch.setattr(viscous.friction, "release", lambda: None)
    section = accelerations(np.random.default_rng(0), (1, 3), 1, 3)
    failed = {check.name for check in section.checks if not check.passed}
    assert failed == {
        "accelerations: A.3 and MuJoCo + callback",
        "accelerations: MuJoCo + callback and MuJoCo + actuators",
        "accelerations: MuJoCo + callback and Lagrange",
    }
    failed = [check for check in closed_forms(duration=0.1).checks if not check.passed]
    assert [check.name for check in failed] == [
        "a rod drifting sideways: exp(-k l t / m)",
        "a rod spinning: exp(-k l t / m)",
    ]
    assert {check.worst for check in failed} == {"MuJoCo + callback"}
    assert not callback_self_test().passed
    assert [check.name for check in other_models().checks if not check.passed] == [
        "the swimmer beside it, drifting sideways: its friction, from -k l v of all links"
    ]


@pytest.mark.parametrize("spoilt", range(3))
@pytest.mark.parametrize("error", [2.0, math.nan])
def test_the_self_test_of_the_callback_is_its_worst_motion(monkeypatch, spoilt, error):
    good = [Check(name, 1e-3, 1.0, "") for name in ("sideways", "along", "spinning")]
    checks = [dataclasses.replace(c, error=error) if i == spoilt else c for i, c in enumerate(good)]
    monkeypatch.setattr(validation, "closed_forms", lambda names: Section("", checks))
    check = callback_self_test()
    assert not check.passed
    assert check.name == f"worst of 3 motions of one rod: {good[spoilt].name}"


def test_an_error_that_is_no_number_fails_and_is_the_worst():
    for error, tolerance in ((math.nan, 1.0), (1.0, math.nan), (1.0, math.inf), (-math.inf, 1.0)):
        assert not Check("", error, tolerance, "").passed
    assert Check("", 1.0, 1.0, "").passed
    worst = Worst("", "")
    for error, tolerance, where in ((5.0, 10.0, "large"), (1.0, 0.5, "fails"), (math.nan, 1.0, "no number")):
        worst.add(error, tolerance, where)
        assert worst.check().worst == where
    worst.add(1.0, 0.0, "after")
    assert worst.check().worst == "no number"


@pytest.mark.parametrize("tolerance", [math.inf, math.nan])
@pytest.mark.parametrize("error", [0.0, 1e-9])
def test_a_tolerance_that_is_no_number_fails_and_is_the_worst(error, tolerance):
    """As of a mass matrix without a condition number, however small the error."""
    worst = Worst("", "")
    for error_here, tolerance_here, where in (
        (5.0, 10.0, "before"),
        (error, tolerance, "no bound"),
        (5.0, 1.0, "after"),
    ):
        worst.add(error_here, tolerance_here, where)
    assert worst.check().worst == "no bound"
    assert not worst.check().passed


def test_a_section_that_measured_nothing_is_no_success():
    with pytest.raises(ValueError, match="nothing was measured for the check 'x'"):
        Worst("x", "").check()
    assert not Section("", [Check("", 2.0, 1.0, "")]).passed
