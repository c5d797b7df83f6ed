"""What the logs say of the paper's section 3: rows of :mod:`swimmer_mj.learning.experiments.claims`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval_text as interval
from swimmer_mj.learning.experiments import (
    figure_1,
    long_runs,
    noise_at_length,
    rates_at_length,
    section_3_3,
    section_3_4,
)
from swimmer_mj.learning.experiments.section_3_3 import power_of_n
from swimmer_mj.learning.experiments.tables import last_look, read_table, rows_where, span

__all__ = [
    "curvature",
    "exponent",
    "internal_spread",
    "ratios",
    "ratios_at_length",
    "scaled",
    "second_order",
    "small_means",
    "spread_of_noise",
    "variance",
    "vario",
]

Array = NDArray[np.float64]

LAST_TRIALS = 20_000
"""Of section 3.3 on the swimmer."""


def spread_of_noise(logs: Path) -> str:
    """Section 3.1."""
    table = read_table(logs / figure_1.WEIGHTS_LOG)
    rows = rows_where(table, method="basic", quantity="noise")
    names = [name for name in table if name[0] == "w" and name[1:].isdigit()]
    noise = np.stack([rows[name] for name in names])
    late = noise[:, -1]
    eta = last_look(rows_where(table, method="basic", quantity="rate"))["w0"][0]
    return (
        f"{len(names)} weights on the pendulum (one hidden layer of 13, η {eta:g}, one seed): the noise of the "
        "noisiest is "
        f"{late.max() / late.min():.0f} times that of the quietest"
    )


def small_means(logs: Path) -> str:
    """Section 3.2."""
    table = rows_where(read_table(logs / section_3_3.LOG), output_scaling=1)
    pendulum, swimmer = (last_look(rows_where(table, problem=name)) for name in ("pendulum", "swim5"))
    column = "mean_over_deviation"
    return (
        f"abs(mean) / deviation (η {section_3_3.ETA:g}), median over weights, then over networks: "
        f"{np.median(pendulum[column]):.2f} "
        "on the pendulum "
        f"after {pendulum['trial'][0]:,.0f} trials ({span(pendulum[column], '.2g')}), "
        f"{np.median(swimmer[column]):.2f} on the "
        f"swimmer after {swimmer['trial'][0]:,.0f}. That is the resolution of the moving averages with β = "
        "1/100, which give "
        "0.05 for noise without any mean: the ratio is that small or smaller"
    )


def vario(logs: Path) -> str:
    """Section 3.2."""
    table = read_table(logs / figure_1.WEIGHTS_LOG)
    rates = last_look(rows_where(table, method="vario-eta", quantity="rate"))
    values = np.array([rates[name][0] for name in table if name[0] == "w" and name[1:].isdigit()])
    basic = last_look(rows_where(table, method="basic", quantity="rate"))["w0"][0]
    end = last_look(read_table(logs / figure_1.REWARD_LOG))
    both = {method: rows_where(end, method=method)["reward"] for method in ("basic", "vario-eta")}
    return (
        f"It equalises: rates from {values.min():.2g} to {values.max():.2g} in place of {basic:.2g} for all "
        "(one seed). It "
        "starts slower than the best global rate, because v_i(0) is large, and ends higher: reward "
        f"{interval(both['vario-eta'])} against {interval(both['basic'])} over {len(both['basic'])} seeds"
    )


def exponent(logs: Path, least: int = 30) -> tuple[float, float, float]:
    """:func:`power_of_n` of the ratio on the swimmer after 20,000 trials, from ``least`` neurons on."""
    table = rows_where(read_table(logs / section_3_3.LOG), output_scaling=1, problem="swim5")
    last = last_look(table)
    many = last["n"] >= least
    return power_of_n(last["n"][many], last["output"][many] / last["internal"][many])


def ratios_at_length(logs: Path, eta: float) -> str:
    """Of the ratio on the swimmer divided by n, and of its exponent, at the end of the long runs."""
    rows = last_look(rows_where(read_table(logs / noise_at_length.LOG), eta=eta))
    ratio, sizes = rows["output"] / rows["internal"], np.unique(rows["n"])
    shares = ", ".join(interval(ratio[rows["n"] == n] / n, ".2g") for n in sizes)
    b, half, _ = power_of_n(rows["n"], ratio)
    return f"{shares} for n = {', '.join(f'{n:.0f}' for n in sizes)}, to the power {b:.2f} ± {half:.2f}"


def ratios(logs: Path) -> str:
    """Section 3.3."""
    table = rows_where(read_table(logs / section_3_3.LOG), output_scaling=1)

    def of(problem: str, trial: float) -> tuple[str, str, Array]:
        rows = rows_where(table, problem=problem, trial=trial)
        sizes = np.unique(rows["n"])
        cells = [rows_where(rows, n=float(n)) for n in sizes]
        shares = [cell["output"] / cell["internal"] / n for cell, n in zip(cells, sizes, strict=True)]
        return (
            ", ".join(interval(share, ".2g") for share in shares),
            ", ".join(f"{n:.0f}" for n in sizes),
            np.array([share.mean() for share in shares]),
        )

    pendulum, pendulum_sizes, _ = of("pendulum", 4000)
    swimmer, swimmer_sizes, _ = of("swim5", LAST_TRIALS)
    (*_, early), (*_, swimmer_early) = of("pendulum", 500), of("swim5", 500)
    b, half, p = exponent(logs)
    end = last_look(read_table(logs / noise_at_length.LOG))["trial"][0]
    paper = long_runs.ETAS["paper"]
    long, slow = (ratios_at_length(logs, eta) for eta in (section_3_3.ETA, paper))
    return (
        f"Ratio divided by n, η {section_3_3.ETA:g}, 8 seeds. Pendulum: {span(early, '.2g')} after 500 "
        "trials; after 4,000 trials "
        f"{pendulum} for "
        f"n = {pendulum_sizes}. Swimmer: {span(swimmer_early, '.3g')} after 500 trials; after "
        f"{LAST_TRIALS:,} trials "
        f"{swimmer} for n = {swimmer_sizes}, and still falling. From 30 neurons on the swimmer's ratio grows "
        "as n to the power "
        f"{b:.2f} ± {half:.2f} (least squares over all networks; p = {p:.2f} for a power of 1). After {end:,.0f} "
        f"trials: {long}; by the paper's η, {paper:g}: {slow}"
    )


def internal_spread(logs: Path) -> str:
    """Section 3.3."""
    table = rows_where(read_table(logs / section_3_3.LOG), output_scaling=1)
    spans = []
    for name in ("pendulum", "swim5"):
        rows = last_look(rows_where(table, problem=name))
        spread = rows["neuron_p95"] / rows["neuron_p05"]
        medians = np.array([np.median(spread[rows["n"] == n]) for n in np.unique(rows["n"])])
        spans.append(" to ".join(f"{float(f'{value:.2g}'):,.0f}" for value in (medians.min(), medians.max())))
    return (
        f"η {section_3_3.ETA:g}. The 95 % quantile over hidden neurons is {spans[0]} times the 5 % quantile on "
        "the pendulum, the more the larger the "
        f"cascade, and {spans[1]} times on the swimmer after {LAST_TRIALS:,} trials (medians over seeds, by size)"
    )


# Section 3.4 ------------------------------------------------------------------------------------------------------


def _rewards(logs: Path, problem: str) -> dict[str, Array]:
    """Of each method by seed: the swimmer's at the end, the pendulum's over training but its start."""
    table = rows_where(read_table(logs / section_3_4.LEARNING_LOG), problem=problem)
    found = {}
    for method in dict.fromkeys(table["method"].tolist()):
        rows = rows_where(table, method=method)
        seeds = np.unique(rows["seed"])
        at_end = last_look(rows)["reward"]
        over_all = np.array([rows_where(rows, seed=float(seed))["reward"][1:].mean() for seed in seeds])
        found[method] = at_end if problem == "swim5" else over_all
    return found


def scaled(logs: Path) -> str:
    """Section 3.3."""
    etas = {}
    for problem in ("pendulum", "swim5"):
        table = rows_where(read_table(logs / section_3_4.LEARNING_LOG), problem=problem)
        etas[problem] = [rows_where(table, method=method)["eta"][0] for method in ("output scaled", "plain")]
    pendulum, swimmer = _rewards(logs, "pendulum"), _rewards(logs, "swim5")
    return (
        "Each with the best rate of a sweep on other seeds, 8 seeds, cascades of 12 (pendulum) and 30 "
        "neurons (swimmer): best "
        f"rate on the pendulum {etas['pendulum'][0]:g} with the scaling and {etas['pendulum'][1]:g} without, "
        "on the swimmer "
        f"{etas['swim5'][0]:g} and {etas['swim5'][1]:g}; mean reward over training on the pendulum "
        f"{interval(pendulum['output scaled'])} with the scaling, {interval(pendulum['plain'])} without; "
        "speed of the swimmer "
        f"after 12,000 trials {interval(swimmer['output scaled'])} against {interval(swimmer['plain'])} m/s. "
        + _scaled_at_length(logs)
    )


def _scaled_at_length(logs: Path) -> str:
    table = read_table(logs / rates_at_length.LEARNING_LOG)
    etas = [rows_where(table, method=method)["eta"][0] for method in ("output scaled", "plain")]
    end = float(table["trial"].max())
    late = _at_length(logs, end)
    return (
        f"With 60 neurons and a sweep of its own the best rates on the swimmer are {etas[0]:g} and {etas[1]:g}, "
        f"speeds after {end:,.0f} trials {interval(late['output scaled'])} and {interval(late['plain'])} m/s"
    )


def _at_length(logs: Path, trial: float) -> dict[str, Array]:
    """Speeds by method, 60 neurons, after so many trials."""
    rows = rows_where(read_table(logs / rates_at_length.LEARNING_LOG), trial=trial)
    return {method: rows_where(rows, method=method)["reward"] for method in section_3_4.METHODS}


def curvature(logs: Path) -> str:
    """Section 3.4."""
    table = read_table(logs / section_3_4.NOISE_LOG)
    ranks, squares, spreads = [], [], []
    for problem in ("pendulum", "swim5"):
        end = last_look(rows_where(table, problem=problem))
        for method in np.unique(end["method"]):
            rows = rows_where(end, method=method)
            ranks.append(np.median(rows["rank_correlation"]))
            squares.append(np.median(rows["rank_correlation_gradient"]))
            spreads.append(np.median(rows["ratio_p95"] / rows["ratio_p05"]))
    return (
        "In order, not in size: over the weights of a network their rank correlation is "
        f"{span(np.array(ranks))} (medians by "
        f"method, 8 seeds, at the end), that of v and the mean of (∂V/∂w)² {span(np.array(squares))}; v / h "
        "spreads over a "
        f"factor of {span(np.array(spreads), '.0f')} (95 % over 5 % quantile)"
    )


def variance(logs: Path) -> str:
    """Section 3.4."""
    table = read_table(logs / section_3_4.NOISE_LOG)
    growth: dict[str, list[tuple[float, float]]] = {}
    for problem in ("pendulum", "swim5"):
        rows = rows_where(table, problem=problem)
        for method in dict.fromkeys(rows["method"].tolist()):
            of_method = rows_where(rows, method=method)
            first = rows_where(of_method, trial=float(of_method["trial"].min()))
            last = last_look(of_method)
            factors = (float(np.median(last[c] / first[c])) for c in ("noise_p50", "noise_mean"))
            growth.setdefault(problem, []).append((next(factors), next(factors)))
    swimmer, pendulum = np.array(growth["swim5"]), np.array(growth["pendulum"])
    sweep = read_table(logs / section_3_4.SWEEP_LOG)
    lost = sweep["diverged"] > 0
    return (
        f"Swimmer: from trial 2,000 to 12,000 the median weight's v grew {span(swimmer[:, 0], '.1f')} times, "
        "by method; its "
        f"mean, which the output weights make up, {span(swimmer[:, 1], '.2f')} times. Pendulum: the median "
        "weight's v fell by a "
        f"factor of {span(1 / pendulum[:, 0], '.0f')} once the task was solved, which is the danger that the "
        "section names. None "
        f"of the runs shown diverged; of the {len(lost)} of the sweep {lost.sum()} did, all of them "
        f"{' and '.join(sorted(set(sweep['method'][lost].tolist())))} with η = "
        f"{', '.join(f'{eta:g}' for eta in np.unique(sweep['eta'][lost]))}"
    )


def second_order(logs: Path) -> str:
    """Section 3.4."""
    end = float(read_table(logs / rates_at_length.LEARNING_LOG)["trial"].max())
    early, late = _at_length(logs, 30_000.0), _at_length(logs, end)

    def both(method: str) -> str:
        return f"{interval(early[method])} and {interval(late[method])}"

    return (
        f"Swimmer, 60 neurons, each method with the best setting of a sweep on other seeds, 8 seeds, speed after "
        f"30,000 and {end:,.0f} trials: stochastic diagonal Levenberg-Marquardt {both('Levenberg-Marquardt')} m/s, "
        f"vario-η {both('vario-eta')}, the scaled rate {both('output scaled')}, plain descent {both('plain')}"
    )
