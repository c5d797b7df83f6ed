"""Section 3.4: vario-eta against the stochastic diagonal Levenberg-Marquardt method and plain gradient descent.

Four ways to set the rates of a cascade's weights, with everything else the same:

- plain: one global rate;
- output scaled: section 3.3, the rate of the output unit's weights divided by sqrt(n);
- vario-eta: section 3.2;
- Levenberg-Marquardt: :mod:`swimmer_mj.learning.td.levenberg_marquardt`.

Each method's eta (with Levenberg-Marquardt also mu, with vario-eta also epsilon: both bound the rate) is the best of a
sweep on seeds that are not reported: the setting with the highest reward, taken as a mean over all evaluations of the
sweep and over its seeds (the area under the learning curve); settings with a run that diverged are passed over. The
sweep is shorter than what is reported, and logged. A run has diverged once a weight is not finite or the mean of abs(V)
exceeds ten times what any state can be worth; it goes on, is measured like the others and is marked.

Measured besides, of section 3.4's remarks: the noise v of each weight (beta = 1/100, v(0) = 0) and its Gauss-Newton
curvature h, over the same last 100 trials. Claims: they are "formally very close"; the variance "increased during
learning, and was never close to zero".

Limits. On the swimmer the smallest epsilon and the smallest mu of the sweep, 0.01, were best, and epsilon is above
sqrt(v) of most hidden weights (0.001 to 0.004 there): smaller ones were not tried. v(0) is large against the noise, so
that vario-eta starts slowly, on the pendulum for some hundreds of trials. 12,000 trials are the beginning of learning
to swim.

Chosen: cascades of 12 neurons (pendulum) and 30 (swimmer), s_gamma and s_lambda 1 1/s, trials of 5 s, float32.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats

from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.forms import EnvironmentForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME, ControlProblem
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.run import evaluation_sample
from swimmer_mj.learning.td import levenberg_marquardt, vario_eta
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.levenberg_marquardt import LevenbergMarquardt
from swimmer_mj.learning.td.population import LANES, PopulationTD

__all__ = [
    "CURVE_HEADER",
    "LEARNING_LOG",
    "METHODS",
    "NOISE_LOG",
    "SWEEP_HEADER",
    "SWEEP_LOG",
    "TASKS",
    "WEIGHTS_LOG",
    "Candidate",
    "Row",
    "Task",
    "Team",
    "best",
    "compare",
    "grid",
    "noise_and_curvature",
    "run",
    "sweep",
]

LEARNING_LOG = "section-3.4.csv"
SWEEP_LOG = "section-3.4-sweep.csv"
NOISE_LOG = "section-3.4-noise.csv"
WEIGHTS_LOG = "section-3.4-weights.csv"

Array = NDArray[np.float64]
Method = Literal["plain", "output scaled", "vario-eta", "Levenberg-Marquardt"]
Row = tuple[str | float, ...]

METHODS: tuple[Method, ...] = ("plain", "output scaled", "vario-eta", "Levenberg-Marquardt")
RECENT = 100
"""Trials over which the curvature is taken."""
BETA = 0.01
"""Decay of the noise that is measured."""
GAMMA = LevenbergMarquardt.gamma

CURVE_HEADER = ("problem", "method", "eta", "bound", "seed", "trial", "reward", "value", "diverged")
SWEEP_HEADER = ("problem", "method", "eta", "bound", "seed", "trials", "reward", "diverged")
NOISE_HEADER = (
    "problem",
    "method",
    "seed",
    "trial",
    "noise_min",  # of v over all connections
    "noise_p05",
    "noise_p50",
    "noise_p95",
    "noise_mean",
    "curvature_p05",  # of h
    "curvature_p50",
    "curvature_p95",
    "ratio_p05",  # of v / h
    "ratio_p50",
    "ratio_p95",
    "rank_correlation",  # of v and h
    "rank_correlation_hidden",  # over connections to hidden neurons only
    "rank_correlation_gradient",  # of v and the mean of (dV/dw)^2, all connections
)
WEIGHTS_HEADER = ("problem", "output", "noise", "curvature", "squared_gradient")
SHOWN: Method = "output scaled"
"""Whose weights are logged one by one, those of the first seed at the end of learning."""


class Candidate(NamedTuple):
    """One setting of one method."""

    method: Method
    eta: float
    bound: float = 0.0
    """epsilon of vario-eta, mu of Levenberg-Marquardt."""


@dataclass(frozen=True)
class Task:
    """A problem, and how long and with what to learn it."""

    problem: ControlProblem
    neurons: int
    initial_variance: float
    """v(0) of vario-eta."""
    largest_value: float
    """What no state can be worth much more than, s or m."""
    trials: int
    sweep_trials: int
    every: int
    """Trials between evaluations."""
    noise_every: int
    """Trials between looks at noise and curvature, a multiple of ``every``."""
    sweep_every: int
    candidates: tuple[Candidate, ...]

    def starts(self) -> Array:
        """Where the episodes of an evaluation begin, shape (32, p)."""
        environment = self.problem.form(EnvironmentForm)
        if environment is not None:
            return environment.starts(32)
        return self.problem.initial_states(np.random.default_rng(100), 32)


def grid(method: Method, etas: Sequence[float], bounds: Sequence[float] = (0.0,)) -> tuple[Candidate, ...]:
    """Settings of ``method`` with each eta and each bound."""
    return tuple(Candidate(method, eta, bound) for bound in bounds for eta in etas)


TASKS = {
    "pendulum": Task(
        Pendulum(),
        neurons=12,
        initial_variance=1.0,
        largest_value=1.0,
        trials=4000,
        sweep_trials=2000,
        every=200,
        noise_every=400,
        sweep_every=200,
        candidates=(
            *grid("plain", (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)),
            *grid("output scaled", (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)),
            *grid("vario-eta", (0.001, 0.003, 0.01, 0.03, 0.1), (0.001, 0.01, 0.1)),
            *grid("Levenberg-Marquardt", (0.001, 0.003, 0.01, 0.03, 0.1, 0.3), (0.01, 0.1, 1.0)),
        ),
    ),
    "swim5": Task(
        Swimming(),
        neurons=30,
        initial_variance=100.0,
        largest_value=2.5,
        trials=12_000,
        sweep_trials=10_000,
        every=2000,
        noise_every=2000,
        sweep_every=2500,
        candidates=(
            *grid("plain", (0.003, 0.01, 0.03, 0.1, 0.3)),
            *grid("output scaled", (0.01, 0.03, 0.1, 0.3)),
            *grid("vario-eta", (0.001, 0.003, 0.01, 0.03, 0.1), (0.01, 0.1)),
            *grid("Levenberg-Marquardt", (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1), (0.01, 0.1)),
        ),
    ),
}


class Findings(NamedTuple):
    """Rows of three logs."""

    learning: list[Row]
    noise: list[Row]
    weights: list[Row]


class Team:
    """Up to 16 learners of one task side by side, each with its method and seed; v of each weight is measured.

    Parameters
    ----------
    task : Task
        What to learn.
    members : sequence of (Candidate, int)
        Setting and seed of each learner.
    """

    def __init__(self, task: Task, members: Sequence[tuple[Candidate, int]]) -> None:
        self.task = task
        self.members = list(members)
        problem = task.problem
        self.learners = [self._learner(candidate, seed) for candidate, seed in members]
        self.population = PopulationTD(self.learners)
        self.rngs = [np.random.default_rng(seed) for _, seed in members]
        network = self.learners[0].network
        self.connected = network.connected.numpy()
        self.visited = np.empty((RECENT, len(members), 2, problem.state_size))
        """States at which recent trials began and ended."""
        self.trial = 0
        shape = (len(members), *self.connected.shape)
        self.noise = np.zeros(shape)
        """v as it is measured."""
        self._eta = np.array([candidate.eta for candidate, _ in members])[:, None, None]
        self._bound = np.array([candidate.bound for candidate, _ in members])[:, None, None]
        self._fixed = np.stack([learner.rate.double().numpy() for learner in self.learners])
        self._varies = np.array([candidate.method == "vario-eta" for candidate, _ in members])
        self._bends = np.array([candidate.method == "Levenberg-Marquardt" for candidate, _ in members])
        self._variance = np.full(shape, task.initial_variance)
        self._curvature = np.full(shape, LevenbergMarquardt.initial_curvature)
        self._set_rates()

    def _learner(self, candidate: Candidate, seed: int) -> FusedTD:
        task = self.task
        generator = torch.Generator().manual_seed(seed)
        network = Cascade(task.problem.n_inputs, task.neurons, generator=generator)
        settings = TDSettings(eta=candidate.eta, output_scaling=candidate.method == "output scaled")
        return FusedTD(task.problem, network, settings, rate_each=True)

    @property
    def weights(self) -> Array:
        """Shape (learners, n, m + n)."""
        return np.stack([learner.weight.double().numpy() for learner in self.learners])

    def _set_rates(self) -> None:
        self.rate = self._fixed.copy()
        for chosen, per_weight in (
            (self._varies, vario_eta.learning_rate(self._variance, self._eta, self._bound)),
            (self._bends, levenberg_marquardt.learning_rate(self._curvature, self._eta, self._bound)),
        ):
            self.rate[chosen] = per_weight[chosen]
        self.rate[:, ~self.connected] = 0.0
        for learner, rate in zip(self.learners, self.rate, strict=True):
            learner.rate.copy_(torch.from_numpy(rate))

    def inputs(self, states: Array) -> Array:
        """The networks' inputs at ``states`` (..., p), shape (..., m)."""
        return self.task.problem.inputs(torch.from_numpy(states)).numpy()

    def train(self, trials: int) -> None:
        """``trials`` trials of each learner; rates are set anew after each."""
        problem = self.task.problem
        before = self.weights
        for _ in range(trials):
            starts = np.concatenate([problem.initial_states(rng, 1) for rng in self.rngs])
            self.population.train(starts[None])
            after = self.weights
            ends = np.stack([starts, self.population.final_states], axis=1)
            self.visited[self.trial % RECENT] = ends
            self.trial += 1
            rate = np.where(self.connected, self.rate, 1.0)
            self.noise = vario_eta.variance(self.noise, after - before, rate, BETA)
            self._variance = vario_eta.variance(self._variance, after - before, rate, BETA)
            if self._bends.any():
                bends = self._bends
                weight = after[bends][:, None]
                firing = levenberg_marquardt.fire(weight, self.inputs(ends[bends]))
                new = levenberg_marquardt.gauss_newton_diagonal(weight, firing).mean(axis=1)
                self._curvature[bends] = levenberg_marquardt.average(self._curvature[bends], new, GAMMA)
            if self._varies.any() or self._bends.any():
                self._set_rates()
            before = after

    def curvature(self, k: int) -> tuple[Array, Array]:
        """h and the mean of (dV/dw)^2 of learner ``k`` at recent states, with its weights as they are; (n, m + n)."""
        states = self.visited[: min(self.trial, RECENT), k].reshape(-1, self.visited.shape[-1])
        weight = self.learners[k].weight.double().numpy()
        firing = levenberg_marquardt.fire(weight, self.inputs(states))
        h = levenberg_marquardt.gauss_newton_diagonal(weight, firing).mean(axis=0)
        return h, levenberg_marquardt.squared_gradient(weight, firing).mean(axis=0)

    def evaluate(self) -> list[Row]:
        """A row of :data:`CURVE_HEADER` for each learner."""
        starts, sample = self.task.starts(), evaluation_sample(self.task.problem)
        rows: list[Row] = []
        for (candidate, seed), learner in zip(self.members, self.learners, strict=True):
            value = learner.sample(sample).value
            reward = learner.rollout(starts, EPISODE_DURATION, skip=SETTLING_TIME).reward.mean()
            lost = not torch.isfinite(learner.weight).all() or np.abs(value).mean() > self._bound_of_value
            name = self.task.problem.name
            numbers = (seed, self.trial, float(reward), float(value.mean()), float(lost))
            rows.append((name, *candidate, *numbers))
        return rows

    @property
    def _bound_of_value(self) -> float:
        return 10 * self.task.largest_value

    def _settings(self) -> str:
        task = self.task
        return repr((task.problem, task.neurons, task.initial_variance, self.members))

    def save(self, path: Path, found: Findings) -> None:
        """Write where the team stands, and what was found of it, to ``path``: :func:`save_checkpoint`."""
        arrays = {
            "weight": np.stack([learner.weight.numpy() for learner in self.learners]),
            "noise": self.noise,
            "variance": self._variance,
            "curvature": self._curvature,
            "visited": self.visited,
        }
        info = {
            "settings": self._settings(),
            "trial": self.trial,
            "rngs": [rng.bit_generator.state for rng in self.rngs],
            "found": found._asdict(),
        }
        save_checkpoint(path, {name: torch.from_numpy(array) for name, array in arrays.items()}, info)

    def restore(self, path: Path) -> Findings:
        """Go on where :meth:`save` was; what was found until then. ValueError if that was another team."""
        tensors, info = load_checkpoint(path)
        if info["settings"] != self._settings():
            raise ValueError(f"{path} holds runs with other settings; choose another directory with --out")
        for learner, weight in zip(self.learners, tensors["weight"], strict=True):
            learner.weight.copy_(weight)
        names = ("noise", "variance", "curvature", "visited")
        self.noise, self._variance, self._curvature, self.visited = (tensors[name].numpy() for name in names)
        self.trial = info["trial"]
        for rng, state in zip(self.rngs, info["rngs"], strict=True):
            rng.bit_generator.state = state
        self._set_rates()
        return Findings(**{name: [tuple(row) for row in rows] for name, rows in info["found"].items()})


