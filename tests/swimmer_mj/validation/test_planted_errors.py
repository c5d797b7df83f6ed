"""The comparison of the report finds an error planted in any of the statements, and which one has it.

``benchmarks/planted_errors.py`` runs the whole report on them; here, its first section on small swimmers.
"""

import runpy
import types
from pathlib import Path

import numpy as np
import pytest
from numba import config

from swimmer_mj import analytic, dynamics, mjcf, viscous
from swimmer_mj.passive import callback, evaluation, laws
from swimmer_mj.validation import ARBITER, STATEMENTS, accelerations, cases, other_models

_FILE = Path(__file__).parents[3] / "benchmarks" / "planted_errors.py"
_PLANTED = runpy.run_path(str(_FILE))["PLANTED_ERRORS"]
PLANTED_ERRORS = [error for error in _PLANTED if not error.only]

# Where the comparison looks the statements up
_USES = {
    "analytic.py": (analytic, cases, "AnalyticSwimmer"),
    "viscous.py": (viscous, dynamics, "viscous_friction"),
    "mjcf.py": (mjcf, dynamics, "mjcf"),
}


def spoilt(module, error):
    """The module of the spoilt source text, beside the right one."""
    copy = types.ModuleType(module.__name__)
    copy.__file__ = module.__file__
    exec(
        compile(error.plant(Path(module.__file__).read_text(encoding="utf-8")), error.file, "exec"),
        vars(copy),
    )
    return copy


def test_a_sign_a_factor_and_an_index_are_planted_in_each_statement():
    planted = {(error.statement, error.kind) for error in PLANTED_ERRORS}
    assert planted == {(s, kind) for s in STATEMENTS for kind in ("sign", "factor 2", "index")}


def test_a_friction_that_acts_on_every_model_is_found_beside_a_swimmer(monkeypatch, tmp_path):
    (error,) = (error for error in _PLANTED if error.only)
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))  # where the right code is not kept
    monkeypatch.setattr(callback, "evaluation", spoilt(evaluation, error))
    monkeypatch.setattr(laws, "_shared", callback.SharedCallback())
    assert [check.name for check in other_models().checks if not check.passed] == [error.only]


@pytest.mark.parametrize("number", range(len(PLANTED_ERRORS)))
def test_a_planted_error_sets_its_statement_apart_from_all_others(number, monkeypatch):
    error = PLANTED_ERRORS[number]
    module, user, name = _USES[error.file]
    monkeypatch.setattr(user, name, getattr(spoilt(module, error), name))
    checks = accelerations(np.random.default_rng(0), links=(1, 2, 3), n_swimmers=1, n_states=3).checks
    apart = [check.name.split(": ")[1].split(" and ") for check in checks if not check.passed]
    assert len(apart) >= 3
    assert all(error.statement in pair for pair in apart)
    others = {statement for pair in apart for statement in pair} - {error.statement}
    assert others == {*STATEMENTS, ARBITER} - {error.statement}
