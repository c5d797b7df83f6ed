"""``validate``, ``bench`` and ``doctor``: is the physics right, how fast is it, is the installation sound."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from typing import Any

from swimmer_mj.cli.options import check_seed
from swimmer_mj.cli.output import (
    CheckFailedError,
    make_console,
    make_table,
    print_checks,
    print_facts,
    print_json,
    print_line,
    status,
)
from swimmer_mj.cli.pictures import Backend

__all__ = ["bench", "doctor", "validate"]


def validate(seed: int = 0, html: Path | None = None, json: bool = False) -> None:
    """Hold the statements of the physics against each other, an arbiter, invariants, closed forms and limits.

    Args:
        seed: Of the random swimmers, states and torques.
        html: Also write the report, with plots, as one page to this file.
        json: Print one JSON object.
    """
    check_seed(seed)
    if html is not None and (html.is_dir() or not html.parent.is_dir()):
        raise ValueError(f"--html must be a file in an existing directory, got {html}")

    from swimmer_mj.validation import full_report
    from swimmer_mj.validation.page import write_page

    started = time.perf_counter()
    console = make_console(json)
    sections = []
    for section in full_report(seed):
        console.print(f"[bold]{section.title}[/bold]")
        print_checks(console, section.checks)
        sections.append(section)
    seconds = time.perf_counter() - started
    passed = all(section.passed for section in sections)
    if html is not None:
        write_page(html, sections, seed, seconds)
        print_line(console, f"  {html}")
    if json:
        print_json(
            {
                "passed": passed,
                "seconds": seconds,
                "checks": [
                    {"section": section.title, **check.to_json()}
                    for section in sections
                    for check in section.checks
                ],
                "curves": [
                    {"section": section.title, **curve.to_json()}
                    for section in sections
                    for curve in section.curves
                ],
            }
        )
    if not passed:
        raise CheckFailedError


def bench(json: bool = False) -> None:
    """Steps per second of MuJoCo and of the learners, timed in one run.

    Args:
        json: Print one JSON object.
    """
    from swimmer_mj.learning.experiments.rates import run_benchmark

    console = make_console(json)
    with status(console, "timing"):
        rates = run_benchmark()
    table = make_table("Steps per second", ("", "1/s"))
    for name, rate in rates.items():
        table.add_row(name, f"{rate:,.0f}")
    console.print(table)
    if json:
        print_json(rates)


def doctor(backend: Backend | None = None, json: bool = False) -> None:
    """Is this installation sound? Versions, one rendered frame, the friction callback at work.

    Args:
        backend: OpenGL backend to try; by default the one that MUJOCO_GL names, else OSMesa, on macOS CGL.
        json: Print one JSON object.
    """
    import platform
    from importlib.metadata import version

    from swimmer_mj.render.backend import BackendError, probe
    from swimmer_mj.validation import callback_self_test

    packages = ("swimmer-mj", "mujoco", "dm-control", "numpy", "torch", "numba", "scipy")
    report: dict[str, Any] = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "versions": {package: version(package) for package in packages},
    }
    problems = []
    try:
        report["rendering"] = dataclasses.asdict(probe(backend))
    except BackendError as error:
        problems.append(f"rendering: {error}")
        report["rendering"] = {"error": str(error)}
    try:
        check = callback_self_test()
        report["callback"] = check.to_json()
        if not check.passed:
            problems.append(f"callback: {check.name}: error {check.error:.1e} exceeds {check.tolerance:.0e}")
    except RuntimeError as error:
        problems.append(f"callback: {error}")
        report["callback"] = {"error": str(error)}
    report["problems"] = problems
    console = make_console(json)
    print_facts(console, _found(report))
    if json:
        print_json(report)
    for problem in problems:
        print_line(console, problem, style="red")
    if problems:
        raise CheckFailedError


def _found(report: dict[str, Any]) -> dict[str, Any]:
    """What :func:`doctor` found, for its table."""
    failed = {problem.partition(":")[0] for problem in report["problems"]}
    frame, callback = report["rendering"], report["callback"]
    facts = {name: report[name] for name in ("python", "platform", "cores")} | report["versions"]
    facts["rendering"] = facts["callback"] = "FAILED"
    if "rendering" not in failed:
        facts["rendering"] = f"ok: {frame['backend']} drew a frame in {frame['first_frame_seconds']:.2f} s"
    if "callback" not in failed:
        facts["callback"] = (
            f"ok: {callback['name']}: error {callback['error']:.1e}, at most {callback['tolerance']:.0e}"
        )
    return facts
