"""A training run: one learner with one seed, its log and its checkpoints in a directory of their own.

A run directory has ``config.json`` (complete: it defines the run), ``metrics.csv`` (a row an evaluation),
``checkpoint.safetensors`` (the newest weights and all that resuming needs) and ``best.safetensors`` (what acted best in
an evaluation), the last two with JSON beside. An interrupted and resumed run computes the same numbers as one that was
never interrupted.
"""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.files import replacing
from swimmer_mj.learning.problems.forms import EnvironmentForm, Policy
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, N_EPISODES, SETTLING_TIME, ControlProblem
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.config import CONFIG, RunConfig, read_config

__all__ = [
    "BEST",
    "CHECKPOINT",
    "LOG",
    "Metrics",
    "TrainingRun",
    "evaluation_sample",
    "evaluation_starts",
    "load_policy",
]

Array = NDArray[np.float64]

LOG, CHECKPOINT, BEST = "metrics.csv", "checkpoint.safetensors", "best.safetensors"
SAMPLE_SIZE = 1000
"""States of the initial-state law over which <V>_S and <H^2>_S are taken; those of seed 1."""


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


def evaluation_sample(problem: ControlProblem) -> Array:
    """The states over which <V>_S and <H^2>_S are taken, shape (1000, p)."""
    return problem.initial_states(np.random.default_rng(1), SAMPLE_SIZE)


def evaluation_starts(problem: ControlProblem) -> Array:
    """Where the episodes of an evaluation start, shape (64, p)."""
    environment = problem.form(EnvironmentForm)
    if environment is None:
        return problem.initial_states(np.random.default_rng(0), N_EPISODES)
    return environment.starts(N_EPISODES)


class TrainingRun:
    """One learner with one seed, and its directory.

    Parameters
    ----------
    directory : path
        Where to keep the run. Must not hold another one, unless ``resume``.
    config : RunConfig, optional
        What to run. When resuming, the configuration is that of the directory.
    resume : bool
        Go on with the run that is there.
    """

    def __init__(
        self, directory: str | os.PathLike[str], config: RunConfig | None = None, *, resume: bool = False
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
            config = RunConfig()
        self.config = config
        self.problem = config.problem
        self._set_up(saved=resume and (self.directory / CHECKPOINT).exists())
        if not exists:
            text = json.dumps(config.to_json(), indent=2)
            with replacing(self.directory / CONFIG) as partial:
                partial.write_text(text + "\n")

    def _set_up(self, saved: bool) -> None:
        """The learner, from the checkpoint if there is one that was ``saved``, else as it begins."""
        self.learning = self.config.method.start(self.problem, self.config.seed)
        self.trial = 0
        self.seconds = 0.0
        self.best_speed = -np.inf
        self.history: list[Metrics] = []
        if saved:
            self._restore()

    def forget_unsaved(self) -> None:
        """Stand where the run was last saved, or where it began; the learner is a new object."""
        self._set_up(saved=bool(self.history))

    def evaluate(self, seconds: float) -> Metrics:
        """<V>_S, <H^2>_S and the speed of the weights as they are."""
        values, hamiltonians = self.learning.judge(evaluation_sample(self.problem))
        starts = evaluation_starts(self.problem)
        return Metrics(
            self.trial,
            seconds,
            float(values.mean()),
            float((hamiltonians**2).mean()),
            float(self.learning.rewards(starts, EPISODE_DURATION, SETTLING_TIME).mean()),
        )

    # On disk -----------------------------------------------------------------------------------------------------

    def save(self, metrics: Metrics) -> None:
        """Write the run as it stands after the evaluation ``metrics``."""
        self.seconds = metrics.seconds
        self.history.append(metrics)
        info = {
            **self.learning.info(),
            "config": self.config.to_json(),
            **metrics._asdict(),
            "best_speed": max(self.best_speed, metrics.speed),
            "history": [list(row) for row in self.history],
        }
        if metrics.speed > self.best_speed:
            self.best_speed = metrics.speed
            best = {"config": self.config.to_json(), **metrics._asdict()}
            save_checkpoint(self.directory / BEST, self.learning.result(), best)
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


def load_policy(
    directory: str | os.PathLike[str], which: Literal["best", "last"] = "best"
) -> tuple[Policy, RunConfig, dict[str, Any]]:
    """The policy that a run has learned, its configuration, and what is known of the checkpoint."""
    config = read_config(directory)
    tensors, info = load_checkpoint(Path(directory) / (BEST if which == "best" else CHECKPOINT))
    return config.method.policy(config.problem, tensors), config, info
