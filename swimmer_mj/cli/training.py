"""``train``: runs of one or several seeds, side by side."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import json as json_module
import math
import re
import shlex
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from swimmer_mj.cli.options import check_directory, check_seed, trust_modules
from swimmer_mj.cli.output import live_display, make_console, print_json, print_line
from swimmer_mj.cli.progress import QUIET, LearningDisplay
from swimmer_mj.cli.runs import run_directories
from swimmer_mj.cli.signals import StoppedError, asked_to_stop

if TYPE_CHECKING:
    from rich.console import Console

    from swimmer_mj.learning.problems.problem import ControlProblem
    from swimmer_mj.learning.runs.config import RunConfig
    from swimmer_mj.learning.runs.run import TrainingRun
    from swimmer_mj.learning.runs.together import Report

__all__ = [
    "OPTIONS",
    "changed",
    "configured",
    "own_modules",
    "parse_seeds",
    "train",
    "train_runs",
    "without_warnings",
]

OPTIONS = (
    "links", "reward", "control_timestep", "physics", "coordinates", "held", "engine", "neurons", "eta", "s_gamma",
    "s_lambda", "vario_eta", "dtype", "device",
)  # fmt: skip
"""Those of the options of :func:`train` that belong to a problem or a method."""


@contextlib.contextmanager
def without_warnings() -> Iterator[None]:
    """In a block or a function: no learner warns of what the command prints itself."""
    from swimmer_mj.learning.problems.caution import CautionWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CautionWarning)
        yield


@without_warnings()
def train(
    out: Path,
    method: str = "td",
    seed: int = 0,
    seeds: str | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    links: int | None = None,
    resume: bool = False,
    problem: str = "swim",
    reward: str | None = None,
    control_timestep: float | None = None,
    physics: Literal["analytic", "mujoco"] | None = None,
    coordinates: Literal["links", "joints"] | None = None,
    held: bool = False,
    engine: Literal["fused", "population", "stepped", "compiled", "torch"] | None = None,
    neurons: int | None = None,
    eta: float | None = None,
    s_gamma: float | None = None,
    s_lambda: float | None = None,
    vario_eta: bool = False,
    dtype: Literal["float32", "float64"] | None = None,
    device: Literal["cpu", "cuda"] | None = None,
    evaluate_every: int | None = None,
    on_divergence: Literal["stop", "restore"] = "stop",
    halve: bool = False,
    trust: tuple[str, ...] = (),
    settings: Annotated[tuple[str, ...], tyro.conf.arg(name="set")] = (),
    tensorboard: bool = False,
    json: bool = False,
) -> None:
    """Train one learner, or one for each of several seeds, and keep the run in a directory.

    Args:
        out: Run directory. Several seeds have out/seed-0 and so on.
        method: td is the paper's continuous TD(lambda); value-gradient learns dV/dx as well, and is much faster. One's
            own is module:Method (docs/extending.md).
        seed: Seed of initial weights and initial states.
        seeds: Several seeds instead, trained side by side: 0-7, or 1,4,9.
        trials: Stop at the first evaluation with at least this many trials.
        seconds: Stop after this many seconds, which more seeds than cores share, and evaluate what never was. Without
            this and --trials: after 100,000 trials.
        links: Number of links of the swimmer; 5 by default, as in the paper.
        resume: Go on with the run that is in the directory, as it was configured.
        problem: What to learn: swim, pendulum, cart-pole; dm_control/DOMAIN/TASK or gymnasium/ID, on MuJoCo; a model
            of one's own, FILE.xml, with --reward (docs/any-model.md). Another problem is module:Problem
            (docs/extending.md).
        reward: Of a MuJoCo model: module:function, a torch function of named things.
        control_timestep: Of FILE.xml: for how long a control is held, s; a whole number of the model's own time steps,
            one by default. The learner's step dt is as long, unless --set dt=.. says otherwise.
        physics: Step the equations themselves (the default), or the dm_control environment on MuJoCo (slower).
        coordinates: Of the swimmer, in which V is learned: absolute angles and the centre's velocity (the default), or
            angles between links and the head's velocity, which with --held swims faster (docs/beyond.md).
        held: Choose the swimmer's torques for the 10 ms for which they are held, not for the instant.
        engine: Of td: one compiled learner at a time (fused), up to 16 of them in the lanes of a processor's vectors
            (population), one whose problem only Python can step (stepped), or the readable reference (torch, slow).
            Of value-gradient: compiled or torch. The fastest that can be had is the default; for td, population with
            more than 4 seeds.
        neurons: Neurons of the cascade, the output counted; 60 by default for td, as in the paper. Without it,
            value-gradient has two layers of 64.
        eta: Learning rate of td; 0.16 by default, 0.0003 with --vario-eta (paper: 0.01, which is slower).
        s_gamma: Shortness factor, 1/s; 1 by default for td, 0.5 for value-gradient.
        s_lambda: Decay of eligibility besides s_gamma, 1/s; 1 by default.
        vario_eta: Adapt the rate of each weight by vario-eta, instead of scaling the output unit's.
        dtype: Floating-point type of the network; float32 by default.
        device: Where value-gradient computes; td learns on the CPU.
        evaluate_every: Trials, of 5 s of simulated time, between evaluations; 2,000 by default for td, else 1,000.
        on_divergence: A run that diverges stops, or goes on from its last evaluation with other random numbers, at
            most 10 times.
        halve: Of several --seeds, within --seconds: those with the slower best stop, half of them after each of equal
            parts of the time, so that one is left in the last.
        trust: Modules of one's own that may run when a run that names them is resumed.
        settings: Any other settings of the problem, the method or its learner, as name=value: --set mass=2 flips=0.1.
        tensorboard: Also write the rows of metrics.csv as events for TensorBoard, in the directory tensorboard of each
            run; needs the extra of that name.
        json: Print one JSON object.
    """
    typed = _typed(locals())
    check_seed(seed)
    if seeds is not None and seed != 0:
        raise ValueError(f"give --seed or --seeds, not both (got {seed} and {seeds})")
    for name, value in (("--trials", trials), ("--seconds", seconds)):
        if value is not None and not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive and finite, got {value}")
    chosen = [seed] if seeds is None else parse_seeds(seeds)
    if halve and (len(chosen) < 2 or seconds is None or trials is not None):
        raise ValueError("--halve needs several --seeds, and --seconds without --trials")
    if resume and (
        superfluous := typed
        - {
            "--out",
            "--resume",
            "--trials",
            "--seconds",
            "--on-divergence",
            "--trust",
            "--tensorboard",
            "--json",
        }
    ):
        raise ValueError(
            f"--resume goes on with the run's own configuration: leave out {', '.join(sorted(superfluous))}"
        )

    from swimmer_mj.learning.problems.caution import caution_of
    from swimmer_mj.learning.runs.config import CONFIG
    from swimmer_mj.learning.runs.events import require_writer
    from swimmer_mj.learning.runs.halving import train_halving
    from swimmer_mj.learning.runs.run import TrainingRun

    trust_modules(trust)
    if tensorboard:
        require_writer()
    if resume:
        runs = [TrainingRun(directory, resume=True) for directory in run_directories(out)]
    else:
        options: dict[str, Any] = {
            "links": links,
            "reward": reward,
            "control_timestep": control_timestep,
            "physics": physics,
            "coordinates": coordinates,
            "held": held or None,
            "engine": engine,
            "neurons": neurons,
            "eta": eta,
            "s_gamma": s_gamma,
            "s_lambda": s_lambda,
            "vario_eta": vario_eta or None,
            "dtype": dtype,
            "device": device,
        }
        given = {name: value for name, value in options.items() if value is not None}
        config = configured(problem, method, given, len(chosen))
        config = changed(config, settings)
        if evaluate_every is not None:
            config = dataclasses.replace(config, evaluate_every=evaluate_every)
        check_directory(out)
        directories = [out] if seeds is None else [out / f"seed-{s}" for s in chosen]
        for directory in directories:  # all of them before the first is written to
            if directory.exists() and not directory.is_dir():
                raise NotADirectoryError(f"{directory} is a file; choose another directory with --out")
            if (directory / CONFIG).exists():
                raise FileExistsError(
                    f"{directory} already holds a run; resume it, or choose another directory with --out"
                )
        runs = [
            TrainingRun(directory, dataclasses.replace(config, seed=s))
            for directory, s in zip(directories, chosen, strict=True)
        ]
    if trials is None and seconds is None:
        trials = 100_000
    console = make_console(json)
    if not resume:
        for line in (caution_of(runs[0].problem), _hint(runs[0].problem, method)):
            if line is not None:
                print_line(console, line)
    advance = partial(train_runs, console, on_divergence=on_divergence, tensorboard=tensorboard)
    fastest: dict[str, str] = {}
    if halve and seconds is not None:

        def stage(going: Sequence[TrainingRun], share: float) -> None:
            if len(going) < len(runs):
                print_line(console, f"these go on: {', '.join(run.directory.name for run in going)}")
            advance(going, seconds=share, announce=len(going) == len(runs))

        left = train_halving(runs, seconds, stage)
        fastest["fastest"] = str(left.directory)
        print_line(console, f"the fastest in the end: {left.directory}")
    else:
        advance(runs, trials=trials, seconds=seconds)
    results = [
        {
            "run": str(r.directory),
            "seed": r.config.seed,
            "trials": r.trial,
            "best_speed": r.best_speed if math.isfinite(r.best_speed) else None,
        }
        for r in runs
    ]
    if json:
        print_json({"runs": results, **fastest})


def _hint(problem: ControlProblem, method: str) -> str | None:
    """A line, if td has to step ``problem`` from Python, and value gradients are compiled."""
    from swimmer_mj.learning.problems.forms import BatchForm, TrialsForm
    from swimmer_mj.learning.td.fused import obstacle

    if method != "td" or obstacle(problem) is None or problem.form(TrialsForm) is not None:
        return None
    if problem.form(BatchForm) is None:
        return None
    return (
        f"method td steps {problem.name} from Python, one state at a time, which is slow; the fast one for it is "
        "--method value-gradient"
    )


def _typed(values: dict[str, Any]) -> set[str]:
    """The options among the arguments ``values`` of :func:`train` that have another value than their default."""
    parameters = inspect.signature(train).parameters
    return {
        f"--{name.replace('_', '-')}" for name, value in values.items() if value != parameters[name].default
    }


def configured(problem: str, method: str, options: dict[str, Any], count: int) -> RunConfig:
    """``count`` runs of a problem and a method by their names, with the options that belong to either."""
    from swimmer_mj.learning.method import TeamMethod
    from swimmer_mj.learning.runs.config import RunConfig
    from swimmer_mj.learning.runs.registry import METHODS, PROBLEMS, find, problem_named

    kind, own = problem_named(problem)
    kinds = find(kind, PROBLEMS, "problem"), find(method, METHODS, "method")
    options = {**own, **options}
    makers = [getattr(kind, "from_options", kind) for kind in kinds]
    known = [inspect.signature(make).parameters.keys() for make in makers]
    for name in options:
        if not any(name in names for names in known):
            option = "--" + name.replace("_", "-")
            raise ValueError(f"{option} is no option of problem {problem!r}, nor of method {method!r}")
    if problem in PROBLEMS and "s_gamma" in known[0] and not own:
        recommended = getattr(kinds[1], "s_gamma", None)
        options = options if recommended is None else {"s_gamma": recommended, **options}
    made_problem, made_method = (
        make(**{name: value for name, value in options.items() if name in names})
        for make, names in zip(makers, known, strict=True)
    )
    if isinstance(made_method, TeamMethod):
        made_method = made_method.for_seeds(made_problem, count)
    every = getattr(kinds[1], "evaluate_every", None)
    config = RunConfig(made_problem, made_method)
    config = config if every is None else dataclasses.replace(config, evaluate_every=every)
    learner = _fields(getattr(made_method, "settings", None)) | _fields(made_method)
    advice = {name: value for name, value in getattr(made_problem, "advice", {}).items() if name in learner}
    return changed(config, [f"{name}={json_module.dumps(value)}" for name, value in advice.items()])


def changed(config: RunConfig, settings: Sequence[str]) -> RunConfig:
    """``config`` with fields of its problem, of its method or of the method's ``settings`` as "name=value" says."""
    problem, method = config.problem, config.method
    learner = getattr(method, "settings", None)
    of_problem: dict[str, Any] = {}
    of_method: dict[str, Any] = {}
    of_learner: dict[str, Any] = {}
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"--set must be like mass=2, got {text!r}")
        with contextlib.suppress(ValueError, RecursionError):  # else it is a string
            value = json_module.loads(value)
        for thing, change in ((problem, of_problem), (method, of_method), (learner, of_learner)):
            if name in _fields(thing):
                change[name] = value
                break
        else:
            known = sorted({*_fields(problem), *_fields(method), *_fields(learner)})
            raise ValueError(f"--set: there is no setting {name!r}; there are {', '.join(known)}")
    if of_learner:
        method = dataclasses.replace(method, settings=_replaced(learner, of_learner))  # pyright: ignore
    return dataclasses.replace(
        config, problem=_replaced(problem, of_problem), method=_replaced(method, of_method)
    )