def noise_and_curvature(noise: Array, curvature: Array, gradient: Array, connected: NDArray[np.bool_]) -> Row:
    """The columns of :data:`NOISE_HEADER` from "noise_min" on; all arguments have shape (n, m + n)."""
    v, h, g = noise[connected], curvature[connected], gradient[connected]
    if not (np.isfinite(v).all() and np.isfinite(h).all()):
        return (np.nan,) * (len(NOISE_HEADER) - 4)
    hidden = connected[:-1]
    quantiles = [0.05, 0.5, 0.95]
    positive = h > 0
    return (
        v.min(),
        *np.quantile(v, quantiles),
        v.mean(),
        *np.quantile(h, quantiles),
        *np.quantile(v[positive] / h[positive], quantiles),
        _rank_correlation(v, h),
        _rank_correlation(noise[:-1][hidden], curvature[:-1][hidden]),
        _rank_correlation(v, g),
    )


def _rank_correlation(a: Array, b: Array) -> float:
    """Spearman's."""
    return float(np.corrcoef(stats.rankdata(a), stats.rankdata(b))[0, 1])


def _method(row: Row) -> Method:
    return next(method for method in METHODS if method == row[1])


def _candidate(row: Row) -> Candidate:
    """Of a row of :data:`CURVE_HEADER` or :data:`SWEEP_HEADER`."""
    return Candidate(_method(row), float(row[2]), float(row[3]))


