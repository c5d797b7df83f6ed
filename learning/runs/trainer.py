"""Training runs: a learner of either method, its log and its checkpoints in a directory of their own.

A run directory has ``config.json`` (complete: it defines the run), ``metrics.csv`` (a row an evaluation),
``checkpoint.safetensors`` (the newest weights and all that resuming needs) and ``best.safetensors`` (the weights that
swam fastest in an evaluation), the last two with JSON beside. An interrupted and resumed run computes the same numbers
as one that was never interrupted.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.dynamics import MujocoSwimmer
from swimmer_mj.files import replacing
from swimmer_mj.initial_states import InitialLaw
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.runs.evaluation import evaluation_states
from swimmer_mj.learning.runs.methods import TemporalDifferences, make_learning
from swimmer_mj.learning.networks.networks import Cascade, Multilayer, ValueNetwork
from swimmer_mj.learning.problems.pendulum.pendulum import Pendulum
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.td.population import LANES, PopulationTD
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.learning.value_gradient.equations import ValueGradientSettings
from swimmer_mj.learning.td.vario_eta import VarioEta
from swimmer_mj.parameters import PAPER, SwimmerParameters

__all__ = [
    "ETA",
    "Metrics",
    "Pack",
    "Progress",
    "Report",
    "TrainConfig",
    "TrainingRun",
    "load_policy",
    "read_config",
    "train_together",
    "value_gradient_config",
]

Array = NDArray[np.float64]

CONFIG, LOG, CHECKPOINT, BEST = "config.json", "metrics.csv", "checkpoint.safetensors", "best.safetensors"
SAMPLE_SIZE = 1000
"""States of the initial-state law over which <V>_S and <H^2>_S are taken; those of seed 1."""
PAPER_NEURONS = 60
ETA = 0.16
"""Learning rate of TD(lambda): the best of a sweep with 5 links (docs/what-decides.md); the paper's is 0.01."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that defines a run."""

    seed: int = 0
    method: Literal["td", "value-gradient"] = "td"
    """Continuous TD(lambda), the paper's, or :mod:`swimmer_mj.learning.value_gradient.equations`."""
    problem: Literal["swim", "pendulum"] = "swim"
    parameters: SwimmerParameters = PAPER
    s_gamma: float = 1.0
    td: TDSettings = field(default_factory=lambda: TDSettings(eta=ETA))
    value_gradient: ValueGradientSettings = field(default_factory=ValueGradientSettings)
    neurons: int = PAPER_NEURONS
    """Of the cascade, the output counted."""
    layers: tuple[int, ...] | None = None
    """Units of each hidden layer, instead of a cascade."""
    dtype: Literal["float32", "float64"] = "float32"
    sigmoid: Literal["tanh", "logistic"] = "tanh"
    encoding: Literal["circle", "angle"] = "circle"
    initial_law: InitialLaw = "moderate"
    engine: Literal["fused", "population", "torch"] = "fused"
    """One compiled learner, one of a pack of them, or the readable reference; equal but for rounding."""
    physics: Literal["analytic", "mujoco"] = "analytic"
    device: Literal["cpu", "cuda"] = "cpu"
    """Where torch computes, with method "value-gradient"; the others are compiled for CPUs."""
    evaluate_every: int = 2000
    """Trials between evaluations."""

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(type(self)).items():
            if get_origin(hint) is Literal and getattr(self, name) not in get_args(hint):
                choices = ", ".join(map(repr, get_args(hint)))
                raise ValueError(f"{name} must be one of {choices}; got {getattr(self, name)!r}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if self.neurons < 2:
            raise ValueError(f"neurons must be at least 2, one hidden and the output; got {self.neurons}")
        if self.evaluate_every < 1:
            raise ValueError(f"evaluate_every must be at least 1 trial, got {self.evaluate_every}")
        if self.method == "td" and self.layers is not None:
            raise ValueError(f"method 'td' learns cascades: layers must be None, got {self.layers}")
        if self.layers is not None and self.sigmoid != "tanh":
            raise ValueError(f"layers are of tanh units: sigmoid must be 'tanh', got {self.sigmoid!r}")
        if self.method == "value-gradient" and self.engine == "population":
            raise ValueError("engine 'population' is for method 'td'")
        if self.method == "value-gradient" and self.physics == "mujoco":
            raise ValueError("method 'value-gradient' needs the equations themselves: physics 'analytic'")
        if self.method == "td" and self.device != "cpu":
            raise ValueError(f"device {self.device!r} is for method 'value-gradient'; 'td' learns on the CPU")
        if self.physics == "mujoco" and self.problem != "swim":
            raise ValueError(f"physics 'mujoco' is for swimming, not for {self.problem!r}")
        if self.physics == "mujoco" and self.engine == "population":
            raise ValueError("engine 'population' learns on the compiled equations only, not through MuJoCo")
        if self.physics == "mujoco" and self.td.vario is not None and self.engine == "fused":
            raise ValueError("vario-eta through MuJoCo needs engine 'torch'")

    def common(self) -> TrainConfig:
        """What is the same for all runs that can learn as a pack: this configuration, its own things aside."""
        td = TDSettings(dt=self.td.dt, trial_duration=self.td.trial_duration)
        return dataclasses.replace(self, seed=0, td=td)

    @property
    def steps_per_trial(self) -> int:
        """Steps of td.dt in a trial; trials count simulated time, whatever the method and its step."""
        return self.td.steps_per_trial

    def make_problem(self) -> ControlProblem:
        """The control problem that is learned."""
        if self.problem == "pendulum":
            return Pendulum(s_gamma=self.s_gamma)
        dynamics = MujocoSwimmer(self.parameters) if self.physics == "mujoco" else None
        return Swimming(
            self.parameters, self.s_gamma, dynamics, encoding=self.encoding, initial_law=self.initial_law
        )

    def make_network(self, problem: ControlProblem) -> ValueNetwork:
        """The network with its initial weights, which follow from the seed."""
        generator = torch.Generator().manual_seed(self.seed)
        if self.layers is not None:
            dtype = getattr(torch, self.dtype)
            return Multilayer(problem.n_inputs, self.layers, generator=generator, dtype=dtype)
        return Cascade(
            problem.n_inputs,
            self.neurons,
            generator=generator,
            dtype=getattr(torch, self.dtype),
            sigmoid=self.sigmoid,
        )

    def to_json(self) -> dict[str, Any]:
        """The configuration as JSON values, with the version that wrote it."""
        return {"version": version("swimmer-mj"), **dataclasses.asdict(self)}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> TrainConfig:
        """The configuration that :meth:`to_json` wrote."""
        fields = {key: value for key, value in values.items() if key != "version"}
        td = dict(fields.pop("td"))
        vario = td.pop("vario")
        layers = fields.pop("layers", None)
        gradient = fields.pop("value_gradient", {})
        return cls(
            **{**fields, "parameters": SwimmerParameters(**fields["parameters"])},
            layers=None if layers is None else tuple(layers),
            value_gradient=ValueGradientSettings(**gradient),
            td=TDSettings(**td, vario=None if vario is None else VarioEta(**vario)),
        )


def value_gradient_config(seed: int = 0, s_lambda: float = 1.0) -> TrainConfig:
    """The configuration that was found to learn fastest with method ``"value-gradient"``; docs/beyond.md."""
    return TrainConfig(
        seed=seed,
        method="value-gradient",
        s_gamma=0.5,
        value_gradient=ValueGradientSettings(s_lambda=s_lambda),
        layers=(64, 64),
        evaluate_every=1000,
    )


class Metrics(NamedTuple):
    """A row of metrics.csv (docs/metrics.md)."""

    trial: int
    """Trials so far."""
    seconds: float
    """Wall-clock time of the run so far, evaluations included."""
    mean_value: float
    """<V>_S: mean of V over a fixed sample of the initial-state law."""
    mean_squared_hamiltonian: float
    """<H^2>_S over the same sample."""
    speed: float
    """Swimming speed, m/s, by the compiled model in place of MuJoCo; the mean reward of other problems."""


class Progress(NamedTuple):
    """What a run reports while it learns."""

    trial: int
    trials_per_second: float
    """Over the last stretch of learning."""
    trial_value: float
    """Mean V along the last trials."""
    trial_squared_hamiltonian: float
    """Mean H^2 along the last trials."""


def evaluation_sample(problem: ControlProblem) -> Array:
    """The states over which <V>_S and <H^2>_S are taken, shape (1000, p)."""
    return problem.initial_states(np.random.default_rng(1), SAMPLE_SIZE)


class TrainingRun:
    """One learner with one seed, and its directory.

    Parameters
    ----------
    directory : path
        Where to keep the run. Must not hold another one, unless ``resume``.
    config : TrainConfig, optional
        What to run. When resuming, the configuration is that of the directory.
    resume : bool
        Go on with the run that is there.
    """

    def __init__(
        self, directory: str | os.PathLike[str], config: TrainConfig | None = None, *, resume: bool = False
    ) -> None:
        self.directory = Path(directory)
        exists = (self.directory / CONFIG).exists()
        if resume and not exists:
            raise FileNotFoundError(f"there is no run to resume in {self.directory}")
        if exists and not resume:
            raise FileExistsError(
                f"{self.directory} already holds a run; resume it, or choose another directory"
            )
        if resume:
            config = read_config(self.directory)
        elif config is None:
            config = TrainConfig()
        if config.device == "cuda" and not torch.cuda.is_available():
            raise ValueError("device 'cuda': torch finds no CUDA device here; learn with device 'cpu'")
        self.config = config
        self._set_up(saved=resume and (self.directory / CHECKPOINT).exists())
        if not exists:
            with replacing(self.directory / CONFIG) as partial:
                partial.write_text(json.dumps(config.to_json(), indent=2) + "\n")

    def _set_up(self, saved: bool) -> None:
        """The learner, from the checkpoint if there is one that was ``saved``, else as it begins."""
        config = self.config
        self.problem = config.make_problem()
        self.network = config.make_network(self.problem).to(config.device)
        self.learning = make_learning(config, self.problem, self.network)
        self.rng = np.random.default_rng(config.seed)
        self.trial = 0
        self.seconds = 0.0
        self.best_speed = -np.inf
        self.history: list[Metrics] = []
        if saved:
            self._restore()

    def forget_unsaved(self) -> None:
        """Stand where the run was last saved, or where it began; network, learner and generator are new objects."""
        self._set_up(saved=bool(self.history))

    # One evaluation period at a time -----------------------------------------------------------------------------

    def advance(
        self,
        report: Callable[[Report], None] = lambda report: None,
        stretch: int = 100,
        stop: Callable[[], bool] = lambda: False,
    ) -> Metrics | None:
        """:meth:`Pack.advance` of this run alone; its metrics."""
        metrics = Pack([self]).advance(report, stretch, stop)
        return None if metrics is None else metrics[0]

    def evaluate(self, seconds: float) -> Metrics:
        """<V>_S, <H^2>_S and the speed of the weights as they are."""
        values, hamiltonians = self.learning.judge(evaluation_sample(self.problem))
        if isinstance(self.problem, Swimming):
            states = evaluation_states(self.problem.parameters.n_links)
        else:
            states = self.problem.initial_states(np.random.default_rng(0), 64)
        return Metrics(
            self.trial,
            seconds,
            float(values.mean()),
            float((hamiltonians**2).mean()),
            float(self.learning.rewards(states).mean()),
        )

    # On disk -----------------------------------------------------------------------------------------------------

    def save(self, metrics: Metrics) -> None:
        """Write the run as it stands after the evaluation ``metrics``."""
        self.seconds = metrics.seconds
        self.history.append(metrics)
        info = {
            "config": self.config.to_json(),
            **metrics._asdict(),
            "best_speed": max(self.best_speed, metrics.speed),
            "history": [list(row) for row in self.history],
            "rng": self.rng.bit_generator.state,
            **self.learning.info(),
        }
        if metrics.speed > self.best_speed:
            self.best_speed = metrics.speed
            best = {"config": self.config.to_json(), **metrics._asdict()}
            save_checkpoint(self.directory / BEST, self.learning.result().state_dict(), best)
        save_checkpoint(self.directory / CHECKPOINT, self.learning.tensors(), info)
        with replacing(self.directory / LOG) as partial, partial.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(Metrics._fields)
            writer.writerows(self.history)

    def _restore(self) -> None:
        tensors, info = load_checkpoint(self.directory / CHECKPOINT)
        self.learning.restore(tensors, info)
        self.trial, self.seconds, self.best_speed = info["trial"], info["seconds"], info["best_speed"]
        self.history = [Metrics(*row) for row in info["history"]]
        self.rng.bit_generator.state = info["rng"]


class Report(NamedTuple):
    """News of one of several runs."""

    run: TrainingRun
    progress: Progress | None
    """After a stretch of learning."""
    metrics: Metrics | None
    """After an evaluation."""


class Pack:
    """Runs that learn in step: a single one, or up to 16 whose engine is ``"population"``.

    The runs of a pack may differ in seed, rates and s_lambda. What each computes does not depend on the others. A run
    that diverges leaves the pack, as it was last saved; the others go on.
    """

    def __init__(self, runs: Sequence[TrainingRun]) -> None:
        self.runs = list(runs)
        if runs[0].config.engine != "population" and len(runs) > 1:
            raise ValueError(f"engine {runs[0].config.engine!r} learns one run at a time, got {len(runs)}")
        self._diverged: list[str] = []
        self._join()

    def _join(self) -> None:
        """Have the learners of the runs that are left learn in step."""
        learning = [run.learning for run in self.runs]
        fused = [one.fused for one in learning if isinstance(one, TemporalDifferences)]
        together = bool(fused) and self.runs[0].config.engine == "population"
        self.population = PopulationTD(fused) if together else None

    @staticmethod
    def of(runs: Sequence[TrainingRun], workers: int) -> list[Pack]:
        """Packs of ``runs`` that can learn in step, all of about one size: as few as keep all ``workers`` busy."""
        alike: dict[Any, list[TrainingRun]] = {}
        for run in runs:
            key = id(run) if run.config.engine != "population" else run.config.common()
            alike.setdefault(key, []).append(run)
        groups = list(alike.values())
        counts = [-(-len(group) // LANES) for group in groups]
        while sum(counts) < min(workers, len(runs)):
            largest = max(range(len(groups)), key=lambda k: len(groups[k]) / counts[k])
            counts[largest] += 1
        return [
            Pack(group[i * len(group) // count : (i + 1) * len(group) // count])
            for group, count in zip(groups, counts, strict=True)
            for i in range(count)
        ]

    def advance(
        self,
        report: Callable[[Report], None] = lambda report: None,
        stretch: int = 100,
        stop: Callable[[], bool] = lambda: False,
    ) -> list[Metrics] | None:
        """Learn for ``evaluate_every`` trials, evaluate, and save.

        Parameters
        ----------
        report : callable
            Called with each run's news after each ``stretch`` of trials and after the evaluation.
        stretch : int
            Trials between calls; the result does not depend on it.
        stop : callable
            Asked after each stretch. When it says True, the period is left unfinished and forgotten: the runs stand
            where they last were saved, or at their beginning, and None is returned.

        Raises
        ------
        FloatingPointError
            When the period is over for the others: it names the runs that have diverged and left the pack.
        """
        started = time.perf_counter()
        left = self.runs[0].config.evaluate_every
        while left and self.runs:
            count = min(stretch, left)
            before = time.perf_counter()
            means = self._learn(count)
            left -= count
            rate = count / (time.perf_counter() - before)
            for run, (value, squared_hamiltonian) in means.items():
                report(Report(run, Progress(run.trial, rate, float(value), float(squared_hamiltonian)), None))
            if left and stop():
                for run in self.runs:
                    run.forget_unsaved()
                self._join()
                self._say_what_diverged()
                return None
        rows = []
        for run in self.runs:
            metrics = run.evaluate(run.seconds + time.perf_counter() - started)
            run.save(metrics)
            report(Report(run, None, metrics))
            rows.append(metrics)
        self._say_what_diverged()
        return rows

    def _learn(self, count: int) -> dict[TrainingRun, tuple[float, float]]:
        """``count`` trials of each run: mean V and mean H^2 along them, of those that have not diverged."""
        if self.population is None:
            (run,) = self.runs
            try:
                means = [run.learning.learn(count, run.trial, run.rng)]
            except FloatingPointError as error:  # value gradients see it first in their loss
                self._drop(run, str(error))
                return {}
        else:
            states = [run.problem.initial_states(run.rng, count) for run in self.runs]
            trials = self.population.train(np.stack(states, axis=1))
            means = zip(trials.value.mean(axis=0), trials.squared_hamiltonian.mean(axis=0), strict=True)
        of_run = dict(zip(self.runs, means, strict=True))
        for run in of_run:
            run.trial += count
            if not all(torch.isfinite(weight).all() for weight in run.network.parameters()):
                too_large = f"{run.learning.step_size} is too large"
                self._drop(run, f"weights are no longer finite after {run.trial} trials: {too_large}")
        return {run: mean for run, mean in of_run.items() if run in self.runs}

    def _drop(self, run: TrainingRun, why: str) -> None:
        """Leave ``run`` as it was last saved, and go on without it."""
        self._diverged.append(f"{run.directory}: {why}")
        run.forget_unsaved()
        self.runs.remove(run)
        self._join()

    def _say_what_diverged(self) -> None:
        news, self._diverged = self._diverged, []
        if news:
            raise FloatingPointError("; ".join(news))


def train_together(
    runs: Sequence[TrainingRun],
    *,
    trials: int | None = None,
    seconds: float | None = None,
    enough: Callable[[TrainingRun], bool] = lambda run: False,
    report: Callable[[Report], None] = lambda report: None,
    workers: int | None = None,
) -> None:
    """Advance several runs side by side, each in a thread (the compiled learner holds no lock).

    Parameters
    ----------
    runs : sequence of TrainingRun
        What to advance.
    trials : int, optional
        Each run stops at the first evaluation with at least this many trials.
    seconds : float, optional
        Wall-clock time after which all runs stop. What a run learned since its last evaluation is dropped, in memory
        as on disk, so that it stays reproducible.
    enough : callable
        As soon as it is true of one run after an evaluation, all runs stop.
    report : callable
        Called with news, from the threads of the runs.
    workers : int, optional
        Runs at a time; as many as there are cores by default.

    Raises
    ------
    FloatingPointError
        When all others are done: it names the runs that have diverged, which stand where they last were saved.
    """
    deadline = np.inf if seconds is None else time.monotonic() + seconds
    finished = threading.Event()
    diverged: list[str] = []

    def over() -> bool:
        return finished.is_set() or time.monotonic() > deadline

    def work(pack: Pack) -> None:
        try:
            while pack.runs and not over():
                unfinished = [run for run in pack.runs if trials is None or run.trial < trials]
                if not unfinished:
                    return
                if len(unfinished) < len(pack.runs):
                    pack = Pack(unfinished)
                try:
                    if pack.advance(report, stop=over) is None:
                        return
                except FloatingPointError as error:
                    diverged.append(str(error))
                if any(enough(run) for run in pack.runs):
                    finished.set()
        except BaseException:
            finished.set()
            raise

    workers = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(work, pack) for pack in Pack.of(runs, workers)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            finished.set()
            raise
    if diverged:
        raise FloatingPointError("; ".join(diverged))


def read_config(directory: str | os.PathLike[str]) -> TrainConfig:
    """The configuration of the run in ``directory``."""
    path = Path(directory) / CONFIG
    if not path.is_file():
        raise FileNotFoundError(f"{os.fspath(directory)} is not a run directory: it has no {CONFIG}")
    try:
        return TrainConfig.from_json(json.loads(path.read_text()))
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not the configuration of a run: {error}") from error


def load_policy(
    directory: str | os.PathLike[str], which: Literal["best", "last"] = "best"
) -> tuple[GreedyPolicy[ValueNetwork], TrainConfig, dict[str, Any]]:
    """The greedy policy that a run has learned, its configuration, and what is known of the checkpoint."""
    config = read_config(directory)
    tensors, info = load_checkpoint(Path(directory) / (BEST if which == "best" else CHECKPOINT))
    problem = dataclasses.replace(config, physics="analytic").make_problem()
    network = config.make_network(problem)
    network.load_state_dict({name: tensors[name] for name in network.state_dict()})
    return GreedyPolicy(problem, network), config, info
