"""The report of ``swimmer-mj validate`` as one HTML page that needs nothing beside it."""

from __future__ import annotations

import base64
import html
import io
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from swimmer_mj.files import replacing
from swimmer_mj.validation import Section

__all__ = ["page", "write_page"]

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c2733; background: #fff; max-width: 62rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin: 2.5rem 0 .5rem; }
p.verdict { font-size: 1.1rem; font-weight: 600; }
table { border-collapse: collapse; width: 100%; font-size: .85rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .7rem .3rem 0; border-bottom: 1px solid #dbe3ea; }
th { color: #55646f; font-weight: 600; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
td.reason { color: #55646f; }
span.ok { color: #14694a; font-weight: 600; } span.failed { color: #b3261e; font-weight: 600; }
tr.failed td { background: #fdecea; }
img { max-width: 100%; height: auto; margin-top: 1rem; }
footer { margin: 3rem 0 1rem; color: #55646f; font-size: .85rem; }
@media (max-width: 40rem) { td.reason, th.reason { display: none; } }
"""

_MARKERS = "osD^vPX*<>"


def _plot(section: Section) -> str:
    """The section's curves as a PNG in a data URI."""
    with matplotlib.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=(8.5, 4.6), dpi=120, layout="constrained")
        axes = figure.add_subplot()
        signed = any(value < 0 for curve in section.curves for value in curve.y)
        for i, curve in enumerate(section.curves):
            many = len(curve.x) > 30
            axes.plot(
                curve.x,
                curve.y,
                label=curve.label,
                linestyle="--" if curve.guide else "-",
                color="0.5" if curve.guide else None,
                marker="" if many or curve.guide else _MARKERS[i % len(_MARKERS)],
                markersize=9 - 2 * (i % 4),
                markerfacecolor="none",
                linewidth=1.2,
            )
        if section.loglog:
            axes.set_xscale("log")
            axes.set_xticks(ticks := sorted({x for curve in section.curves for x in curve.x}))
            axes.set_xticklabels([f"{tick:g}" for tick in ticks])
            axes.minorticks_off()
        if not signed:
            axes.set_yscale("log")
        axes.set_xlabel(section.axes[0])
        axes.set_ylabel(section.axes[1])
        figure.legend(loc="outside right upper", frameon=False, fontsize=8)
        data = io.BytesIO()
        figure.savefig(data, format="png")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")


def _section(section: Section) -> str:
    rows = []
    for check in section.checks:
        verdict = "ok" if check.passed else "failed"
        rows.append(
            f'<tr class="{verdict}"><td>{html.escape(check.name)}</td>'
            f'<td class="number">{check.error:.1e}</td><td class="number">{check.tolerance:.1e}</td>'
            f'<td><span class="{verdict}">{verdict}</span></td><td>{html.escape(check.worst)}</td>'
            f'<td class="reason">{html.escape(check.reason)}</td></tr>'
        )
    plot = ""
    if section.curves:
        alternative = html.escape(f"{section.title}: {section.axes[1]} by {section.axes[0]}")
        plot = f'<img src="{_plot(section)}" alt="{alternative}">'
    return (
        f"<h2>{html.escape(section.title)}</h2>\n<table><thead><tr><th>check</th><th>error</th>"
        '<th>tolerance</th><th></th><th>measured at</th><th class="reason">where the tolerance comes from</th>'
        f"</tr></thead><tbody>\n{''.join(rows)}\n</tbody></table>\n{plot}\n"
    )


def page(sections: Sequence[Section], seed: int, seconds: float) -> str:
    """The report as an HTML document."""
    checks = [check for section in sections for check in section.checks]
    failed = sum(not check.passed for check in checks)
    verdict = f"{failed} of {len(checks)} checks FAILED" if failed else f"All {len(checks)} checks passed"
    packages = ", ".join(f"{name} {version(name)}" for name in ("swimmer-mj", "mujoco", "numpy", "scipy"))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>The swimmer's physics: {html.escape(verdict)}</title><style>{_STYLE}</style></head><body>\n"
        "<h1>The swimmer's physics</h1>\n"
        f'<p class="verdict"><span class="{"failed" if failed else "ok"}">{verdict}</span></p>\n'
        "<p>Three statements of one motion: the linear system of appendix A.3, MuJoCo with the friction as a passive "
        "callback, MuJoCo with the friction as actuators. No two share a line about friction; the last two share "
        "MuJoCo's rigid bodies. The arbiter, Lagrange, shares nothing with any: it works from the positions of points, "
        "by automatic differentiation and quadrature.</p>\n"
        "<p>N = n + 2 is the number of equations, c the condition number of the mass matrix and of the levers, "
        f"eps = {np.finfo(float).eps:.1e}, and s the size of the terms that cancel, in units of f.</p>\n"
        + "".join(_section(section) for section in sections)
        + f"<footer>swimmer-mj validate, seed {seed}, {seconds:.0f} s. {packages}, "
        f"Python {platform.python_version()}, {html.escape(platform.platform())}.</footer>\n</body></html>\n"
    )


def write_page(path: Path, sections: Sequence[Section], seed: int, seconds: float) -> None:
    """Write :func:`page` to ``path``."""
    text = page(sections, seed, seconds)
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
