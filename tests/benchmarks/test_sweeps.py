"""The sweep files of studies in the docs ask for what those studies ran."""

from dataclasses import replace
from pathlib import Path

from swimmer_mj.cli.sweep import read_jobs
from swimmer_mj.learning.experiments import value_gradients, what_decides
from swimmer_mj.learning.runs.config import value_gradient_config

SWEEPS = Path(__file__).parents[2] / "benchmarks" / "sweeps"


def asked(name):
    jobs, trials = read_jobs(SWEEPS / f"{name}.toml")
    return jobs, trials, sorted({job.config.seed for job in jobs})


def test_there_is_no_other():
    tested = {"learning-rate", "value-gradient-links", "value-gradient-seeds"}
    assert {path.stem for path in SWEEPS.iterdir()} == tested


def test_the_learning_rate_of_what_decides():
    jobs, trials, seeds = asked("learning-rate")
    assert seeds == list(what_decides.SEEDS)
    assert trials * jobs[0].config.method.settings.trial_duration == what_decides.DURATION
    assert jobs[0].config.evaluate_every * what_decides.EVALUATIONS == trials
    variants = [one for one in what_decides.VARIANTS if one.factor in ("eta", "baseline")]
    wanted = {one.method.settings.eta: (one.problem, one.method) for one in variants}
    assert {job.settings["eta"]: (job.config.problem, job.config.method) for job in jobs} == wanted
    assert len(jobs) == len(wanted) * len(seeds)


def test_links_of_value_gradients():
    jobs, trials, seeds = asked("value-gradient-links")
    assert (seeds, len(jobs)) == (list(range(10)), 50)
    assert trials * 500 == 10_000_000
    wanted = {one.problem.parameters.n_links: (one.problem, one.method) for one in value_gradients.LINKS}
    found = {job.settings["links"]: (job.config.problem, job.config.method) for job in jobs}
    assert found == wanted


def test_ten_seeds_of_value_gradients():
    jobs, trials, seeds = asked("value-gradient-seeds")
    assert (seeds, trials) == (list(range(10)), 30_000)
    method = value_gradient_config().method
    squares = replace(method, settings=replace(method.settings, huber=None))
    assert [job.config for job in jobs] == [
        replace(value_gradient_config(seed), method=squares) for seed in seeds
    ]
