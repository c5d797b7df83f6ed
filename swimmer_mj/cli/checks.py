"""``validate`` and ``bench``: is the physics right, and how fast is it."""

from __future__ import annotations

import time
from pathlib import Path

from swimmer_mj.cli.options import check_seed
from swimmer_mj.cli.output import (
    CheckFailedError,
    make_console,
    make_table,
    print_checks,
    print_json,
    print_line,
    status,
)

__all__ = ["bench", "validate"]


def validate(seed: int = 0, html: Path | None = None, json: bool = False) -> None:
    """Hold the statements of the physics against each other, an arbiter, invariants, closed forms and limits.

    Args:
        seed: Of the random swimmers, states and torques.
        html: Also write the report, with plots, as one page to this file.
        json: Print one JSON object.
    """
    check_seed(seed)
    if html is not None and ((html.exists() and not html.is_file()) or not html.parent.is_dir()):
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