def _replaced(thing: Any, change: dict[str, Any]) -> Any:
    """``thing`` with other values of some fields, all at once: one may ask for another."""
    from swimmer_mj.learning.runs.registry import setting

    if not change:
        return thing
    try:
        return dataclasses.replace(
            thing, **{name: setting(type(thing), name, value) for name, value in change.items()}
        )
    except (TypeError, OverflowError) as error:
        raise ValueError(f"--set {', '.join(change)}: {error}") from error


def _fields(thing: Any) -> set[str]:
    return {field.name for field in dataclasses.fields(thing)} if dataclasses.is_dataclass(thing) else set()


def train_runs(
    console: Console,
    runs: Sequence[TrainingRun],
    *,
    trials: int | None = None,
    seconds: float | None = None,
    enough: Callable[[TrainingRun], bool] = lambda run: False,
    on_divergence: Literal["stop", "restore"] = "stop",
    tensorboard: bool = False,
    announce: bool = True,
) -> None:
    """Train ``runs`` together, with a live table on a terminal and a line an evaluation elsewhere.

    Raises
    ------
    StoppedError
        After SIGINT or SIGTERM; all runs are saved as they stand.
    """
    import torch

    from swimmer_mj.learning.runs.events import EventLogs
    from swimmer_mj.learning.runs.together import train_together

    torch.set_num_threads(1)  # the learners are the parallelism
    display = LearningDisplay(console, runs, trials, seconds)
    if announce and not console.is_terminal:
        period = runs[0].config.evaluate_every
        print_line(
            console,
            f"learning begins, the first time on a machine after up to some minutes of compiling; a line after each "
            f"evaluation, every {period:,} trials, and each {QUIET:.0f} s",
        )
    with (
        asked_to_stop() as signal_number,
        live_display(console, display.table) as live,
        EventLogs() if tensorboard else contextlib.nullcontext() as events,
    ):

        def report(report: Report) -> None:
            display.note(report, live is not None)
            if events is not None and report.metrics is not None:
                events.note(report.run.directory, report.run.history)

        train_together(
            runs,
            trials=trials,
            seconds=seconds,
            enough=enough,
            report=report,
            stop=lambda: signal_number() is not None,
            on_divergence=on_divergence,
        )
        stopped_by = signal_number()
    if stopped_by is not None:
        raise StoppedError(stopped_by, f"saved; go on with: {how_to_go_on(runs, trials)}")


