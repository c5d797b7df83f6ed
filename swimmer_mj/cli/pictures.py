"""``render`` and ``figures``: pictures of a run, and those of the paper."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import check_directory, trust_modules
from swimmer_mj.cli.output import make_console, make_table, print_json, print_line, status
from swimmer_mj.cli.runs import Which, first_policy_directory
from swimmer_mj.cli.shots import EPISODE, Picture, Shot, Size, parse_steering, place_of, places_in

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.forms import FilmForm, Policy, SwimmerForm
    from swimmer_mj.learning.runs.config import RunConfig
    from swimmer_mj.trajectory import Trajectory

__all__ = ["Backend", "figures", "record", "render", "render_run", "run_label"]

Backend = Literal["osmesa", "egl", "glfw", "cgl"]
Drawing = Callable[[Path], None]
Logs = Sequence[tuple[str, Path]]


def render(
    run: Positional[Path],
    out: Path | None = None,
    which: Which = "best",
    picture: Picture | None = None,
    duration: float | None = None,
    steer: str | None = None,
    compare: Path | None = None,
    overlay: bool = False,
    slow: bool = False,
    size: Size = "640x480",
    fps: int = 30,
    over: tuple[str, str] | None = None,
    at: float | None = None,
    backend: Backend | None = None,
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Video, film strip, phase portraits, gait, V, learning curve and plots of an episode of a trained run.

    Of no swimmer: learning curve, plots, and a video if it is a MuJoCo model.

    Args:
        run: Run directory, or name of a pretrained policy such as swim5-paper.
        out: Where to put them; the run directory by default, for a pretrained policy a new one of its name. Or a file,
            whose suffix says its format, for one picture: .mp4, .mkv, .mov, .gif or .webp for the video; .png, .svg or
            .pdf for the film strip, or the picture that --picture names.
        which: The weights that were fastest while training, or the last.
        picture: Only this one.
        duration: Length of the episode, s: 13 by default, or as long as --steer takes. Without --steer the target
            direction is reversed after 5/13 of it, as in figure 3.
        steer: Where to swim, in degrees from the x axis, and how long each: 0,90,180@2s.
        compare: Another run or pretrained policy, in the same water in the video and beside this one in the learning
            curve.
        overlay: Torques, V and H in the video.
        slow: The video goes four times more slowly than real time.
        size: Of the video, pixels. The larger ones are drawn more smoothly.
        fps: Frames per second of the video.
        over: Two coordinates over which V is drawn: theta1 .., omega1 .., vx, vy, in the frame of the target.
        at: Of which moment of the episode the other coordinates are then, s; of its end by default.
        backend: OpenGL backend; by default the one that MUJOCO_GL names, else OSMesa, or EGL without it.
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
        json: Print one JSON object.
    """
    steering = None if steer is None else parse_steering(steer)
    if duration is None:
        duration = EPISODE if steering is None else max(steering.duration, 1.0)
    shot = Shot(duration, fps, size, overlay, slow, steering, over, at)
    file = None if out is None else place_of(out, picture, fps)
    if out is not None:
        check_directory(out if file is None else out.parent)
    trust_modules(trust)

    from swimmer_mj.learning.pretrained import PRETRAINED
    from swimmer_mj.render.backend import use_backend

    use_backend(backend)
    console = make_console(json)
    directory = first_policy_directory(run, console)
    rival = None if compare is None else first_policy_directory(compare, console)
    folder = out or (run if directory.parent == PRETRAINED else directory)
    places = file or places_in(folder, picture)
    with status(console, f"drawing {directory}"):
        pictures = render_run(
            directory, places, shot, which, (), rival, lambda line: print_line(console, f"  {line}")
        )
    for path in pictures.values():
        print_line(console, f"  {path}")
    if json:
        print_json({"run": str(directory), **{name: str(path) for name, path in pictures.items()}})


