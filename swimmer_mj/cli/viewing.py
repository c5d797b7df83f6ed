"""``view``: a task in dm_control's viewer."""

from __future__ import annotations

import os
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from swimmer_mj.cli.options import check_seed, trust_modules
from swimmer_mj.cli.output import make_console, print_line
from swimmer_mj.cli.runs import Which, first_policy_directory
from swimmer_mj.needs import MissingDmControlError

__all__ = ["lacks_screen", "view"]


def view(
    task: Positional[Literal["swim3", "swim4", "swim5", "steer3", "steer4", "steer5"]],
    run: Positional[Path | None] = None,
    which: Which = "best",
    seed: int = 0,
    trust: tuple[str, ...] = (),
) -> None:
    """Watch a task in dm_control's viewer: with the policy of a run, or with random torques.

    Args:
        task: Task of the dm_control suite.
        run: Run directory, or name of a pretrained policy, of a swimmer with as many links; random torques without one.
        which: The weights that were fastest while training, or the last.
        seed: Of initial states and random torques.
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
    """
    check_seed(seed)
    instead = f"swimmer-mj render {run or 'RUN'}"
    if find_spec("dm_control") is None:
        raise MissingDmControlError("view", f"for a video {instead}")
    if lack := lacks_screen():
        raise ValueError(f"view needs a screen and {lack}; for a video without one: {instead}")

    from swimmer_mj.render.backend import use_backend

    use_backend("glfw")  # the only one with windows
    trust_modules(trust)
    _open_viewer(task, run, which, seed)


def lacks_screen() -> str | None:
    """Why no window can be opened; None if nothing is known to be in the way."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if sys.platform == "linux" and not display:
        return "DISPLAY is not set"
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW says there what is said here
        return None if glfw.init() else f"{display or 'the screen'} cannot be opened"


def _open_viewer(task: str, run: Path | None, which: Which, seed: int) -> None:
    """Open the viewer, until its window is closed; the backend is chosen before."""
    console = make_console(False)
    policy, swimmer = None, None
    if run is not None:
        from swimmer_mj.learning.problems.forms import SwimmerForm
        from swimmer_mj.learning.problems.swim.environment import SwimmingPolicy
        from swimmer_mj.learning.runs.run import load_policy

        directory = first_policy_directory(run, console)
        greedy, config, _ = load_policy(directory, which)
        swimmer = config.problem.form(SwimmerForm)
        if swimmer is None:
            raise ValueError(f"{directory} learned {config.problem.name!r}; only swimmers are shown")
        if (n := swimmer.parameters.n_links) != int(task[-1]):
            raise ValueError(f"{directory} learned to move {n} links, and {task} has {task[-1]}")
        policy = SwimmingPolicy(greedy)

    import numpy as np
    from dm_control.viewer.application import Application

    import swimmer_mj

    task_kwargs: dict[str, Any] = {"random": seed, "time_limit": float("inf")}
    if swimmer is not None:
        task_kwargs["params"] = swimmer.parameters
    env = swimmer_mj.load(task, task_kwargs=task_kwargs)
    rng, shape = np.random.default_rng(seed), env.action_spec().shape

    def act(time_step: Any) -> Any:
        return rng.uniform(-1, 1, shape) if policy is None else policy(time_step.observation)

    try:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # GLFW says there what is said here
                window = Application(title=f"{task}: {run or 'random torques'}")
        except RuntimeError as error:
            raise ValueError(f"view needs a screen with OpenGL: {error}") from None
        print_line(console, "Space: start, pause. [: follow the swimmer. Backspace: anew. F1: all keys.")
        window.launch(env, policy=act)
    finally:
        env.physics.free()