def how_to_go_on(runs: Sequence[TrainingRun], trials: int | None) -> str:
    """The command, or commands, that resume ``runs``."""
    directories = [run.directory for run in runs]
    if len(runs) > 1 and all(run.directory.name == f"seed-{run.config.seed}" for run in runs):
        directories = sorted({directory.parent for directory in directories})
    until = [] if trials is None else ["--trials", str(trials)]
    until += ["--trust", *modules] if (modules := own_modules([run.config for run in runs])) else []
    commands = (["swimmer-mj", "train", "--out", str(path), "--resume", *until] for path in directories)
    return " && ".join(map(shlex.join, commands))


def own_modules(configs: Sequence[RunConfig]) -> list[str]:
    """Modules that do not come with the package, of the problems, rewards and methods of ``configs``."""
    found = {type(thing).__module__ for config in configs for thing in (config.problem, config.method)}
    found |= {
        str(getattr(config.problem, "reward_function", None) or "").partition(":")[0] for config in configs
    }
    return sorted(name for name in found if name and name.partition(".")[0] != "swimmer_mj")


MOST_SEEDS = 1000
"""For one command."""


def parse_seeds(text: str) -> list[int]:
    """[0, 1, 2, 5] of "0-2,5"."""
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]{1,18})(?:\s*-\s*([0-9]{1,18}))?\s*", part)
        if match is None or (match[2] and int(match[2]) < int(match[1])):
            raise ValueError(f"--seeds must be like 0-7 or 1,4,9; got {text[:80]!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if len(seeds) + last - first + 1 > MOST_SEEDS:
            raise ValueError(
                f"--seeds names more than {MOST_SEEDS:,} seeds: {text[:80]!r}; take some of them at a time"
            )
        seeds.extend(range(first, last + 1))
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"--seeds names a seed twice: {text[:80]!r}")
    return seeds
