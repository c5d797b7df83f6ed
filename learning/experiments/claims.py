"""The paper's claims one by one, and what the logs say of each: the table of docs/reproduction.md.

Each function below makes the text of a row from logs; :func:`claims` is the table. The judgements, and what a number is
put beside, are ours; the numbers are the logs'.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval_text as interval
from swimmer_mj.learning.experiments import claims_of_section_3 as section_3
from swimmer_mj.learning.experiments import hamiltonians, linear_approximators, value_bias
from swimmer_mj.learning.experiments.summaries import Summary, peaks, trials_to
from swimmer_mj.learning.experiments.tables import LOGS, Table, last_look, read_table, rows_where, span

__all__ = ["claims", "plateau"]

Array = NDArray[np.float64]
Logs = str | os.PathLike[str]


def _million(trials: float) -> str:
    return f"{trials / 1e6:.2f} million" if trials >= 1e6 else f"{round(trials, -3):,.0f}"


# Sections 1 and 2 -------------------------------------------------------------------------------------------------


def linear(logs: Path) -> str:
    """Section 1."""
    cost = read_table(logs / linear_approximators.COST_LOG)
    growth = {}
    for name in ("radial basis", "tile coding"):
        weights = rows_where(cost, approximator=name)["weights"]
        growth[name] = round(float(np.exp(np.diff(np.log(weights)).mean())))
    tiles, cascade = (
        rows_where(cost, approximator=name, links=4)["weights"][0] for name in ("tile coding", "cascade")
    )
    learning = last_look(read_table(logs / linear_approximators.LEARNING_LOG))
    rewards = {
        name: rows_where(learning, approximator=name)["reward"]
        for name in np.unique(learning["approximator"])
    }
    seeds, etas = len(rewards["cascade"]), linear_approximators.ETAS
    return (
        f"Weights and seconds a step for 2 to 10 links: radial basis functions need {growth['radial basis']} "
        "times, tile "
        f"coding {growth['tile coding']} times as many weights with each link; a table of tiles for 4 links is "
        f"{tiles / 1e6:.0f} million weights, the cascade's {cascade:,.0f}. Both learn the pendulum: mean cos "
        "of the angle "
        f"over the last 10 of 20 s {interval(rewards['radial basis'])} and {interval(rewards['tile coding'])} "
        f"over {seeds} "
        f"seeds, with η {etas['radial basis']:g} and {etas['tile coding']:g}; a cascade of 20 neurons with η "
        f"{etas['cascade']:g} {interval(rewards['cascade'])} after as many trials, "
        f"{learning['trial'][0]:,.0f}"
    )


def hamiltonian(logs: Path) -> str:
    """Section 2.2."""
    at = rows_where(read_table(logs / hamiltonians.DT_LOG), dt=0.01)
    learning = last_look(read_table(logs / hamiltonians.LEARNING_LOG))
    gradient, difference = (rows_where(learning, form=form)["reward"] for form in ("gradient", "difference"))
    return (
        "One network that swims, η 0.04, one seed: on average ∂V/∂x · f exceeds (V(x(t + δt)) - V(x(t))) / "
        "δt, by an "
        "amount "
        f"proportional to δt. At 0.01 s the excess has a root mean square of {at['rms_excess'][0]:.3f} m/s "
        "where H itself "
        f"has {at['rms_gradient'][0]:.2f}; {at['share_switching'][0]:.0%} of its mean square comes from the "
        f"{at['switching'][0]:.0%} of the steps in which a control switches, and all but "
        f"{at['rms_unexplained'][0]:.4f} m/s is the second-order term. The pendulum learns the same with both "
        "(radial "
        f"basis functions, η {hamiltonians.PENDULUM_ETA:g}, {len(gradient)} seeds, reward {gradient.mean():.3f} "
        f"and {difference.mean():.3f})"
    )


def bias(logs: Path) -> str:
    """Section 2.1."""
    table = read_table(logs / value_bias.TABLE_LOG)

    def mean(rows: Table, column: str, spec: str = ".2f") -> str:
        return f"{rows[column].mean():{spec}}"

    pendulum, swimmer = (rows_where(table, problem=name) for name in ("pendulum", "swim5"))
    first, last = rows_where(pendulum, trial=float(pendulum["trial"].min())), last_look(pendulum)
    swims, early = last_look(swimmer), rows_where(swimmer, trial=500)
    return (
        f"η {value_bias.ETA:g}. Pendulum, {len(last['seed'])} seeds: the bias is {mean(last, 'bias')} of a "
        "return of "
        f"{mean(last, 'mean_return')} "
        f"after {last['trial'][0]:,.0f} trials, the standard deviation of the error falls from "
        f"{mean(first, 'deviation')} after {first['trial'][0]:.0f} to "
        f"{mean(last, 'deviation')}, the correlation rises to {mean(last, 'correlation')}. Swimmer, "
        f"{len(swims['seed'])} "
        f"seeds: after {swims['trial'][0]:,.0f} trials the bias is {mean(swims, 'bias')} m of a return of "
        f"{mean(swims, 'mean_return')} m, the standard deviation of the error {mean(swims, 'deviation')} m and the "
        f"correlation {mean(swims, 'correlation')} ({mean(early, 'correlation')} after 500 trials): V follows "
        "its policy's "
        "returns on average, and state by state only coarsely"
    )


# Section 4 --------------------------------------------------------------------------------------------------------


def plateau(logs: Path, cuts: tuple[float, ...] = (1e6, 1.5e6, 2e6, 2.5e6, 3e6)) -> Array:
    """Median over seeds of the date of the peak, if the runs had ended after so many trials; shape (cuts,)."""
    table = rows_where(read_table(logs / "swim5.csv"), preset="paper")
    dates = []
    for cut in cuts:
        early = table["trial"] <= cut
        seen = peaks({name: column[early] for name, column in table.items()}, "paper")
        dates.append(float(np.median([peak.at for peak in seen])))
    return np.array(dates)


def long_learning(logs: Path) -> str:
    """Section 4."""
    table = read_table(logs / "swim5.csv")
    paper = rows_where(table, preset="paper")
    trials = np.unique(paper["trial"])
    middle = np.array([np.median(paper["speed"][paper["trial"] == trial]) for trial in trials])
    late = middle[trials >= 5e5]
    best = {name: np.array([peak.peak for peak in peaks(table, name)]) for name in ("paper", "tuned")}
    to_95 = {name: float(np.median(trials_to(table, name, 0.95))) for name in best}
    dates = plateau(logs)
    return (
        f"Eight seeds, 3 million trials each: a plateau, not a peak. {trials[np.argmax(middle >= 0.9)]:,.0f} "
        "trials to 0.9 m/s, "
        f"then {span(late)} m/s from half a million on (median over seeds). 95 % of their best after a median of "
        f"{_million(to_95['paper'])}; the best itself, {interval(best['paper'])} m/s, is the highest of many "
        "noisy looks, and its "
        "date moves with the length of the run: cut at 1, 1.5, 2, 2.5 and 3 million trials, its median is "
        f"{', '.join(f'{date / 1e6:.2f}' for date in dates)} million. With η = 0.16 the best is "
        f"{interval(best['tuned'])} m/s, "
        f"95 % of it after {_million(to_95['tuned'])} trials"
    )


def collapse(logs: Path) -> str:
    """Section 4."""
    table = read_table(logs / "swim5.csv")
    paper = rows_where(table, preset="paper")
    late = paper["trial"] >= 5e5
    trials = np.unique(paper["trial"][late])
    middle = {
        name: np.array([np.median(paper[name][paper["trial"] == trial]) for trial in trials])
        for name in ("mean_value", "mean_squared_hamiltonian")
    }
    lost = {
        name: sum(peak.fell_to < peak.fell_from / 2 for peak in peaks(table, name))
        for name in ("paper", "tuned")
    }
    falls = [peak for peak in peaks(table, "paper") if peak.fell_to < peak.fell_from / 2]
    return (
        f"{lost['paper']} of eight seeds fall below half of their best so far, "
        f"{' and '.join(f'from {peak.fell_from:.2f} to {peak.fell_to:z.2f} m/s' for peak in falls)}, and swim "
        "again at the end "
        f"({' and '.join(f'{peak.last:.2f}' for peak in falls)} m/s). With η = 0.16 {lost['tuned']} of eight "
        "do. From half a "
        f"million trials on ⟨V⟩ is at {span(middle['mean_value'])} m and ⟨H²⟩ at "
        f"{span(middle['mean_squared_hamiltonian'])} m²/s² (medians over seeds)"
    )


def claims(logs: Logs = LOGS) -> Summary:
    """The table."""
    directory = Path(logs)
    steered = (
        "The policy is learned for one direction and turned ([deviation](deviations.md) 28); `swimmer-mj "
        "render swim5-paper` "
        "draws the same strip of weights learned with the paper's rate"
    )
    beyond = "A learner that uses trajectories more fully, and what it does: [beyond](beyond.md)"
    rows = [
        (
            "1",
            "Linear approximators cost exponentially in the dimension of the state",
            linear(directory),
            "`linear`",
            "yes",
        ),
        (
            "2.2",
            "H by ∂V/∂x · f is the continuous Bellman residual",
            hamiltonian(directory),
            "`hamiltonian`",
            "yes, to first order in δt",
        ),
        ("2.1", "V estimates the return of equation 1", bias(directory), "`value-bias`", "on the pendulum"),
        (
            "3.1, fig. 1",
            "One weight is noisy and quick, another quiet and slow",
            section_3.spread_of_noise(directory),
            "`figure-1`",
            "yes",
        ),
        (
            "3.2",
            "The deviation of the gradient is large in comparison to its mean",
            section_3.small_means(directory),
            "`section-3.3`",
            "yes",
        ),
        (
            "3.2",
            "Vario-η conditions well",
            section_3.vario(directory),
            "`figure-1`",
            "in part: the intervals overlap",
        ),
        (
            "3.3",
            "Variances on connections to the output are n times those of internal ones",
            section_3.ratios(directory),
            "`section-3.3`, `noise-at-length`",
            "late in training, up to a factor: 0.6 to 1.5 on the pendulum, 1.6 to 6 on the swimmer",
        ),
        (
            "3.3",
            "Internal variances are all of one order of magnitude",
            section_3.internal_spread(directory),
            "`section-3.3`",
            "no",
        ),
        (
            "3.3",
            "Scaling the output unit's rate allows a larger global rate, and is faster",
            section_3.scaled(directory),
            "`section-3.4`, `rates-at-length`",
            "faster; a larger rate on the pendulum and with 60 neurons, not with 30",
        ),
        (
            "3.4",
            "Gauss-Newton curvature and the variance of the gradient are very close",
            section_3.curvature(directory),
            "`section-3.4`",
            "in part",
        ),
        (
            "3.4",
            "The variance increased during learning and was never close to zero",
            section_3.variance(directory),
            "`section-3.4`",
            "on the swimmer",
        ),
        (
            "3.4",
            "Second-order methods are an alternative",
            section_3.second_order(directory),
            "`rates-at-length`",
            "they learn as fast; vario-η loses it again",
        ),
        (
            "4",
            "5 links, 60 neurons, η = 0.01: top performance after 2.5 million trials, one week",
            long_learning(directory),
            "`figure-2`",
            "it swims; a plateau from half a million on, and no date of a peak",
        ),
        (
            "4",
            "After some more training performance collapses",
            collapse(directory),
            "`figure-2`",
            "some seeds, not for good",
        ),
        (
            "4, fig. 3",
            "The swimmer swims to the right and, the target reversed, to the left",
            steered,
            "[the strip](gallery.md)",
            "yes",
        ),
        ("5", "Convergence is not guaranteed; recycling trajectories could help", beyond, "-", "-"),
    ]
    return Summary("the paper's claims", ("section", "the paper", "here", "figure", "holds?"), rows)
