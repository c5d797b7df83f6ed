"""What commands print: tables and lines for people, or one JSON object."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.status import Status

__all__ = [
    "CheckFailedError",
    "live_display",
    "make_console",
    "make_table",
    "print_checks",
    "print_evaluation",
    "print_json",
    "print_line",
    "status",
]


class CheckFailedError(Exception):
    """A check failed: exit status 1. Its message has been printed."""


def make_console(quiet: bool) -> Console:
    """Where people read: standard output, or nowhere when that is for JSON."""
    from rich.console import Console

    return Console(quiet=quiet, highlight=False)


def print_line(console: Console, line: str, style: str | None = None) -> None:
    """A line as it is: what looks like markup in a path or a message is none, and nothing is folded."""
    from rich.text import Text

    console.print(Text(line), style=style, soft_wrap=True)


def status(console: Console, line: str) -> Status:
    """What is being done, with :func:`print_line`'s care, while a block runs."""
    from rich.text import Text

    return console.status(Text(line))


def print_json(value: dict[str, Any]) -> None:
    """The one object that ``--json`` prints."""
    print(json.dumps(value, indent=2, allow_nan=False))


def make_table(title: str | None, columns: Sequence[str]) -> Any:
    """A table without rows; all columns but the first are numbers."""
    from rich.box import SIMPLE
    from rich.table import Table

    table = Table(title=title, box=SIMPLE, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    return table


@contextlib.contextmanager
def live_display(console: Console, draw: Callable[[], Any]) -> Iterator[Any]:
    """A display that redraws itself on a terminal; None elsewhere."""
    if not console.is_terminal or console.quiet:
        yield None
        return
    from rich.live import Live

    with Live(get_renderable=draw, console=console, refresh_per_second=4) as live:
        yield live


def print_checks(console: Console, checks: Sequence[Any]) -> None:
    """A row for each :class:`swimmer_mj.validation.Check`."""
    table = make_table(None, ("check", "error", "tolerance", ""))
    for check in checks:
        verdict = "[green]ok[/green]" if check.passed else "[red]FAILED[/red]"
        table.add_row(check.name, f"{check.error:.1e}", f"{check.tolerance:.0e}", verdict)
    console.print(table)


def print_evaluation(console: Console, result: dict[str, Any]) -> None:
    """What :func:`swimmer_mj.cli.runs.evaluate_run` found, in two lines."""
    episodes = f"{result['n_episodes']} episode{'s' * (result['n_episodes'] > 1)}"
    if (interval := result["speed_ci95"]) is not None:
        episodes = f"95 % interval over {episodes}: {interval[0]:.3f} to {interval[1]:.3f}"
    console.print(
        f"seed {result['seed']}, {result['trials']:,} trials: swimming speed "
        f"[bold]{result['speed_mean']:.3f} m/s[/bold] "
        f"({episodes})\n"
        f"<V> {result['mean_value']:.3f} m against a mean return of {result['mean_return']:.3f} m "
        f"(root mean square error {result['value_rmse']:.3f} m), <H²> {result['mean_squared_hamiltonian']:.3f} m²/s²"
    )
