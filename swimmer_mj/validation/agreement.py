"""Accelerations and control matrices, pair by pair."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation.arbiter import LagrangianSwimmer
from swimmer_mj.validation.cases import (
    ARBITER,
    EPS,
    STATEMENTS,
    random_parameters,
    random_states,
    random_torques,
    relative_error,
    statements,
)
from swimmer_mj.validation.records import Check, Curve, Section, Worst

__all__ = ["accelerations", "along", "disagreement", "scales"]

Array = NDArray[np.float64]

REASON = "2 N eps c (1 + s): two stable solutions of N = n + 2 equations of condition c, s for what cancels"
"""Of the tolerances."""


def scales(arbiter: LagrangianSwimmer, x: Array, u: Array) -> tuple[Array, Array]:
    """|f(x, u)|, or 1 where it is 0, and N eps c (1 + size / |f|): what rounding may do to f, in that unit."""
    f = np.linalg.norm(arbiter.derivative(x, u), axis=-1)
    f[f == 0] = 1.0
    condition, size = arbiter.conditioning(x, u)
    return f, (arbiter.parameters.n_links + 2) * EPS * condition * (1 + size / f)


def disagreement(
    parameters: SwimmerParameters, x: Array, u: Array
) -> tuple[dict[tuple[str, str], Array], dict[tuple[str, str], Array], Array]:
    """How far the statements and the arbiter are apart at the states x (b, 2n + 4) and torques u (b, n - 1).

    Returns
    -------
    derivatives, control_matrices : dict
        Relative errors of f(x, u) and of B(x) for each pair, shape (b,); no control matrices with one link.
    tolerance : ndarray, shape (b,)
        2 N eps c (1 + size / |f|) with N = n + 2: two solutions, each off by what rounding does to them.
    """
    swimmers = statements(parameters)
    scale, rounding = scales(swimmers[ARBITER], x, u)
    found = {name: (s.derivative(x, u), s.control_matrix(x)) for name, s in swimmers.items()}
    derivatives, matrices = {}, {}
    for one, other in itertools.combinations(found, 2):
        derivatives[one, other] = np.linalg.norm(found[one][0] - found[other][0], axis=-1) / scale
        if parameters.n_links > 1:
            matrices[one, other] = relative_error(found[one][1], found[other][1], n_axes=2)
    return derivatives, matrices, 2 * rounding


def along(parameters: SwimmerParameters, x: Array, u: Array) -> list[Check]:
    """Compare the statements and the arbiter pair by pair at states of an episode.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer.
    x, u : ndarray, shapes (b, 2n + 4) and (b, n - 1)
        Its states and torques.
    """
    derivatives, _, tolerance = disagreement(parameters, x, u)
    found = []
    for (one, other), errors in derivatives.items():
        worst = Worst(f"accelerations along the episode: {one} and {other}", REASON)
        for k, error in enumerate(errors):
            worst.add(error, tolerance[k], f"state {k} of {len(errors)}")
        found.append(worst.check())
    return found


def accelerations(
    rng: np.random.Generator, links: Iterable[int] = range(1, 11), n_swimmers: int = 2, n_states: int = 10
) -> Section:
    """Compare the statements and the arbiter pair by pair: f(x, u) and df/du, for unequal links."""
    pairs = list(itertools.combinations([*STATEMENTS, ARBITER], 2))
    by_kind = [
        {pair: Worst(f"{kind}: {pair[0]} and {pair[1]}", REASON) for pair in pairs}
        for kind in ("accelerations", "control matrices")
    ]
    links = list(links)
    curves = {pair: Curve(" and ".join(pair), [], []) for pair in pairs}
    bound = Curve("tolerance", [], [], guide=True)
    for n in links:
        largest, largest_tolerance = dict.fromkeys(pairs, 0.0), 0.0
        for _ in range(n_swimmers):
            parameters = random_parameters(rng, n)
            x, u = random_states(rng, n, n_states), random_torques(rng, parameters, n_states)
            *errors, tolerance = disagreement(parameters, x, u)
            for worst, found in zip(by_kind, errors, strict=True):
                for pair, error in found.items():
                    for e, t in zip(error, tolerance, strict=True):
                        worst[pair].add(e, t, f"{n} links")
            for pair, error in errors[0].items():
                largest[pair] = max(largest[pair], float(error.max()))
            largest_tolerance = max(largest_tolerance, float(tolerance.max()))
        for pair, curve in curves.items():
            curve.x.append(n)
            curve.y.append(largest[pair])
        bound.x.append(n)
        bound.y.append(largest_tolerance)
    checks = [w.check() for worst in by_kind for w in worst.values() if w.case is not None]
    return Section(
        "Accelerations and control matrices, pair by pair",
        checks,
        ("number of links", "largest relative error of f(x, u)"),
        [*curves.values(), bound],
    )
