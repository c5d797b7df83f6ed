"""A report as one HTML page that needs nothing beside it, on a screen or on paper: pictures, video, tables inlined."""

from __future__ import annotations

import base64
import html
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

from swimmer_mj.files import replacing
from swimmer_mj.render.encoding import Frame

__all__ = [
    "Part",
    "code",
    "embedded_page",
    "facts",
    "film",
    "link_to_file",
    "paragraph",
    "picture",
    "report_page",
    "table",
    "write_report",
]

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c2733; background: #fff; max-width: 64rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.25rem; margin: 2.8rem 0 .6rem; padding-top: .6rem; border-top: 2px solid #dbe3ea; }
h3 { font-size: 1rem; margin: 1.6rem 0 .3rem; }
p { margin: .5rem 0; max-width: 48rem; }
p.lead { font-size: 1.1rem; }
nav { font-size: .9rem; } nav a { margin-right: 1.1rem; white-space: nowrap; }
a { color: #0b6189; }
table { border-collapse: collapse; font-size: .88rem; width: 100%; }
caption { text-align: left; color: #4a5a66; padding-bottom: .3rem; }
th, td { text-align: left; vertical-align: top; padding: .28rem .9rem .28rem 0; border-bottom: 1px solid #dbe3ea;
  overflow-wrap: anywhere; }
thead th { color: #4a5a66; font-weight: 600; overflow-wrap: normal; }
tbody th { font-weight: 400; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
dl.facts { columns: 20rem 2; column-gap: 2.5rem; font-size: .85rem; margin: .5rem 0; }
dl.facts div { display: flex; justify-content: space-between; gap: 1rem; border-bottom: 1px solid #e6ecf1;
  padding: .15rem 0; break-inside: avoid; }
dl.facts dt { color: #4a5a66; } dl.facts dd { margin: 0; text-align: right; overflow-wrap: anywhere; }
figure { margin: 1rem 0; } figcaption { font-size: .88rem; color: #4a5a66; max-width: 48rem; }
img, video { max-width: 100%; height: auto; display: block; }
video { width: 640px; background: #e6f1f6; }
iframe { width: 100%; height: min(85vh, 800px); border: 1px solid #c3d0d9; border-radius: 6px; }
pre { background: #f2f6f8; padding: .8rem 1rem; overflow-x: auto; font-size: .82rem; line-height: 1.4;
  border-radius: 6px; }
.ok, .failed { font-weight: 600; white-space: nowrap; } .ok { color: #14694a; } .failed { color: #b3261e; }
footer { margin: 3rem 0 1rem; color: #4a5a66; font-size: .85rem; }
.on-paper { display: none; }
@page { size: A4; margin: 15mm; }
@media print {
  body { font-size: 10.5pt; max-width: none; margin: 0; padding: 0; }
  nav, .on-screen { display: none !important; }
  .on-paper { display: block; }
  a { color: inherit; text-decoration: none; }
  h2 { margin-top: 1.4rem; }
  h1, h2, h3, caption { break-after: avoid; }
  figure, tr { break-inside: avoid; }
  img { max-height: 11.8cm; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; border: 1px solid #dbe3ea; background: none; }
}
"""


@dataclass(frozen=True)
class Part:
    """A section."""

    name: str
    """Of its anchor."""
    title: str
    content: tuple[str, ...]
    """HTML, as the functions of this module make it."""


def report_page(title: str, lead: str, parts: Sequence[Part], foot: str) -> str:
    """The HTML document; ``title``, ``lead`` and ``foot`` are plain text."""
    links = "".join(f'<a href="#{part.name}">{html.escape(part.title)}</a>' for part in parts)
    sections = "".join(
        f'<section id="{part.name}">\n<h2>{html.escape(part.title)}</h2>\n{"".join(part.content)}</section>\n'
        for part in parts
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{html.escape(title)}</title><link rel="icon" href="data:,"><style>{_STYLE}</style></head><body>\n'
        f'<h1>{html.escape(title)}</h1>\n<p class="lead">{html.escape(lead)}</p>\n<nav>{links}</nav>\n'
        f"{sections}<footer>{html.escape(foot)}</footer>\n</body></html>\n"
    )


def write_report(path: str | os.PathLike[str], page: str) -> int:
    """Write the document; its size in bytes."""
    content = page.encode()
    with replacing(path) as partial:
        partial.write_bytes(content)
    return len(content)


# What stands in a part --------------------------------------------------------------------------------------------


def paragraph(text: str) -> str:
    """Plain text."""
    return f"<p>{html.escape(text)}</p>\n"


def picture(figure: Figure, caption: str, alternative: str) -> str:
    """A figure as SVG, which is sharp on paper."""
    data = io.BytesIO()
    figure.savefig(data, format="svg", facecolor="white", metadata={"Date": None})
    source = _data("image/svg+xml", data.getvalue())
    return (
        f'<figure><img src="{source}" alt="{html.escape(alternative)}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>\n"
    )


def film(video: bytes, still: Frame, caption: str, alternative: str) -> str:
    """An MP4 with controls; on paper, one of its frames."""
    data = io.BytesIO()
    Image.fromarray(still).save(data, format="PNG", optimize=True)
    poster, said = _data("image/png", data.getvalue()), html.escape(alternative)
    return (
        f'<figure><video class="on-screen" controls loop muted playsinline preload="metadata" poster="{poster}" '
        f'aria-label="{said}" src="{_data("video/mp4", video)}"></video>'
        f'<img class="on-paper" src="{poster}" alt="{said}"><figcaption>{html.escape(caption)}</figcaption></figure>\n'
    )


def table(header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """Cells are plain text; a column whose cells all begin with a digit or a sign has numbers."""
    numeric = [
        bool(rows) and all(row[k][:1].isdigit() or row[k][:1] in "+-\N{MINUS SIGN}" for row in rows)
        for k in range(len(header))
    ]
    kinds = [' class="number"' if number else "" for number in numeric]
    head = "".join(f"<th{kind}>{html.escape(cell)}</th>" for kind, cell in zip(kinds, header, strict=True))
    body = "".join(
        "<tr>"
        + "".join(f"<td{kind}>{_cell(cell)}</td>" for kind, cell in zip(kinds, row, strict=True))
        + "</tr>\n"
        for row in rows
    )
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table>\n"


def _cell(text: str) -> str:
    """Verdicts are coloured."""
    return f'<span class="{text.lower()}">{text}</span>' if text in ("ok", "FAILED") else html.escape(text)


def facts(values: Mapping[str, Any]) -> str:
    """Names and values; those of nested mappings have dots in their names."""
    pairs = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>\n"
        for name, value in _flat(values)
    )
    return f'<dl class="facts">{pairs}</dl>\n'


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    pairs: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            pairs += _flat(value, f"{prefix}{name}.")
        elif isinstance(value, list | tuple):
            pairs.append((prefix + name, ", ".join(map(str, value)) or "none"))
        else:
            pairs.append((prefix + name, f"{value:.6g}" if isinstance(value, float) else str(value)))
    return pairs


def code(text: str) -> str:
    """As it is."""
    return f"<pre><code>{html.escape(text)}</code></pre>\n"


def link_to_file(name: str, content: bytes, kind: str, text: str) -> str:
    """A link that saves a file which is in the page."""
    source = _data(kind, content)
    return f'<p class="on-screen"><a download="{html.escape(name)}" href="{source}">{html.escape(text)}</a></p>\n'


def embedded_page(page: str, title: str) -> str:
    """Another HTML document in a frame of its own, which starts when it comes into sight; on paper, none."""
    return (
        f'<iframe class="on-screen" loading="lazy" title="{html.escape(title)}" srcdoc="{html.escape(page)}">'
        "</iframe>\n"
        '<p class="on-paper">The file of this report has the swimmer here, to be steered in a browser.</p>\n'
    )


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
