"""``doctor``: is the installation sound, and if not, what mends it."""

from __future__ import annotations

import dataclasses
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from swimmer_mj.cli.output import CheckFailedError, make_console, print_facts, print_json, print_line
from swimmer_mj.cli.pictures import Backend

__all__ = ["doctor"]

LEAST_DISK = 200e6
"""Bytes: a film, a page and the checkpoints of some seeds."""
PACKAGES = ("swimmer-mj", "mujoco", "dm-control", "numpy", "torch", "numba", "scipy")


class BrokenError(Exception):
    """A piece is missing or broken; the message says in a line what, and the command that mends it."""

    def __init__(self, message: str, facts: dict[str, Any] | None = None) -> None:
        super().__init__(message)
        self.facts = {"error": message} if facts is None else facts


def doctor(backend: Backend | None = None, json: bool = False) -> None:
    """Is this installation sound? Versions, drawing, video, cache, disk, cores, and the friction callback at work.

    Args:
        backend: OpenGL backend to try; by default the one that MUJOCO_GL names, else OSMesa, or EGL without it.
        json: Print one JSON object.
    """
    pieces: dict[str, Callable[[], Any]] = {
        "versions": _versions,
        "rendering": lambda: _rendering(backend),
        "ffmpeg": _ffmpeg,
        "cache": _cache,
        "disk": _disk,
        "callback": _callback,
    }
    report: dict[str, Any] = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "usable_cores": _usable_cores(),
    }
    problems = []
    for name, examine in pieces.items():
        try:
            report[name] = examine()
        except BrokenError as error:
            problems.append(f"{name}: {error}")
            report[name] = error.facts
        except ImportError as error:
            problems.append(f"{name}: {error}; mend it with: pip install --force-reinstall swimmer-mj")
            report[name] = {"error": str(error)}
    report["problems"] = problems
    console = make_console(json)
    print_facts(console, _found(report))
    if json:
        print_json(report)
    for problem in problems:
        print_line(console, problem, style="red")
    if problems:
        raise CheckFailedError


def _usable_cores() -> int:
    """Cores on which this process may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _versions() -> dict[str, str]:
    """Of the main packages; all that are required are held against the range that is asked for."""
    from packaging.requirements import Requirement

    wrong = []
    for line in requires("swimmer-mj") or ():
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            if not requirement.specifier.contains(found := version(requirement.name), prereleases=True):
                wrong.append((f"{requirement.name} is {found}", requirement))
        except PackageNotFoundError:
            wrong.append((f"{requirement.name} is missing", requirement))
    if wrong:
        facts = ", ".join(f"{fact}, and must be {need.specifier}" for fact, need in wrong)
        for _, need in wrong:
            need.marker = None  # pip is told the rest, with extras
        mended = " ".join(f"'{need}'" for _, need in wrong)
        raise BrokenError(f"{facts}; mend it with: pip install {mended}")
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not there"
    return found


def _rendering(backend: str | None) -> dict[str, Any]:
    """One frame, drawn in a process of its own."""
    from swimmer_mj.render.backend import BackendError, probe

    try:
        return dataclasses.asdict(probe(backend))
    except BackendError as error:
        raise BrokenError(str(error)) from error


def _ffmpeg() -> str:
    """The version of the encoder of videos."""
    mend = "mend it with: pip install --force-reinstall --no-deps imageio-ffmpeg"
    if "IMAGEIO_FFMPEG_EXE" in os.environ:
        mend = "mend it with: unset IMAGEIO_FFMPEG_EXE"
    try:
        import imageio_ffmpeg

        program = imageio_ffmpeg.get_ffmpeg_exe()
        done = subprocess.run([program, "-version"], capture_output=True, text=True, timeout=60)
    except (ImportError, RuntimeError, OSError, subprocess.TimeoutExpired) as error:
        given = " (IMAGEIO_FFMPEG_EXE names it)" if "IMAGEIO_FFMPEG_EXE" in os.environ else ""
        raise BrokenError(f"it does not run{given}: {' '.join(str(error).split())[:100]}; {mend}") from error
    if done.returncode != 0:
        raise BrokenError(f"{program} ends with status {done.returncode}; {mend}")
    return " ".join(done.stdout.split()[:3])


def _cache() -> str:
    """The directory of compiled code, into which a file is written."""
    from swimmer_mj.compiled.cache import directory

    place = directory()
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise BrokenError(
            f"{place} cannot be written to ({error.strerror}), so that each process compiles anew, for minutes; "
            "mend it with: export NUMBA_CACHE_DIR=$HOME/.cache/swimmer-mj"
        ) from error
    return str(place)


def _disk() -> str:
    """What is free where one is."""
    here = Path.cwd()
    free = shutil.disk_usage(here).free
    if free < LEAST_DISK:
        raise BrokenError(
            f"{free / 1e6:.0f} MB are free in {here}; make room, after: du -xh --max-depth=1 {here} | sort -h"
        )
    return f"{free / 1e9:.1f} GB free"


def _callback() -> dict[str, Any]:
    """The friction at work on a rod, and nobody else's passive callback beside it."""
    import mujoco

    from swimmer_mj.validation import callback_self_test

    if (other := mujoco.get_mjcb_passive()) is not None:  # pyright: ignore[reportAttributeAccessIssue]
        raise BrokenError(
            f"something that Python imports at its start installs {other!r} as MuJoCo's passive callback, for every "
            "model of the process; find it with: python -X importtime -c pass"
        )
    try:
        check = callback_self_test()
    except RuntimeError as error:
        raise BrokenError(f"{error}; mend it with: pip install --force-reinstall swimmer-mj") from error
    if not check.passed:
        raise BrokenError(
            f"{check.name}: error {check.error:.1e} exceeds {check.tolerance:.0e}; "
            "mend it with: pip install --force-reinstall mujoco numba swimmer-mj",
            check.to_json(),
        )
    return check.to_json()


def _found(report: dict[str, Any]) -> dict[str, Any]:
    """What :func:`doctor` found, for its table."""
    failed = {problem.partition(":")[0] for problem in report["problems"]}
    facts = {name: report[name] for name in ("python", "platform")}
    facts["cores"] = str(report["cores"])
    if report["usable_cores"] < report["cores"]:
        facts["cores"] += (
            f", of which {report['usable_cores']} may be used; all with: taskset -c 0-{report['cores'] - 1} swimmer-mj"
        )
    facts |= {} if "versions" in failed else report["versions"]
    frame, callback = report["rendering"], report["callback"]
    said: dict[str, Callable[[], str]] = {
        "versions": lambda: "ok: as required",
        "rendering": lambda: f"ok: {frame['backend']} drew a frame in {frame['first_frame_seconds']:.2f} s",
        "callback": lambda: (
            f"ok: {callback['name']}: error {callback['error']:.1e}, at most {callback['tolerance']:.0e}"
        ),
    }
    for name in ("versions", "rendering", "ffmpeg", "cache", "disk", "callback"):
        facts[name] = (
            "FAILED" if name in failed else said.get(name, lambda name=name: f"ok: {report[name]}")()
        )
    return facts
