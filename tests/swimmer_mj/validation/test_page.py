import base64
import html.parser
import io
import json
import re

from PIL import Image

from swimmer_mj import validation
from swimmer_mj.cli import main
from swimmer_mj.validation import Check, Curve, Section
from swimmer_mj.validation.page import page, write_page

SECTIONS = [
    Section(
        "Orders & limits",
        [Check("a < b", 1e-3, 1e-2, "half of <it>", "n = 3"), Check("c", float("nan"), 1.0, "why")],
        ("time step, s", "error"),
        [
            Curve("one", [0.01, 0.02], [1e-3, 2e-3]),
            Curve("slope", [0.01, 0.02], [1e-3, 2e-3], guide=True),
        ],
        loglog=True,
    ),
    Section("Powers", [Check("d", 0.0, 0.0, "exact")], ("t", "W"), [Curve("P", [0, 1, 2], [-1.0, 0.0, 2.0])]),
    Section("No plot", [Check("e", 0.0, 0.0, "exact")]),
]


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.images, self.rows = [], [], [], 0
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag not in ("meta", "img", "link"):
            self.open.append(tag)
        self.links += [attributes[key] for key in ("href", "src") if key in attributes]
        self.images += [attributes["src"]] if tag == "img" else []
        self.rows += tag == "tr"

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_a_page_stands_alone_and_shows_every_check_and_plot():
    text = page(SECTIONS, seed=7, seconds=12.3)
    parsed = Page(text)
    assert all(link.startswith("data:image/png;base64,") for link in parsed.links)
    assert not re.search(r"https?://|@import|<script", text)
    assert parsed.rows == 3 + 4  # a head for each table, a row for each check
    for image in parsed.images:
        png = Image.open(io.BytesIO(base64.b64decode(image.split(",")[1])))
        assert min(png.size) > 300
        assert len(png.convert("RGB").getcolors(maxcolors=1 << 20) or []) > 10
    assert len(parsed.images) == 2
    assert "a &lt; b" in text
    assert "half of &lt;it&gt;" in text


def test_the_verdict_is_the_checks():
    assert "1 of 4 checks FAILED" in page(SECTIONS, 0, 1.0)
    assert "All 2 checks passed" in page(SECTIONS[1:], 0, 1.0)


def test_a_page_is_written_whole(tmp_path):
    write_page(tmp_path / "physics.html", SECTIONS, 0, 1.0)
    assert (tmp_path / "physics.html").read_text(encoding="utf-8") == page(SECTIONS, 0, 1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["physics.html"]


def test_the_command_reports_as_table_json_and_page_and_fails_if_a_check_does(tmp_path, monkeypatch, capsys):
    html_file = tmp_path / "physics.html"
    monkeypatch.setattr(validation, "full_report", lambda seed: iter(SECTIONS))
    assert main(["validate", "--json", "--html", str(html_file)]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["passed"] is False
    assert [check["section"] for check in printed["checks"]] == ["Orders & limits"] * 2 + [
        "Powers",
        "No plot",
    ]
    assert printed["checks"][0]["tolerance"] == 1e-2
    assert printed["checks"][1]["error"] is None  # JSON has no NaN
    assert "FAILED" in html_file.read_text(encoding="utf-8")

    monkeypatch.setattr(validation, "full_report", lambda seed: iter(SECTIONS[1:]))
    assert main(["validate"]) == 0
    assert "Powers" in capsys.readouterr().out
    assert main(["validate", "--html", str(tmp_path / "no" / "such.html")]) == 2
