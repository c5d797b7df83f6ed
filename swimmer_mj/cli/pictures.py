"""``render`` and ``figures``: pictures of a run, and those of the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import check_directory, trust_modules
from swimmer_mj.cli.output import make_console, make_table, print_json, print_line, status
from swimmer_mj.cli.runs import Which, first_policy_directory

__all__ = ["Backend", "figures", "render", "render_run"]

Backend = Literal["osmesa", "egl", "glfw", "cgl"]

LONGEST, FASTEST = 3600.0, 240
"""s of an episode, frames a second; more are taken for a slip."""


def render(
    run: Positional[Path],
    out: Path | None = None,
    which: Which = "best",
    duration: float = 13.0,
    fps: int = 30,
    backend: Backend | None = None,
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Video, film strip, learning curve and plots of an episode of a trained run; of no swimmer, the curve and plots.

    Args:
        run: Run directory, or name of a pretrained policy such as swim5-paper.
        out: Where to put them; the run directory by default, for a pretrained policy a new one of its name.
        which: The weights that were fastest while training, or the last.
        duration: Length of the episode, s; the target direction is reversed after 5/13 of it, as in figure 3.
        fps: Frames per second of the video.
        backend: OpenGL backend; by default the one that MUJOCO_GL names, else OSMesa, on macOS CGL.
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
        json: Print one JSON object.
    """
    if not 1 <= duration < math.inf:
        raise ValueError(f"--duration must be finite and at least 1 s, got {duration}")
    if fps < 1:
        raise ValueError(f"--fps must be at least 1, got {fps}")
    if duration > LONGEST or fps > FASTEST:
        raise ValueError(
            f"--duration must be at most {LONGEST:.0f} s and --fps at most {FASTEST}, got {duration} and {fps}"
        )
    if out is not None:
        check_directory(out)
    trust_modules(trust)

    from swimmer_mj.learning.pretrained import PRETRAINED
    from swimmer_mj.render.backend import use_backend

    use_backend(backend)
    console = make_console(json)
    directory = first_policy_directory(run, console)
    place = run if directory.parent == PRETRAINED else directory
    with status(console, f"drawing {directory}"):
        pictures = render_run(directory, out or place, duration, fps, which)
    for path in pictures.values():
        print_line(console, f"  {path}")
    if json:
        print_json({"run": str(directory), **{name: str(path) for name, path in pictures.items()}})


def render_run(
    directory: Path,
    out: Path,
    duration: float,
    fps: int,
    which: Which = "best",
    beside: Sequence[tuple[str, Path]] = (),
) -> dict[str, Path]:
    """Draw all there is to see of a run; the backend is chosen before."""
    from swimmer_mj.learning.problems.forms import FilmForm, SwimmerForm
    from swimmer_mj.learning.runs.run import LOG, load_policy
    from swimmer_mj.render.figures import save_figure

    policy, config, _ = load_policy(directory, which)
    label = getattr(config.method, "label", type(config.method).__name__)
    logs = [(f"{label}, seed {config.seed}", directory / LOG), *beside]
    swimmer = config.problem.form(SwimmerForm)
    out.mkdir(parents=True, exist_ok=True)
    paths = {"learning_curve": out / "learning-curve.png", "episode": out / "episode.png"}
    if swimmer is None:
        from swimmer_mj.learning.runs.evaluation import record_episode
        from swimmer_mj.render.curves import episode_plot, learning_curve

        save_figure(learning_curve(logs, measure="mean reward", units=None), paths["learning_curve"])
        save_figure(episode_plot(record_episode(policy, duration)), paths["episode"])
        film = config.problem.form(FilmForm)
        if film is not None:
            from swimmer_mj.render.model import model_frames
            from swimmer_mj.render.video import write_video

            paths["video"] = out / "episode.mp4"
            write_video(paths["video"], model_frames(film.play(policy, duration), fps=fps), fps)
        return paths

    from swimmer_mj.render.curves import OPEN_LOOP_SPEED, learning_curve, rollout_plot
    from swimmer_mj.render.strip import film_strip
    from swimmer_mj.render.video import frames, write_video

    trajectory = swimmer.record(policy, duration)
    paths = {
        "video": out / "swimmer.mp4",
        "film_strip": out / "film-strip.png",
        **paths,
        "trajectory": out / "trajectory.npz",
    }
    trajectory.save(paths["trajectory"])
    write_video(paths["video"], frames(trajectory, fps=fps), fps)
    save_figure(film_strip(trajectory), paths["film_strip"])
    reference = OPEN_LOOP_SPEED.get(swimmer.parameters.n_links)
    save_figure(learning_curve(logs, reference_speed=reference), paths["learning_curve"])
    save_figure(rollout_plot(trajectory), paths["episode"])
    return paths


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
    from swimmer_mj.learning.experiments.summaries import TABLES
    from swimmer_mj.render.figures import save_figure
    from swimmer_mj.render.reproduction import FIGURES

    for name in names:
        if name not in FIGURES:
            raise ValueError(f"there is no figure {name!r}; there are {', '.join(FIGURES)}")
    console = make_console(json)
    logs = out / "logs" if rerun else LOGS
    pictures, tables = {}, {}
    for name in names or FIGURES:
        if rerun:
            logs.mkdir(parents=True, exist_ok=True)
            EXPERIMENTS[name].run(logs, report=lambda line: print_line(console, line))
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
