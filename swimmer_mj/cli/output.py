"""What commands print: tables and lines for people, or one JSON object."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    "print_facts",
    "print_json",
    "print_line",
    "status",
]


class CheckFailedError(Exception):
    """A check failed: exit status 1. Its message has been printed."""


def make_console(quiet: bool) -> Console:
    """Where people read: standard output, or nowhere when that is for JSON."""
    from rich.console import Console

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich would end the process, with the status of a failed check

    return Output(quiet=quiet, highlight=False)


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

    with Live(get_renderable=draw, console=console, refresh_per_second=1) as live:
        yield live


def print_checks(console: Console, checks: Sequence[Any]) -> None:
    """A row for each :class:`swimmer_mj.validation.Check`."""
    table = make_table(None, ("check", "error", "tolerance", ""))
    for check in checks:
        verdict = "[green]ok[/green]" if check.passed else "[red]FAILED[/red]"
        table.add_row(check.name, f"{check.error:.1e}", f"{check.tolerance:.0e}", verdict)
    console.print(table)


def print_facts(console: Console, facts: Mapping[str, Any]) -> None:
    """A table of two columns: names, those of nested facts with dots, and values."""
    from rich.text import Text

    table = make_table(None, ("", ""))
    table.show_header, table.columns[1].justify = False, "left"
    table.columns[1].overflow = "fold"  # a long path is not cut off
    for name, value in _flat(facts):
        table.add_row(name, Text(value))
    console.print(table)


def _flat(facts: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        elif isinstance(value, list | tuple):
            yield prefix + name, ", ".join(map(str, value))
        else:
            yield prefix + name, f"{value:.6g}" if isinstance(value, float) else str(value)


def print_evaluation(console: Console, result: dict[str, Any]) -> None:
    """What :func:`swimmer_mj.learning.runs.evaluation.evaluate_run` found, in a few lines."""
    measure, unit = result["measure"], result["unit"]
    name = "swimming speed" if measure == "speed" else f"mean {measure}"
    of_V, of_H2 = (" m", " m²/s²") if measure == "speed" else ("", "")
    episodes = f"{result['n_episodes']} episode{'s' * (result['n_episodes'] > 1)}"
    if (interval := result[f"{measure}_ci95"]) is not None:
        episodes = f"95 % interval over {episodes}: {interval[0]:.3f} to {interval[1]:.3f}"
    value = f"{result[f'{measure}_mean']:.3f} {unit}".strip()
    others = [
        f"{other.replace('_', ' ')} {result[f'{other}_mean']:.3f} {its_unit}".strip()
        for other, its_unit in result["units"].items()
        if other != measure
    ]
    console.print(
        f"seed {result['seed']}, {result['trials']:,} trials: {name} [bold]{value}[/bold] ({episodes})\n"
        + (f"{', '.join(others)}\n" if others else "")
        + f"<V> {result['mean_value']:.3f}{of_V} against a mean return of {result['mean_return']:.3f}{of_V} "
        f"(root mean square error {result['value_rmse']:.3f}{of_V}), "
        f"<H²> {result['mean_squared_hamiltonian']:.3f}{of_H2}"
    )
