"""``report``: all there is to know of a run on one page."""

from __future__ import annotations

import json as json_module
import os
import platform
import shlex
import tempfile
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from swimmer_mj.cli.options import check_directory, trust_modules
from swimmer_mj.cli.output import CheckFailedError, make_console, print_json, print_line, status
from swimmer_mj.cli.pictures import Backend, record, run_label
from swimmer_mj.cli.runs import Which, first_policy_directory
from swimmer_mj.cli.shots import EPISODE, Shot
from swimmer_mj.cli.training import own_modules
from swimmer_mj.cli.webpage import described_policies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swimmer_mj.learning.problems.forms import Policy, SwimmerForm
    from swimmer_mj.learning.runs.config import RunConfig
    from swimmer_mj.render.encoding import Frame
    from swimmer_mj.render.report import Part
    from swimmer_mj.trajectory import Trajectory
    from swimmer_mj.validation import Check

__all__ = ["report"]

PACKAGES = ("swimmer-mj", "mujoco", "dm-control", "numpy", "torch", "numba")
CHECKED = 50
"""States of the episode at which the statements of the physics are compared."""


def report(
    run: Positional[Path],
    out: Path | None = None,
    which: Which = "best",
    episodes: int = 64,
    duration: float = EPISODE,
    backend: Backend | None = None,
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """One HTML page of a run, to be read without a network or printed.

    Video, film strip, the swimmer to be steered, curves, gait, evaluation, configuration, a check of the physics, and
    how to reproduce it; of another problem, what of it there is.

    Args:
        run: Run directory, or name of a pretrained policy such as swim5-value-gradient.
        out: The file; report.html in the run directory by default, for a pretrained policy in a new one of its name.
        which: The weights that were best while training, or the last.
        episodes: Of the evaluation; 64 by the definition of swimming speed.
        duration: Length of the episode that is drawn, s; the target direction is reversed after 5/13 of it.
        backend: OpenGL backend; by default the one that MUJOCO_GL names, else OSMesa, or EGL without it.
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
        json: Print one JSON object.
    """
    if not 1 <= episodes <= 64:
        raise ValueError(f"--episodes must be between 1 and 64, got {episodes}")
    shot = Shot(duration, overlay=True)
    if out is not None:
        if out.is_dir() or out.suffix not in (".html", ".htm"):
            raise ValueError(f"--out must be a file whose name ends with .html, got {out}")
        check_directory(out.parent)
    trust_modules(trust)

    from swimmer_mj.learning.pretrained import PRETRAINED
    from swimmer_mj.render.backend import use_backend

    use_backend(backend)

    from swimmer_mj.learning.problems.forms import SwimmerForm
    from swimmer_mj.learning.runs.evaluation import evaluate_run
    from swimmer_mj.learning.runs.run import load_policy
    from swimmer_mj.render.report import report_page, write_report

    console = make_console(json)
    directory = first_policy_directory(run, console)
    policy, config, _ = load_policy(directory, which)
    with status(console, f"evaluating {directory}"):
        result = evaluate_run(directory, which, episodes)
    swimmer = config.problem.form(SwimmerForm)
    name = str(run) if directory.parent == PRETRAINED else str(directory)
    with status(console, f"drawing {directory}"):
        if swimmer is None:
            parts, checks = _parts_of_any(directory, policy, config, result, shot), []
        else:
            parts, checks = _parts_of_swimmer(directory, policy, config, swimmer, result, shot)
        parts += [_configuration(config), _reproduction(name, config, result, which, episodes)]
    place = out or (run if directory.parent == PRETRAINED else directory) / "report.html"
    foot = f"swimmer-mj report {name}. {_versions()}"
    size = write_report(place, report_page(f"Report of {name}", _lead(config, result), parts, foot))
    print_line(console, f"  {place}")
    passed = all(check.passed for check in checks)
    if json:
        print_json(
            {
                "run": str(directory),
                "report": str(place),
                "bytes": size,
                "parts": [part.name for part in parts],
                "passed": passed,
                **{key: value for key, value in result.items() if key != "run"},
            }
        )
    if not passed:
        print_line(console, "a check of the physics failed; the report says which", style="red")
        raise CheckFailedError


def _lead(config: RunConfig, result: dict[str, Any]) -> str:
    """The result in a sentence."""
    from swimmer_mj.render.curves import OPEN_LOOP_SPEED

    measure, unit = result["measure"], result["unit"]
    speed = f"{result[f'{measure}_mean']:.2f} {unit}".strip()
    if (interval := result[f"{measure}_ci95"]) is not None:
        speed += f" (95\N{NO-BREAK SPACE}% interval {interval[0]:.2f} to {interval[1]:.2f})"
    lead = (
        f"{config.problem.name}, learned by {run_label(config)}, seed {config.seed}: after {result['trials']:,} trials "
        f"{'it swims at ' if measure == 'speed' else f'its mean {measure} is '}{speed}."
    )
    wave = OPEN_LOOP_SPEED.get(getattr(getattr(config.problem, "parameters", None), "n_links", 0))
    return f"{lead} The best open-loop wave makes {wave:.2f} m/s." if measure == "speed" and wave else lead


def _versions() -> str:
    from importlib.metadata import version

    there = [name for name in PACKAGES if name != "dm-control" or find_spec("dm_control")]
    packages = ", ".join(f"{name} {version(name)}" for name in there)
    return f"{packages}, Python {platform.python_version()}, {platform.machine()} {platform.system()}."


# Parts ------------------------------------------------------------------------------------------------------------


def _parts_of_swimmer(
    directory: Path,
    policy: Policy,
    config: RunConfig,
    swimmer: SwimmerForm,
    result: dict[str, Any],
    shot: Shot,
) -> tuple[list[Part], list[Check]]:
    from swimmer_mj.learning.runs.run import LOG
    from swimmer_mj.render.curves import OPEN_LOOP_SPEED, learning_curve, rollout_plot
    from swimmer_mj.render.report import Part, picture
    from swimmer_mj.render.strip import film_strip
    from swimmer_mj.render.video import frames
    from swimmer_mj.validation.agreement import along

    trajectory = record(policy, swimmer, shot)
    drawn = frames(trajectory, width=shot.width, height=shot.height, fps=shot.fps, overlay=True)
    film = _film(drawn, shot.fps, round(shot.duration * shot.fps), "The episode, seen from above")
    n = swimmer.parameters.n_links
    curve = learning_curve([(f"seed {config.seed}", directory / LOG)], reference_speed=OPEN_LOOP_SPEED.get(n))
    chosen = range(0, trajectory.n_steps, max(1, trajectory.n_steps // CHECKED))
    own = along(trajectory.parameters, trajectory.states[chosen], trajectory.controls[chosen])
    physics, checks = _physics(own)
    reversal = (
        f"The target direction is reversed after {5 / 13 * shot.duration:.3g} s, as in figure 3 of the paper."
    )
    parts = [
        Part(
            "swimming",
            "The swimmer",
            (
                film,
                picture(
                    film_strip(trajectory),
                    f"The same episode as a film strip. {reversal}",
                    f"Poses of {n} links every 0.1 s, row by row",
                ),
            ),
        ),
        Part("steer", "Steer it", (_steer(directory, policy, config, result),)),
        Part(
            "curves",
            "Learning and an episode",
            (
                picture(
                    curve,
                    "Progress of learning, as in figure 2.",
                    "Mean V, mean squared H and speed by trials",
                ),
                picture(
                    rollout_plot(trajectory),
                    f"Angles, torques, speed, V and H of the episode. {reversal}",
                    "Angles, torques, speed, V and H against time",
                ),
            ),
        ),
        Part("gait", "Gait and value", tuple(_gait(policy, trajectory, result))),
        Part("evaluation", "Evaluation", (_evaluation(result),)),
        physics,
    ]
    return parts, checks


def _parts_of_any(
    directory: Path, policy: Policy, config: RunConfig, result: dict[str, Any], shot: Shot
) -> list[Part]:
    """Of a problem that is no swimmer."""
    from swimmer_mj.learning.problems.forms import FilmForm
    from swimmer_mj.learning.runs.evaluation import record_episode
    from swimmer_mj.learning.runs.run import LOG
    from swimmer_mj.render.curves import episode_plot, learning_curve
    from swimmer_mj.render.model import model_frames
    from swimmer_mj.render.report import Part, picture

    parts = []
    if (film := config.problem.form(FilmForm)) is not None:
        drawn = model_frames(film.play(policy, shot.duration), fps=shot.fps)
        parts.append(
            Part(
                "film",
                "The model",
                (_film(drawn, shot.fps, round(shot.duration * shot.fps), "The model in motion"),),
            )
        )
    curve = learning_curve([(f"seed {config.seed}", directory / LOG)], measure="mean reward", units=None)
    episode = episode_plot(record_episode(policy, shot.duration))
    curves = (
        picture(curve, "Progress of learning.", "Mean V, mean squared H and reward by trials"),
        picture(episode, "An episode.", "States, controls, reward, V and H against time"),
    )
    return [
        *parts,
        Part("curves", "Learning and an episode", curves),
        Part("evaluation", "Evaluation", (_evaluation(result),)),
    ]


def _film(frames: Iterator[Frame], fps: int, count: int, alternative: str) -> str:
    """The frames as a video, and one of them, a third of the ``count`` into it, for paper."""
    from swimmer_mj.render.encoding import write_video
    from swimmer_mj.render.report import film

    stills: list[Frame] = []

    def seen() -> Iterator[Frame]:
        for k, frame in enumerate(frames):
            if k in (0, count // 3):
                stills[:] = [frame.copy()]
            yield frame

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_video(path, seen(), fps)
        return film(path.read_bytes(), stills[0], "In real time.", alternative)


def _steer(directory: Path, policy: Policy, config: RunConfig, result: dict[str, Any]) -> str:
    """The browser page, or why there is none."""
    from swimmer_mj.render.page.assemble import page
    from swimmer_mj.render.page.policies import require_playable
    from swimmer_mj.render.report import embedded_page, paragraph

    try:
        require_playable(policy, str(directory))
    except ValueError as error:
        return paragraph(f"There is no page to steer it: {error}.")
    speed = result["speed_mean"], result["speed_ci95"]
    described, chosen = described_policies(directory, policy, config, speed)
    return embedded_page(page(described, chosen), "The swimmer in MuJoCo, to be steered")


def _gait(policy: Policy, trajectory: Trajectory, result: dict[str, Any]) -> Iterator[str]:
    """Phase portraits, gait diagram, V, and the speed among others."""
    from swimmer_mj.render.gait import gait_diagram
    from swimmer_mj.render.links import Known, speed_by_links
    from swimmer_mj.render.phase_portraits import phase_portraits
    from swimmer_mj.render.report import paragraph, picture
    from swimmer_mj.render.strokes import NoStrokeError
    from swimmer_mj.render.value_map import default_coordinates, value_map

    def known(figure: Figure, caption: str) -> str:
        return picture(figure, caption, caption)

    try:
        yield known(gait_diagram(trajectory), "Gait diagram: one stroke.")
    except NoStrokeError as error:
        yield paragraph(f"There is no gait diagram: {error}.")
    yield known(phase_portraits(trajectory), "Phase portraits of the joints.")
    over = default_coordinates(trajectory.parameters)
    yield known(value_map(policy, trajectory, over), "V over two angles; all else as in the marked state.")
    mark = Known("this run", trajectory.parameters.n_links, result["speed_mean"])
    yield known(speed_by_links(mark=mark), "Speed against links: this run among the learners of the package.")


def _evaluation(result: dict[str, Any]) -> str:
    """All measures, and how far V is from returns."""
    from swimmer_mj.render.report import paragraph, table

    rows = []
    for measure, unit in result["units"].items():
        interval = result[f"{measure}_ci95"]
        between = "" if interval is None else f"{interval[0]:.3f} to {interval[1]:.3f}"
        rows.append((measure.replace("_", " "), f"{result[f'{measure}_mean']:.3f}", between, unit))
    unit = "m" if result["measure"] == "speed" else ""
    rows += [
        ("mean V over the evaluation sample", f"{result['mean_value']:.3f}", "", unit),
        ("mean return that V predicts there", f"{result['mean_return']:.3f}", "", unit),
        ("root mean square error of V", f"{result['value_rmse']:.3f}", "", unit),
        ("mean squared H", f"{result['mean_squared_hamiltonian']:.3f}", "", f"{unit}²/s²" if unit else ""),
    ]
    return paragraph(
        f"{result['n_episodes']} episodes; docs/metrics.md defines the measures. Intervals are over episodes."
    ) + table(("", "mean", "95 % interval", "unit"), rows)


def _physics(own: Sequence[Check]) -> tuple[Part, list[Check]]:
    """The quick checks, and those at states of this episode."""
    from swimmer_mj.render.report import Part, paragraph, table
    from swimmer_mj.validation import physics_report

    checks = [*own, *physics_report()]
    failed = sum(not check.passed for check in checks)
    verdict = f"{failed} of {len(checks)} checks FAILED." if failed else f"All {len(checks)} checks passed."
    rows = [
        (check.name, f"{check.error:.1e}", f"{check.tolerance:.1e}", "ok" if check.passed else "FAILED")
        for check in checks
    ]
    content = (
        paragraph(
            f"{verdict} The linear system of appendix A.3, MuJoCo with the friction as a callback, and MuJoCo with the "
            "friction as actuators state the same motion; the arbiter shares nothing with any. The first rows compare "
            "them at states of this episode, the others at random ones; swimmer-mj validate does more."
        ),
        table(("check", "error", "tolerance", ""), rows),
    )
    return Part("physics", "Physics check", content), checks


def _configuration(config: RunConfig) -> Part:
    from swimmer_mj.render.report import Part, facts, link_to_file

    values = config.to_json()
    text = json_module.dumps(values, indent=2)
    saved = link_to_file("config.json", text.encode(), "application/json", "Save config.json")
    return Part("configuration", "Configuration", (facts(values), saved))


def _reproduction(name: str, config: RunConfig, result: dict[str, Any], which: Which, episodes: int) -> Part:
    """A script that learns it again, and the commands of this page."""
    from importlib.metadata import version

    from swimmer_mj.render.report import Part, code, paragraph

    lines = ",\n".join(
        f" {json_module.dumps(key)}: {json_module.dumps(value)}" for key, value in config.to_json().items()
    )
    own = own_modules([config])
    script = (
        "import json\n"
        + "".join(f"import {module}\n" for module in own)
        + "from swimmer_mj.learning.runs.config import RunConfig\n"
        "from swimmer_mj.learning.runs.run import TrainingRun\n"
        "from swimmer_mj.learning.runs.together import train_together\n\n"
        f'config = RunConfig.from_json(json.loads(r"""{{\n{lines}\n}}"""))\n'
        f'train_together([TrainingRun("again", config)], trials={result["trials"]})\n'
    )
    trusted = ["--trust", *own] if own else []
    options = ["--which", which] if which != "best" else []
    options += ["--episodes", str(episodes)] if episodes != 64 else []
    commands = (
        f"{shlex.join(['swimmer-mj', 'report', name, *options, *trusted])}    # this page\n"
        f"{shlex.join(['swimmer-mj', 'evaluate', name, *options, *trusted])}    # its numbers\n"
        f"{shlex.join(['swimmer-mj', 'report', 'again', *trusted])}    # of the run that the script makes\n"
    )
    return Part(
        "reproduce",
        "How to reproduce",
        (
            paragraph(
                f"With swimmer-mj {version('swimmer-mj')} installed, this script learns with the same configuration "
                "and seed, as many trials as the weights shown had. The same instructions compute the same numbers; on "
                "another processor rounding differs, and learning with it."
            ),
            code(script),
            code(commands),
            paragraph(f"Made with {_versions()} {os.cpu_count()} cores."),
        ),
    )
