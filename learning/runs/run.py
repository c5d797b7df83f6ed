"""A training run: one learner with one seed, its log and its checkpoints in a directory of their own.

A run directory has ``config.json`` (complete: it defines the run), ``metrics.csv`` (a row an evaluation),
``checkpoint.safetensors`` (the weights at the last evaluation and all that resuming needs) and ``best.safetensors``
(what acted best in an evaluation), the last two with JSON beside. What was learned since the last evaluation stands in
``unfinished.safetensors``, if anything was. An interrupted and resumed run computes the same numbers as one that was
never interrupted.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.files import replacing
from swimmer_mj.learning.method import Reseeded
from swimmer_mj.learning.problems.forms import EnvironmentForm, Policy, episode_of
from swimmer_mj.learning.problems.problem import N_EPISODES, ControlProblem
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint
from swimmer_mj.learning.runs.config import CONFIG, RunConfig, read_config
from swimmer_mj.learning.runs.lock import RunInUseError, locked

__all__ = [
    "BEST",
    "CHECKPOINT",
    "LOG",
    "UNFINISHED",
    "Metrics",
    "TrainingRun",
    "evaluation_sample",
    "evaluation_starts",
    "load_policy",
]

Array = NDArray[np.float64]

LOG, CHECKPOINT, BEST = "metrics.csv", "checkpoint.safetensors", "best.safetensors"
UNFINISHED = "unfinished.safetensors"
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
        with contextlib.nullcontext() if not exists else locked(self.directory):
            self._set_up(saved=resume)
        if not exists:
            self._create()

    def _set_up(self, saved: bool) -> None:
        """The learner, from the newest checkpoint if there is one that was ``saved``, else as it begins."""
        self.learning = self.config.method.start(self.problem, self.config.seed)
        self.trial = 0
        self.seconds = 0.0
        self.best_speed = -np.inf
        self.restores = 0
        self.history: list[Metrics] = []
        if saved:
            self._restore(CHECKPOINT)
            self._restore(UNFINISHED)
        self._saved_trial, self.saved_at = self.trial, time.monotonic()
        self._on_disk = self._state_on_disk()

    def _create(self) -> None:
        """The directory with its config.json, unless another process is faster."""
        with locked(self.directory):
            if (self.directory / CONFIG).exists():
                raise FileExistsError(f"{self.directory} already holds a run; choose another directory")
            text = json.dumps(self.config.to_json(), indent=2)
            with replacing(self.directory / CONFIG) as partial:
                partial.write_text(text + "\n")

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from learning in the directory during a block.

        Raises
        ------
        RunInUseError
            When another one holds it, or has changed it since this object was made of it.
        """
        with locked(self.directory):
            if self._state_on_disk() != self._on_disk:
                raise RunInUseError(
                    f"{self.directory} was changed by another process since it was read; resume it again"
                )
            self._tidy()
            yield

    def _tidy(self) -> None:
        """Finish what a process that was killed has begun to write; the directory must be held."""
        for path in self.directory.glob(".*.partial*"):
            path.unlink(missing_ok=True)
        if self.trial == self.evaluated_trial:
            self._remove_unfinished()
        log = self.directory / LOG
        if self.history and not (log.exists() and log.read_bytes() == self._log().encode()):
            self._write_log()

    def _remove_unfinished(self) -> None:
        for name in (UNFINISHED, Path(UNFINISHED).with_suffix(".json")):
            (self.directory / name).unlink(missing_ok=True)
        self._on_disk = self._state_on_disk()

    def _state_on_disk(self) -> list[tuple[int, int] | None]:
        """What changes whenever the run is saved."""
        found: list[tuple[int, int] | None] = []
        for name in (CHECKPOINT, UNFINISHED):
            try:
                status = (self.directory / name).stat()
                found.append((status.st_mtime_ns, status.st_size))
            except FileNotFoundError:
                found.append(None)
        return found

    @property
    def left(self) -> int:
        """Trials until the next evaluation: each whole multiple of ``evaluate_every`` has one."""
        every = self.config.evaluate_every
        return every * (self.evaluated_trial // every + 1) - self.trial

    @property
    def evaluated_trial(self) -> int:
        """Trials at the last evaluation."""
        return self.history[-1].trial if self.history else 0

    def forget_unfinished(self) -> None:
        """Stand where the run was last evaluated, or where it began; the learner is a new object."""
        self._remove_unfinished()
        self._set_up(saved=bool(self.history))

    def restart(self) -> None:
        """After a divergence: from the last evaluation again, or from the beginning, with other random numbers.

        Which ones depends on the seed and on how many times this was done, so that the run stays reproducible.
        """
        restores, seconds = self.restores + 1, self.seconds
        self.forget_unfinished()
        if not isinstance(self.learning, Reseeded):
            raise TypeError(
                f"{type(self.learning).__name__} has no reseed(), which going on after a divergence needs"
            )
        self.restores, self.seconds = restores, seconds
        self.learning.reseed(int(np.random.SeedSequence([self.config.seed, restores]).generate_state(1)[0]))

    def evaluate(self, seconds: float) -> Metrics:
        """<V>_S, <H^2>_S and the speed of the weights as they are."""
        values, hamiltonians = self.learning.judge(evaluation_sample(self.problem))
        starts, episode = evaluation_starts(self.problem), episode_of(self.problem)
        return Metrics(
            self.trial,
            seconds,
            float(values.mean()),
            float((hamiltonians**2).mean()),
            float(self.learning.rewards(starts, episode.duration, episode.skip).mean()),
        )

    # On disk -----------------------------------------------------------------------------------------------------

    def save(self, metrics: Metrics) -> None:
        """Write the run as it stands after the evaluation ``metrics``."""
        self.seconds = metrics.seconds
        self.history.append(metrics)
        if metrics.speed > self.best_speed:
            self.best_speed = metrics.speed
            best = {"config": self.config.to_json(), **metrics._asdict()}
            save_checkpoint(self.directory / BEST, self.learning.result(), best)
        self._save(CHECKPOINT, metrics._asdict())
        self._remove_unfinished()
        self._write_log()

    def save_unfinished(self) -> None:
        """Write the run as it stands between two evaluations."""
        if self.trial > self._saved_trial:
            self._save(UNFINISHED, {"trial": self.trial, "seconds": self.seconds})

    def _save(self, name: str, facts: dict[str, Any]) -> None:
        info = {
            **self.learning.info(),
            "config": self.config.to_json(),
            **facts,
            "best_speed": self.best_speed if math.isfinite(self.best_speed) else None,
            "restores": self.restores,
            "history": [list(row) for row in self.history],
        }
        save_checkpoint(self.directory / name, self.learning.tensors(), info)
        self._saved_trial, self.saved_at = self.trial, time.monotonic()
        self._on_disk = self._state_on_disk()

    def _log(self) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(Metrics._fields)
        writer.writerows(self.history)
        return text.getvalue()

    def _write_log(self) -> None:
        with replacing(self.directory / LOG) as partial:
            partial.write_text(self._log(), newline="")

    def _restore(self, name: str) -> None:
        """Stand where the checkpoint ``name`` was written, if there is one and it is newer than what is known."""
        if not (self.directory / name).exists():
            return
        tensors, info = load_checkpoint(self.directory / name)
        with refused_if_of_another(self.directory / name, self.config, info):
            if info["trial"] <= self.trial:
                return
            self.learning.restore(tensors, info)
            self.trial, self.seconds = info["trial"], info["seconds"]
            self.best_speed = -np.inf if info["best_speed"] is None else info["best_speed"]
            self.restores = info.get("restores", 0)
            self.history = [Metrics(*row) for row in info["history"]]


@contextlib.contextmanager
def refused_if_of_another(path: Path, config: RunConfig, info: dict[str, Any]) -> Iterator[None]:
    """ValueError if the checkpoint that said ``info`` is not of ``config``, or if it does not fit, in a block."""
    try:
        if RunConfig.from_json(info["config"]) != config:
            raise ValueError(f"it is of another run than the {CONFIG} beside it")
        yield
    except KeyError as error:
        raise ValueError(f"{path} is not a checkpoint of this run: it lacks {error}") from error
    except (ValueError, TypeError, AttributeError, RuntimeError, IndexError, OverflowError) as error:
        why = " ".join(str(error).split())[:200]
        raise ValueError(f"{path} is not a checkpoint of this run: {why}") from error


def load_policy(
    directory: str | os.PathLike[str], which: Literal["best", "last"] = "best"
) -> tuple[Policy, RunConfig, dict[str, Any]]:
    """The policy that a run has learned, its configuration, and what is known of the checkpoint.

    "best" is what acted best in an evaluation, "last" the last that was evaluated.
    """
    if which not in ("best", "last"):
        raise ValueError(f"which must be 'best' or 'last', got {which!r}")
    config = read_config(directory)
    path = Path(directory) / (BEST if which == "best" else CHECKPOINT)
    if not path.exists() and (Path(directory) / UNFINISHED).exists():
        raise FileNotFoundError(
            f"{path} is not there: the run was not evaluated yet; go on with it to its evaluation"
        )
    if not path.exists() and (Path(directory) / CHECKPOINT).exists():
        raise FileNotFoundError(
            f"{path} is not there: no evaluation gave a number, or it was removed; take the last weights "
            f"(--which last), or go on with the run"
        )
    tensors, info = load_checkpoint(path)
    with refused_if_of_another(path, config, info):
        return config.method.policy(config.problem, tensors), config, info
