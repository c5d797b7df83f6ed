import base64
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from swimmer_mj.render.report import (
    Part,
    code,
    embedded_page,
    facts,
    film,
    link_to_file,
    paragraph,
    picture,
    report_page,
    table,
    write_report,
)


@pytest.fixture(scope="module")
def whole():
    """A page with everything that there can be on one."""
    figure = Figure()
    figure.subplots().plot([0, 1], [2, 3])
    content = (
        paragraph("a < b & c"),
        picture(figure, "a line", "from 2 to 3"),
        film(b"no film", np.zeros((4, 6, 3), np.uint8), "in real time", "a film"),
        table(("name", "error", ""), [("one", "1.0e-3", "ok"), ("two <x>", "2.0", "FAILED")], "errors"),
        facts({"seed": 1, "problem": {"name": "swim", "mass": [1.0, 2.0]}, "rate": 0.123456789}),
        code('print("<script>")'),
        link_to_file("config.json", b"{}", "application/json", "save"),
        embedded_page('<p id="inner">"quoted" & more</p><script>1 < 2</script>', "inner"),
    )
    return report_page("Report of <run>", "a lead", [Part("one", "One & all", content)], "foot")


def test_text_is_text(whole):
    assert "<title>Report of &lt;run&gt;</title>" in whole
    assert "a &lt; b &amp; c" in whole
    assert "print(&quot;&lt;script&gt;&quot;)" in whole
    assert "two &lt;x&gt;" in whole
    assert '<a href="#one">One &amp; all</a>' in whole
    assert '<section id="one">' in whole


def test_nothing_is_loaded_from_anywhere(whole):
    for address in re.findall(r'(?:src|href|poster)="([^"]*)"', whole):
        assert address.startswith(("data:", "#")), address[:60]
    assert "@import" not in whole
    assert "url(" not in whole


def test_pictures_films_and_files_are_in_the_page(whole):
    sources = dict(re.findall(r"data:([\w/+]+);base64,([A-Za-z0-9+/=]+)", whole))
    decoded = {kind: base64.b64decode(text) for kind, text in sources.items()}
    assert b"<svg" in decoded["image/svg+xml"]
    assert decoded["video/mp4"] == b"no film"
    assert decoded["image/png"].startswith(b"\x89PNG")
    assert decoded["application/json"] == b"{}"


def test_numbers_stand_in_columns_of_numbers(whole):
    assert '<td>one</td><td class="number">1.0e-3</td><td><span class="ok">ok</span></td>' in whole
    assert '<span class="failed">FAILED</span>' in whole


def test_facts_are_flat(whole):
    pairs = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", whole))
    assert pairs == {"seed": "1", "problem.name": "swim", "problem.mass": "1.0, 2.0", "rate": "0.123457"}


def test_it_is_written_whole(tmp_path, whole):
    size = write_report(tmp_path / "new" / "report.html", whole)
    assert (tmp_path / "new" / "report.html").read_bytes().decode() == whole
    assert size == len(whole.encode())
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["report.html"]