def best(rows: Sequence[Row]) -> dict[Method, Candidate]:
    """Each method's best setting by the ``rows`` of a sweep (:data:`SWEEP_HEADER`)."""
    scores: dict[Candidate, list[float]] = {}
    lost = set()
    for row in rows:
        candidate, reward, diverged = _candidate(row), row[6], row[7]
        scores.setdefault(candidate, []).append(float(reward))
        if diverged:
            lost.add(candidate)
    chosen: dict[Method, Candidate] = {}
    for candidate, score in scores.items():
        rival = chosen.get(candidate.method)
        if candidate in lost:
            continue
        if rival is None or np.mean(score) > np.mean(scores[rival]):
            chosen[candidate.method] = candidate
    return chosen


def _teams(members: Sequence[tuple[Candidate, int]]) -> list[Sequence[tuple[Candidate, int]]]:
    return [members[k : k + LANES] for k in range(0, len(members), LANES)]


def sweep(task: Task, seeds: Sequence[int], report: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Learn with all candidates; a row of :data:`SWEEP_HEADER` for each run."""
    rows: list[Row] = []
    for members in _teams([(candidate, seed) for candidate in task.candidates for seed in seeds]):
        team = Team(task, members)
        evaluations = []
        while team.trial < task.sweep_trials:
            team.train(task.sweep_every)
            evaluations.append(team.evaluate())
        for run in zip(*evaluations, strict=True):
            reward = float(np.mean([float(row[6]) for row in run]))
            diverged = max(float(row[8]) for row in run)
            rows.append((*run[0][:5], team.trial, reward, diverged))
        report(f"{task.problem.name}, sweep: {len(rows)} runs of {task.sweep_trials} trials")
    return rows


def compare(
    task: Task,
    candidates: Sequence[Candidate],
    seeds: Sequence[int],
    report: Callable[[str], None] = lambda line: None,
    keep: Path | None = None,
) -> Findings:
    """Learn with each of ``candidates``, one a method, on each of ``seeds``.

    With ``keep``, a directory, each pack is kept there after each evaluation, and goes on where it was.
    """
    found = Findings([], [], [])
    for k, members in enumerate(_teams([(candidate, seed) for candidate in candidates for seed in seeds])):
        team = Team(task, members)
        of_team = _learn(team, None if keep is None else keep / f"pack-{k}.safetensors", report)
        of_team.weights.extend(_weights(team, seeds[0]))
        for log, more in zip(found, of_team, strict=True):
            log.extend(more)
    order = {method: float(k) for k, method in enumerate(METHODS)}
    found.learning.sort(key=lambda row: (order[_method(row)], *map(float, row[4:6])))
    found.noise.sort(key=lambda row: (order[_method(row)], *map(float, row[2:4])))
    return found


def _learn(team: Team, place: Path | None, report: Callable[[str], None]) -> Findings:
    """All trials of ``team``, from where it was left in ``place``."""
    task = team.task
    found = Findings(team.evaluate(), [], [])
    if place is not None and place.exists():
        found = team.restore(place)
    while team.trial < task.trials:
        team.train(task.every)
        rows = team.evaluate()
        found.learning.extend(rows)
        if team.trial % task.noise_every == 0:
            for k, (candidate, seed) in enumerate(team.members):
                h, g = team.curvature(k)
                summary = noise_and_curvature(team.noise[k], h, g, team.connected)
                found.noise.append((task.problem.name, candidate.method, seed, team.trial, *summary))
        if place is not None:
            team.save(place, found)
        report(f"{task.problem.name}, {team.trial} trials: " + ", ".join(f"{row[6]:.2f}" for row in rows))
    return found


def _weights(team: Team, shown: int) -> list[Row]:
    """Rows of :data:`WEIGHTS_HEADER`, if :data:`SHOWN` with the seed ``shown`` is in ``team``."""
    rows: list[Row] = []
    for k, (candidate, seed) in enumerate(team.members):
        if (candidate.method, seed) == (SHOWN, shown):
            h, g = team.curvature(k)
            for i, j in np.argwhere(team.connected):
                numbers = i == team.task.neurons - 1, team.noise[k, i, j], h[i, j], g[i, j]
                rows.append((team.task.problem.name, *map(float, numbers)))
    return rows


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    tasks: Sequence[Task] = tuple(TASKS.values()),
    seeds: Sequence[int] = range(8),
    sweep_seeds: Sequence[int] = (100, 101, 102),
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Sweep, compare, and write the four logs in ``directory``. About half an hour on one core."""
    swept: list[Row] = []
    found = Findings([], [], [])
    for task in tasks:
        rows = sweep(task, sweep_seeds, report)
        swept += rows
        chosen = best(rows)
        report(f"{task.problem.name}: {', '.join(map(str, chosen.values()))}")
        for log, more in zip(found, compare(task, list(chosen.values()), seeds, report), strict=True):
            log.extend(more)
    _write(Path(directory), swept, found)


def _write(directory: Path, swept: Sequence[Row], found: Findings) -> None:
    write_table(directory / SWEEP_LOG, SWEEP_HEADER, swept, digits=4)
    write_table(directory / LEARNING_LOG, CURVE_HEADER, found.learning, digits=4)
    write_table(directory / NOISE_LOG, NOISE_HEADER, found.noise, digits=3)
    write_table(directory / WEIGHTS_LOG, WEIGHTS_HEADER, found.weights, digits=3)
