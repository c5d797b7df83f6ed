"""Command line: ``swimmer-mj``, also ``python -m swimmer_mj``.

Every command imports what it needs when it runs. With ``--json`` a command prints one JSON object on standard output
and nothing else there. Exit status: 0 done, 1 a check failed or learning diverged, 2 bad usage or bad input, 130 and
143 stopped by SIGINT and SIGTERM (all but a failed check with one line on standard error), 141 if nobody reads on.
The commands stand in the modules of this package; each function's signature and docstring are its command's help.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import itertools
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import tyro
from tyro.conf import FlagCreatePairsOff

from swimmer_mj.cli.checks import bench, validate
from swimmer_mj.cli.demonstration import demo
from swimmer_mj.cli.doctor import doctor
from swimmer_mj.cli.output import CheckFailedError
from swimmer_mj.cli.pictures import figures, render
from swimmer_mj.cli.reporting import report
from swimmer_mj.cli.runs import evaluate, info
from swimmer_mj.cli.signals import StoppedError
from swimmer_mj.cli.sweep import sweep
from swimmer_mj.cli.training import train
from swimmer_mj.cli.viewing import view
from swimmer_mj.cli.webpage import page

__all__ = ["COMMANDS", "main"]

COMMANDS: tuple[Callable[..., None], ...] = (
    demo, train, sweep, evaluate, render, report, page, view, validate, figures, bench, info, doctor,
)  # fmt: skip
"""In the order of the help."""

_NO_MEMORY = "there is not enough memory for this; ask for less: links, neurons, seeds, trajectories"
_DESCRIPTION = "The swimmer of Coulom (2002) and the learner that makes it swim."


def _help() -> str:
    """What ``--help`` prints: the commands and what they are for, without the parser, which takes longer."""
    width = min(shutil.get_terminal_size().columns, 120) - 2
    fold = functools.partial(textwrap.fill, width=width, subsequent_indent=" " * 12)
    lines = [
        fold(inspect.getdoc(command).partition("\n\n")[0], initial_indent=f"  {command.__name__:<10}")  # pyright: ignore[reportOptionalMemberAccess]
        for command in COMMANDS
    ]
    return "\n".join(
        [
            f"usage: swimmer-mj {{{','.join(command.__name__ for command in COMMANDS)}}} ...",
            "",
            _DESCRIPTION,
            "",
            *lines,
            "",
            "swimmer-mj COMMAND --help says more.",
        ]
    )


def _deferred(command: Callable[..., None]) -> Callable[..., Any]:
    """``command`` that returns the call instead of making it."""

    @functools.wraps(command)
    def parsed(*args: Any, **kwargs: Any) -> Any:
        return functools.partial(command, *args, **kwargs)

    return parsed


def _parse(arguments: Sequence[str]) -> functools.partial[None]:
    """The call that ``arguments`` ask for."""
    app = tyro.extras.SubcommandApp()
    for command in COMMANDS:
        app.command(_deferred(command))
    return app.cli(prog="swimmer-mj", description=_DESCRIPTION, args=arguments, config=(FlagCreatePairsOff,))


def _empty(arguments: Sequence[str]) -> str | None:
    """Which argument is empty, as one that the shell has made of a variable that is not set; None if none is.

    As a path it would be the working directory.
    """
    for before, argument in itertools.pairwise(["", *arguments]):
        if argument == "":
            return before if before.startswith("--") else "an argument"
        if re.fullmatch("--[^=]+=", argument):
            return argument[:-1]
    return None


def _unboxed(message: str) -> str:
    """What the parser says, as sentences, without the box it draws, whose title only says it twice."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", message)
    body = re.sub(r"\A(╭.*| .*\n -+ $)|^╰.*", "", plain, flags=re.MULTILINE)
    parts = re.split(r"^│? +[─-]+ *│?$", body, flags=re.MULTILINE)
    return ". ".join(part.replace("│", " ").strip().removesuffix(".") for part in parts)


def _complain(message: str) -> int:
    print("swimmer-mj:", *message.split(), file=sys.stderr)
    return 2


def _said(error: OSError) -> str:
    """What an error of the system says, without its number."""
    if error.errno is None or error.strerror is None:
        return str(error)
    return ": ".join(str(part) for part in (error.filename, error.strerror) if part)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    try:
        status = _run(list(sys.argv[1:] if arguments is None else arguments))
        _flush()
    except BrokenPipeError:  # head has read enough
        status = 141  # as of a program that SIGPIPE ends
    except OSError as error:
        status = _complain(_said(error))
    try:
        _flush()
    except OSError:  # Python would try once more at its end, and say so
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return status


def _flush() -> None:
    if sys.stdout is not None:  # as it is where it was closed
        sys.stdout.flush()


def _run(arguments: list[str]) -> int:
    """:func:`main`, but for errors of the system."""
    if arguments in (["--help"], ["-h"]):
        print(_help())
        return 0
    if (empty := _empty(arguments)) is not None:
        return _complain(f"{empty} must not be empty, got ''; is a variable of the shell not set?")
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            command = _parse(arguments)
    except SystemExit as stop:
        return _complain(_unboxed(complaint.getvalue())) if stop.code else 0
    from swimmer_mj.libraries import report_mujoco_warnings
    from swimmer_mj.needs import MissingDmControlError
    from swimmer_mj.render.backend import BackendError, use_backend

    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # as python -m does: there is module:Problem of one's own
    with contextlib.suppress(BackendError):
        use_backend()  # else dm_control looks for a screen when it is imported, also where nothing is drawn
    try:
        # view may refuse before it imports anything, and has dm_control's way; doctor says what cannot be imported
        if command.func not in (view, doctor):
            report_mujoco_warnings()
        command()
    except CheckFailedError:
        return 1
    except StoppedError as stopped:
        return _complain(str(stopped)) and stopped.status
    except KeyboardInterrupt:
        return _complain("interrupted") and 130
    except FloatingPointError as error:
        return _complain(str(error)) and 1
    except MemoryError:
        return _complain(_NO_MEMORY)
    except (ValueError, BackendError, MissingDmControlError) as error:
        return _complain(str(error))
    except RuntimeError as error:
        if "variable MUJOCO_GL" in str(error):  # MuJoCo's, when it is imported
            return _complain(f"{error}; set it to osmesa or egl, or unset it")
        if "allocate memory" not in str(error):  # torch's way to say it
            raise
        return _complain(_NO_MEMORY)
    return 0