def render_run(
    directory: Path,
    places: Mapping[Picture, Path],
    shot: Shot = Shot(),  # noqa: B008 - immutable
    which: Which = "best",
    beside: Logs = (),
    rival: Path | None = None,
    report: Callable[[str], None] = lambda line: None,
) -> dict[str, Path]:
    """Draw pictures of the run in ``directory``; the backend is chosen before.

    Parameters
    ----------
    directory : Path
        Of the run.
    places : mapping
        Which pictures, and where they go. Of several, those that there cannot be of this run are left out; a swimmer's
        episode goes beside them.
    shot : Shot
        The episode.
    which : {"best", "last"}
        The weights.
    beside : sequence of (str, Path)
        Labels and logs of other runs, for the learning curve.
    rival : Path, optional
        Another swimmer's run, to be compared.
    report : callable
        Is told in a line why a picture is left out.
    """
    from swimmer_mj.learning.problems.forms import FilmForm, SwimmerForm
    from swimmer_mj.learning.runs.run import LOG, load_policy
    from swimmer_mj.render.strokes import NoStrokeError

    policy, config, _ = load_policy(directory, which)
    logs = [(f"{run_label(config)}, seed {config.seed}", directory / LOG), *beside]
    swimmer = config.problem.form(SwimmerForm)
    if swimmer is None:
        refused = {
            "--compare": rival,
            "--overlay": shot.overlay,
            "--steer": shot.steering,
            "--over": shot.over,
        }
        if given := [option for option, value in refused.items() if value]:
            raise ValueError(f"{given[0]} is for swimmers, and {directory} learned {config.problem.name!r}")
        drawings = _of_any_problem(policy, logs, config.problem.form(FilmForm), shot)
        if "video" in places and len(places) > 1:
            places = {**places, "video": places["video"].with_name("episode.mp4")}
    else:
        drawings = _of_swimmer(directory, policy, config, swimmer, logs, shot, which, rival)
    if len(places) == 1 and not places.keys() & drawings.keys():
        raise ValueError(
            f"{directory} learned {config.problem.name!r}, of which there is no {min(places)}; there are "
            f"{', '.join(sorted(drawings))}"
        )
    drawn: dict[str, Path] = {}
    for name, path in places.items():
        if name not in drawings:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            drawings[name](path)
        except NoStrokeError as error:
            if len(places) == 1:
                raise
            report(f"no {name}: {error}")
            continue
        drawn[name.replace("-", "_")] = path
    if swimmer is not None and len(places) > 1:
        drawn["trajectory"] = next(iter(places.values())).with_name("trajectory.npz")
        drawings["trajectory"](drawn["trajectory"])
    return drawn


def run_label(config: RunConfig) -> str:
    """What pictures call a run by: its method."""
    return getattr(config.method, "label", type(config.method).__name__)


def record(policy: Policy, swimmer: SwimmerForm, shot: Shot) -> Trajectory:
    """The episode of a shot."""
    if shot.steering is None:
        return swimmer.record(policy, shot.duration)
    from swimmer_mj.learning.problems.swim.environment import evaluation_states, record_episode

    start = evaluation_states(swimmer.parameters.n_links)[0]
    return record_episode(policy, swimmer.parameters, start, shot.duration, shot.steering)


def _axis(logs: Logs) -> Literal["trial", "seconds"]:
    """Against what learners are drawn: those beside each other may be of two methods, whose trials are not alike."""
    return "trial" if len(logs) == 1 else "seconds"


def _of_any_problem(policy: Policy, logs: Logs, film: FilmForm | None, shot: Shot) -> dict[str, Drawing]:
    """What can be drawn of a run of no swimmer."""
    from swimmer_mj.learning.runs.evaluation import record_episode
    from swimmer_mj.render.curves import episode_plot, learning_curve
    from swimmer_mj.render.figures import save_figure

    def video(path: Path) -> None:
        from swimmer_mj.render.model import model_frames
        from swimmer_mj.render.video import write_video

        assert film is not None
        motion = film.play(policy, shot.duration)
        drawn = model_frames(
            motion,
            width=shot.width,
            height=shot.height,
            fps=shot.fps * shot.slowness,
            samples=shot.samples,
        )
        write_video(path, drawn, shot.fps)

    drawings: dict[str, Drawing] = {
        "learning-curve": lambda path: save_figure(
            learning_curve(logs, measure="mean reward", units=None, against=_axis(logs)), path
        ),
        "episode": lambda path: save_figure(episode_plot(record_episode(policy, shot.duration)), path),
    }
    return drawings if film is None else {"video": video, **drawings}


