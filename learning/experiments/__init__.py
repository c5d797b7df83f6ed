"""Experiments on the paper's claims and on value gradients: each recomputes its logs from scratch, with explicit seeds.

``EXPERIMENTS[name].run(directory)`` writes the CSV files ``EXPERIMENTS[name].logs`` in a directory, by default that
of the committed ones; ``swimmer_mj.render.reproduction.FIGURES[name](directory)`` draws them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from swimmer_mj.learning.experiments import (
    figure_1,
    hamiltonians,
    linear_approximators,
    linear_swimmer,
    long_runs,
    noise_at_length,
    rates_at_length,
    section_3_3,
    section_3_4,
    value_bias,
    value_gradients,
    what_decides,
)
from swimmer_mj.learning.experiments.tables import LOGS

__all__ = ["EXPERIMENTS", "LOGS", "Experiment"]


@dataclass(frozen=True)
class Experiment:
    """One experiment."""

    name: str
    description: str
    """One line."""
    run: Callable[..., None]
    """(directory, report=...): compute, and write the logs there; ``report`` is called with lines of news."""
    logs: tuple[str, ...]
    """File names."""


EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            "figure-1",
            "weights of a 66-weight network on the pendulum: basic algorithm and vario-eta",
            figure_1.run,
            (figure_1.WEIGHTS_LOG, figure_1.REWARD_LOG),
        ),
        Experiment(
            "figure-2",
            "mean V, mean squared H and speed of 5 links in long runs, and what became of each peak",
            partial(long_runs.run, "swim5"),
            ("swim5.csv",),
        ),
        *(
            Experiment(
                f"figure-2-{n}-links",
                f"figure 2 with {n} links",
                partial(long_runs.run, f"swim{n}"),
                (f"swim{n}.csv",),
            )
            for n in (3, 4)
        ),
        Experiment(
            "raw-angles",
            "5 links with the state's 12 numbers as inputs, angles within a turn and unwrapped",
            long_runs.run_angles,
            tuple(f"{name}.csv" for name in long_runs.ANGLES),
        ),
        Experiment(
            "section-3.3",
            "noise of output connections over that of internal ones against the number of neurons",
            section_3_3.run,
            (section_3_3.LOG,),
        ),
        Experiment(
            "noise-at-length",
            "section 3.3's ratio and its exponent in the number of neurons, along a million trials of the swimmer",
            noise_at_length.run,
            (noise_at_length.LOG,),
        ),
        Experiment(
            "section-3.4",
            "plain descent, scaled output, vario-eta and diagonal Levenberg-Marquardt; noise and curvature",
            section_3_4.run,
            (
                section_3_4.LEARNING_LOG,
                section_3_4.SWEEP_LOG,
                section_3_4.NOISE_LOG,
                section_3_4.WEIGHTS_LOG,
            ),
        ),
        Experiment(
            "rates-at-length",
            "section 3.4's four ways to set rates, 60 neurons, until they swim",
            rates_at_length.run,
            (rates_at_length.LEARNING_LOG, rates_at_length.SWEEP_LOG),
        ),
        Experiment(
            "linear",
            "radial basis functions and tile coding: the pendulum, and their cost with more links",
            linear_approximators.run,
            (linear_approximators.LEARNING_LOG, linear_approximators.COST_LOG),
        ),
        Experiment(
            "linear-swimmer",
            "tile coding on the swimmer of 3 links, beside the cascade",
            linear_swimmer.run,
            (linear_swimmer.LOG,),
        ),
        Experiment(
            "hamiltonian",
            "H by dV/dx . f and by the finite difference along trajectories",
            hamiltonians.run,
            (hamiltonians.DT_LOG, hamiltonians.EPISODE_LOG, hamiltonians.LEARNING_LOG),
        ),
        Experiment(
            "value-bias",
            "bias and deviation of V against Monte Carlo returns during training",
            value_bias.run,
            (value_bias.TABLE_LOG, value_bias.STATES_LOG),
        ),
        Experiment(
            "what-decides",
            "speed of the swimmer with one choice changed at a time",
            what_decides.run,
            (what_decides.LOG,),
        ),
        Experiment(
            "value-gradient-ablation",
            "value gradients with one setting changed at a time",
            value_gradients.ablation,
            (value_gradients.ABLATION_LOG,),
        ),
        Experiment(
            "value-gradient-links",
            "value gradients with 3, 4, 5, 6 and 10 links",
            value_gradients.links,
            (value_gradients.LINKS_LOG,),
        ),
        Experiment(
            "value-gradient-lasting",
            "value gradients ten times longer than to the peak",
            value_gradients.lasting,
            (value_gradients.LASTING_LOG,),
        ),
    )
}
"""All of them, by name."""
