"""Is the physics right? What can be said about a swimmer without knowing how it moves, and what can be known.

The motion has three statements: the linear system of A.3 (:mod:`swimmer_mj.analytic`), MuJoCo with the friction as
a passive force (:mod:`swimmer_mj.viscous`), MuJoCo with the friction as actuators (:mod:`swimmer_mj.mjcf`). No two
share a line about friction; the last two share MuJoCo's rigid bodies. Beside them stands an arbiter
(:mod:`~.arbiter`). Each check here measures one error and holds it against a tolerance that says where it
comes from.

Rounding is bounded as in any text on numerical linear algebra: N equations with a matrix of condition number c,
solved stably in arithmetic of precision eps, give a relative error of at most about N eps c.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from swimmer_mj.validation.agreement import accelerations, disagreement
from swimmer_mj.validation.bystanders import other_models
from swimmer_mj.validation.cases import (
    ARBITER,
    STATEMENTS,
    random_parameters,
    random_states,
    relative_error,
    statements,
)
from swimmer_mj.validation.conservation import invariants, measure_motion
from swimmer_mj.validation.convergence import trajectories
from swimmer_mj.validation.known_motions import closed_forms, limits
from swimmer_mj.validation.records import Check, Curve, Section
from swimmer_mj.validation.symmetry import symmetries, symmetry_errors

__all__ = [
    "ARBITER",
    "STATEMENTS",
    "Check",
    "Curve",
    "Section",
    "accelerations",
    "callback_self_test",
    "closed_forms",
    "disagreement",
    "full_report",
    "invariants",
    "limits",
    "measure_motion",
    "other_models",
    "physics_report",
    "random_parameters",
    "random_states",
    "relative_error",
    "statements",
    "symmetries",
    "symmetry_errors",
    "trajectories",
]


def full_report(seed: int = 0) -> Iterator[Section]:
    """Run all checks, in less than a minute, and yield each section when it is done.

    Parameters
    ----------
    seed : int
        Of the random swimmers, states and torques.
    """
    rng = np.random.default_rng(seed)
    for section in (accelerations, trajectories, invariants, symmetries, lambda _: closed_forms(), limits):
        with np.errstate(all="ignore"):  # a wrong motion may overflow: its errors are no numbers, and fail
            done = section(rng)
        yield done
    yield other_models()


def physics_report(seed: int = 0, n_states: int = 50) -> list[Check]:
    """Run the checks that take a few seconds together.

    Parameters
    ----------
    seed : int
        Of the random swimmers and states.
    n_states : int
        How many states the statements are compared at, for each of five numbers of links.
    """
    rng = np.random.default_rng(seed)
    sections = [
        accelerations(rng, (1, 2, 3, 5, 8), 5, max(1, n_states // 5)),
        symmetries(rng, (2, 5), 5),
        closed_forms(STATEMENTS, 0.2),
        other_models(),
    ]
    return [check for section in sections for check in section.checks]


def callback_self_test() -> Check:
    """Check that the callback acts in this installation, by one rod: the worst of its three motions."""
    checks = closed_forms(STATEMENTS[1:2]).checks
    worst = max(checks, key=lambda check: (not check.passed, check.error / check.tolerance))
    return dataclasses.replace(worst, name=f"worst of {len(checks)} motions of one rod: {worst.name}")