def _of_swimmer(
    directory: Path,
    policy: Policy,
    config: RunConfig,
    swimmer: SwimmerForm,
    logs: Logs,
    shot: Shot,
    which: Which,
    rival: Path | None,
) -> dict[str, Drawing]:
    """What can be drawn of a swimmer's run."""
    from swimmer_mj.learning.problems.forms import SwimmerForm
    from swimmer_mj.learning.runs.run import LOG, load_policy
    from swimmer_mj.render.curves import OPEN_LOOP_SPEED, learning_curve, rollout_plot
    from swimmer_mj.render.figures import save_figure
    from swimmer_mj.render.gait import gait_diagram
    from swimmer_mj.render.phase_portraits import phase_portraits
    from swimmer_mj.render.strip import film_strip
    from swimmer_mj.render.value_map import check_coordinates, default_coordinates, value_map
    from swimmer_mj.render.video import frames, write_video

    over = shot.over or default_coordinates(swimmer.parameters)
    check_coordinates(over, swimmer.parameters.n_links)
    names: list[str] = []
    against = None
    if rival is not None:
        other, its_config, _ = load_policy(rival, which)
        its_swimmer = its_config.problem.form(SwimmerForm)
        if its_swimmer is None:
            raise ValueError(f"{rival} learned {its_config.problem.name!r}; only swimmers are compared")
        against = functools.cache(lambda: record(other, its_swimmer, shot))
        names = [f"{run_label(config)}, {directory.name}", f"{run_label(its_config)}, {rival.name}"]
        logs = [*logs, (names[1], rival / LOG)]
    episode = functools.cache(lambda: record(policy, swimmer, shot))  # once, and only if it is drawn
    reference = OPEN_LOOP_SPEED.get(swimmer.parameters.n_links)

    def video(path: Path) -> None:
        drawn = frames(
            episode(),
            width=shot.width,
            height=shot.height,
            fps=shot.fps,
            samples=shot.samples,
            overlay=shot.overlay,
            slow=shot.slowness,
            against=against and against(),
            names=names,
        )
        write_video(path, drawn, shot.fps)

    return {
        "video": video,
        "film-strip": lambda path: save_figure(film_strip(episode()), path),
        "learning-curve": lambda path: save_figure(
            learning_curve(logs, reference_speed=reference, against=_axis(logs)), path
        ),
        "episode": lambda path: save_figure(rollout_plot(episode()), path),
        "phase-portraits": lambda path: save_figure(phase_portraits(episode()), path),
        "gait": lambda path: save_figure(gait_diagram(episode()), path),
        "value-map": lambda path: save_figure(value_map(policy, episode(), over, shot.at), path),
        "trajectory": lambda path: episode().save(path),
    }


def figures(
    names: Positional[tuple[str, ...]] = (),
    rerun: bool = False,
    out: Path = Path("figures"),
    json: bool = False,
) -> None:
    """Draw the paper's figures and claims, and value gradients', from the package's logs or from scratch.

    Args:
        names: Which; all of them by default, and their names where one is unknown.
        rerun: Compute the logs anew, in the directory logs within out (docs/reproduction.md says how long each takes).
        out: Directory of the pictures, and of the tables that sum some of them up, in Markdown.
        json: Print one JSON object.
    """
    from rich.markup import escape

    from swimmer_mj.files import replacing
    from swimmer_mj.learning.experiments import EXPERIMENTS, LOGS
    from swimmer_mj.learning.experiments.made import note_made
    from swimmer_mj.learning.experiments.summaries import TABLES
    from swimmer_mj.render.figures import save_figure
    from swimmer_mj.render.reproduction import FIGURES

    for name in names:
        if name not in FIGURES:
            raise ValueError(f"there is no figure {name!r}; there are {', '.join(FIGURES)}")
    check_directory(out)
    console = make_console(json)
    logs = out / "logs" if rerun else LOGS
    pictures, tables = {}, {}
    for name in names or FIGURES:
        if rerun:
            logs.mkdir(parents=True, exist_ok=True)
            EXPERIMENTS[name].run(logs, report=lambda line: print_line(console, line))
            for log in EXPERIMENTS[name].logs:
                note_made(logs / log, f"swimmer-mj figures {name} --rerun")
        pictures[name] = out / f"{name}.png"
        save_figure(FIGURES[name](logs), pictures[name])
        print_line(console, f"{EXPERIMENTS[name].description}: {pictures[name]}")
        if name in TABLES:
            summary = TABLES[name](logs)
            tables[name] = out / f"{name}.md"
            with replacing(tables[name]) as partial:
                partial.write_text(f"{summary.title}\n\n{summary.markdown()}", encoding="utf-8")
            table = make_table(escape(summary.title), summary.header)
            for row in summary.rows:
                table.add_row(*(escape(cell) for cell in row))
            console.print(table)
    if json:
        print_json(
            {
                kind: {name: str(path) for name, path in paths.items()}
                for kind, paths in (("pictures", pictures), ("tables", tables))
            }
        )
