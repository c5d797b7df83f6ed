"""The table of docs/results.md: one row a result, from the log that has it; and the README's, a part of it."""

from __future__ import annotations

import json

import compare_learners
import numpy as np
import tournament_results
from compare_learners import reached
from tables import PAPER_RATE, RESULTS, budget, last_windows, speeds, thousands, time_words, within
from tournament_results import SPEEDS

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments import LOGS, value_gradients
from swimmer_mj.learning.experiments.long_runs import SWIMMERS
from swimmer_mj.learning.experiments.summaries import Summary, peaks, trials_to
from swimmer_mj.learning.experiments.tables import read_table, rows_where
from swimmer_mj.learning.td.continuous_td import TDSettings

Row = tuple[str, str, str]

LEARNERS = "`benchmarks/compare_learners.py`, [beyond](beyond.md)"


def physics() -> list[Row]:
    """What ``swimmer-mj validate`` found."""
    checks = json.loads((RESULTS / "validation.json").read_text(encoding="utf-8"))["checks"]
    errors = {check["name"]: check["error"] for check in checks}
    by = "`swimmer-mj validate`"
    rows = [
        (
            f"{what}, A.3 against MuJoCo: largest relative error",
            f"{errors[f'{what}: A.3 and MuJoCo + callback']:.1e}",
            by,
        )
        for what in ("accelerations", "control matrices")
    ]
    change = errors["another model beside a swimmer: change of its state"]
    rows.append(
        ("change of another MuJoCo model's state by the friction in force beside it", f"{change:g}", by)
    )
    return rows


def learning() -> list[Row]:
    """Learners of the package, each in the time that all of its seeds had, and how they do in the tournament."""
    curves = {
        name: [within(curve, budget(of_name)) for curve in of_name]
        for name, of_name in compare_learners.read(compare_learners.RESULTS).items()
    }
    ours = curves["value-gradient"]
    joints = curves["value-gradient-joints"]
    last, last_with_joints = (mean_and_interval_text(last_windows(some)) for some in (ours, joints))
    steps, its = (reached(curves[name], 1.0, "simulation_steps").median for name in ("value-gradient", "td"))
    chosen = value_gradients.LASTING[0]
    lasting = rows_where(
        read_table(LOGS / value_gradients.LASTING_LOG), factor=chosen.factor, setting=chosen.setting
    )
    return [
        (
            "value gradients, ten seeds: seconds to 1.5 m/s; to 2.0 m/s (median; mean)",
            f"{time_words(ours, 1.5)}; {time_words(ours, 2.0)}",
            LEARNERS,
        ),
        (
            f"value gradients, ten seeds: speed in the second half of {budget(ours):.0f} s, m/s",
            last,
            "the same",
        ),
        (
            "the same with `--coordinates joints --held`: seconds to 2.0 m/s; to 2.4 m/s; speed in the second half of "
            f"{budget(joints):.0f} s",
            f"{time_words(joints, 2.0)}; {time_words(joints, 2.4)}; {last_with_joints}",
            LEARNERS,
        ),
        (
            "tournament of ten minutes, all tuned alike: median time to "
            f"{', '.join(map(str, SPEEDS[:-1]))} and {SPEEDS[-1]} m/s over that of the soonest peer, "
            "those among them that are given the model and the same compiled equations",
            tournament_results.headline(),
            "`benchmarks/tournament_results.py`, [peers](peers.md)",
        ),
        (
            "the same, to 1.0, 1.5 and 2.0 m/s, over that of the soonest of PPO, SAC and TD3 of Stable-Baselines3, "
            "which are not given the model",
            tournament_results.headline(("ppo", "sac", "td3"), SPEEDS[:3]),
            "the same",
        ),
        (
            "top speed of ten seeds of value gradients in ten minutes, m/s",
            f"{lasting['speed'].max():.2f}",
            "the same, `swimmer-mj figures value-gradient-lasting`",
        ),
        (
            "beside TD(λ) with η = 0.16: simulation steps to 1.0 m/s, medians",
            f"1/{its / steps:.0f}",
            "the same",
        ),
        (
            "value gradients with 3, 4, 5, 6, 10 links: the fastest of ten seeds in ten million steps, m/s",
            ", ".join(f"{top:.2f}" for top in tops_by_links()),
            "`swimmer-mj figures value-gradient-links`",
        ),
    ]


def tops_by_links() -> list[float]:
    """The fastest look at any seed, by the number of links."""
    table = read_table(LOGS / value_gradients.LINKS_LOG)
    return [
        float(np.nanmax(rows_where(table, setting=float(n))["speed"])) for n in np.unique(table["setting"])
    ]


def paper() -> list[Row]:
    """TD(lambda), eight seeds."""
    table = read_table(LOGS / "swim5.csv")
    rows = []
    for preset, eta in (("paper", "0.01, the paper's"), ("tuned", "0.16")):
        best = mean_and_interval_text(np.array([peak.peak for peak in peaks(table, preset)]))
        trials = float(np.median(trials_to(table, preset, 0.95)))
        minutes = trials * TDSettings().steps_per_trial / SWIMMERS["swim5"].steps_per_s / 60
        rows.append(
            (
                f"TD(λ), η = {eta}, eight seeds: best speed, m/s; median trials to 95 % of it; as long on one core",
                f"{best}; {trials:,.0f}; {minutes:.0f} min",
                "`swimmer-mj figures figure-2`",
            )
        )
    return rows


def throughput() -> list[Row]:
    """Steps per second."""
    rates = speeds()["engines"]
    by = "`benchmarks/learning_speed.py`, [performance](performance.md)"
    both = f"{thousands(rates['population'])}; {thousands(rates['population_all_cores'])}"
    return [
        ("bare `mj_step`, 5 links, Euler, no friction, 1/s", thousands(rates["mj_step"]), by),
        ("learning steps of one TD(λ) learner on one core, 1/s", thousands(rates["fused"]), "the same"),
        ("learning steps of a pack of 16 learners on one core; on both, 1/s", both, "the same"),
        ("learning steps of the torch reference, 1/s", thousands(rates["reference"]), "the same"),
        (
            "learning steps in the paper (2.5 million trials of 500 in a week), 1/s",
            f"{PAPER_RATE:,.0f}",
            "section 4",
        ),
    ]


def measured() -> Summary:
    """All of it."""
    return Summary("", ("what", "measured", "by"), [*physics(), *learning(), *paper(), *throughput()])


def headlines() -> Summary:
    """What the README says of each part, without where it comes from."""
    physics_rows, learning_rows, speed_rows = physics(), learning(), throughput()
    rows = [physics_rows[0], *learning_rows[:5], paper()[0], speed_rows[2], speed_rows[-1]]
    return Summary("", ("what", "measured"), [row[:2] for row in rows])
