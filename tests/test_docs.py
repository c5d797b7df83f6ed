"""What the documentation says is run, followed or looked up."""

import functools
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import docs_tables
import pytest
from packaging.version import Version

from swimmer_mj.cli import main
from swimmer_mj.learning.runs.run import Metrics

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "models" / "README.md"]


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def without_fences(text):
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def code_spans(text):
    return re.findall(r"`([^`\n]+)`", without_fences(text))


# Examples. Those of some pages have tests of their own.
EXAMPLES = {
    name: re.findall(r"```python\n(.*?)```", page(name), re.DOTALL)
    for name in ("docs/python.md", "docs/gymnasium.md", "docs/physics.md", "models/README.md")
}
RUN = """
import contextlib, io, json, sys, traceback

def run(code):
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            exec(code, {"__name__": "__main__"})
        except Exception:
            return printed.getvalue(), traceback.format_exc()
    return printed.getvalue(), ""

ran = [run(code) for code in json.load(sys.stdin)]
print(json.dumps(ran))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """What the examples of a page print, and how they fail: one after the other, each with names of its own."""

    @functools.cache
    def of_page(name):
        folder = tmp_path_factory.mktemp("page")
        (folder / "models").symlink_to(ROOT / "models")  # as in a checkout; what they write stays here
        command, codes = [sys.executable, "-c", RUN], json.dumps(EXAMPLES[name])
        done = subprocess.run(command, cwd=folder, input=codes, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return of_page


@pytest.mark.parametrize(
    ("name", "number"), [(name, number) for name, codes in EXAMPLES.items() for number in range(len(codes))]
)
def test_an_example_runs_and_prints_what_it_says(outcomes, name, number):
    printed, error = outcomes(name)[number]
    if importlib.util.find_spec("dm_control") is None and re.search("MissingDmControl|'dm_control'", error):
        pytest.skip("it needs dm_control")
    assert not error
    expected = re.findall(r"^print\(.*\)  # (.*)$", EXAMPLES[name][number], re.MULTILINE)
    assert printed.splitlines() == expected


def test_all_examples_are_found():
    elsewhere = {
        "errata.md",
        "own-problem.md",
        "any-model.md",
        "extending.md",
    }  # they have tests of their own
    pages = [path for path in PAGES if path.name not in elsewhere]
    assert sum(map(len, EXAMPLES.values())) == sum(path.read_text().count("```python") for path in pages)


# Links
LINKS = [
    pytest.param(path, target, id=f"{path.relative_to(ROOT)}:{target}")
    for path in PAGES
    for target in re.findall(r"\]\(([^)\s]+)\)", without_fences(path.read_text(encoding="utf-8")))
    if not re.match(r"[a-z]+:|#", target)
]


@pytest.mark.parametrize(("path", "target"), LINKS)
def test_a_relative_link_leads_to_a_file(path, target):
    assert (path.parent / target.partition("#")[0]).is_file()


def test_links_are_found_and_reach_every_page():
    reached = {(path.parent / target).resolve() for path, target in (link.values for link in LINKS)}
    entries = {
        (path.parent / f"{entry}.md").resolve()
        for path in PAGES
        for block in re.findall(r"```\{toctree\}\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
        for entry in re.findall(r"^[\w./-]+$", block, re.MULTILINE)
    }
    pages = {path for path in PAGES if path.name != "README.md" or path.parent.name == "models"}
    assert entries == pages - {ROOT / "docs" / "index.md"}  # in the site, each has one place
    assert reached >= pages - {path for path in pages if path.parent.name == "decisions"}
    assert reached & {path for path in pages if path.parent.name == "decisions"}


# The paper map
def resolve(name):
    """The object that a dotted name relative to swimmer_mj names."""
    first, *rest = parts = name.split(".")
    for count in range(len(parts), 0, -1):
        module = "swimmer_mj." + ".".join(parts[:count])
        if importlib.util.find_spec("swimmer_mj." + first) and _is_module(module):
            found = importlib.import_module(module)
            for part in parts[count:]:
                found = getattr(found, part)
            return found
    raise ModuleNotFoundError(f"{name}: there is no swimmer_mj.{first}, {rest}")


def _is_module(name):
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


MAP = code_spans(page("docs/paper-map.md"))
NAMES = sorted({span for span in MAP if re.fullmatch(r"[a-z_]+(\.\w+)+", span)})
TESTS = sorted({span for span in MAP if span.startswith("tests/")})


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_paper_map_exists(name):
    if name.startswith("environments.suite"):
        pytest.importorskip("dm_control")
    assert resolve(name) is not None


@pytest.mark.parametrize("name", ["analytic.friction_force", "nothing.at_all", "state.FullState.mass"])
def test_a_wrong_name_would_be_noticed(name):
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        resolve(name)


@pytest.mark.parametrize("node", TESTS)
def test_a_test_of_the_paper_map_exists(node):
    path, _, function = node.partition("::")
    assert (ROOT / path).is_file()
    assert re.search(rf"^def {function or 'test_.*'}\(", page(path), re.MULTILINE)


def test_the_paper_map_has_a_function_and_a_test_in_each_row():
    rows = [line for line in page("docs/paper-map.md").splitlines() if re.match(r"\| (?!paper|-)", line)]
    assert len(rows) > 40
    assert {*MAP} - {*NAMES, *TESTS} == {"swimmer_mj", "pytest"}
    for row in rows:
        assert {*code_spans(row)} & {*NAMES}, row
        assert {*code_spans(row)} & {*TESTS}, row


# Commands
COMMANDS = sorted(
    {
        command
        for text in (path.read_text(encoding="utf-8") for path in PAGES)
        for command in re.findall(r"(?:^|`)swimmer-mj ([a-z][^`#\n]*)", text, re.MULTILINE)
    }
)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_and_its_options_exist(command, capsys):
    name, *rest = command.split()
    assert main([name, "--help"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"usage: swimmer-mj {name} ")
    for option in (word for word in rest if word.startswith("--")):
        assert re.search(rf"{option}\b", shown), option


def test_the_page_of_commands_names_every_command(capsys):
    assert main(["--help"]) == 0
    (names,) = re.findall(r"\{([a-z,]+)\}", capsys.readouterr().out)
    rows = re.findall(r"^\| `swimmer-mj ([a-z]+)", page("docs/commands.md"), re.MULTILINE)
    assert {*rows} == {*names.split(",")}


@pytest.mark.parametrize("command", ["swim", "train --sed 1", "evaluate --out RUN"])
def test_a_wrong_command_would_be_noticed(command, capsys):
    with pytest.raises(AssertionError):
        test_a_command_and_its_options_exist(command, capsys)


def test_make_targets_exist():
    targets = {
        name for path in PAGES for name in re.findall(r"(?:^|`)make ([a-z]+)", path.read_text(), re.MULTILINE)
    }
    there = {*re.findall(r"^([a-z]+):", page("Makefile"), re.MULTILINE)}
    assert {"demo", "test", "docs", "release"} <= targets <= there


# Facts stated twice
@pytest.mark.parametrize("path", docs_tables.PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_tables_of_a_page_are_what_the_logs_say(path):
    """If not: python benchmarks/docs_tables.py."""
    text = path.read_text(encoding="utf-8")
    assert docs_tables.with_tables(text) == text


def test_every_table_that_is_made_from_logs_is_in_a_page():
    marked = [mark[1] for path in docs_tables.PAGES for mark in docs_tables.MARKED.findall(path.read_text())]
    assert sorted(marked) == sorted(docs_tables.TABLES)


def test_a_table_that_is_off_or_unknown_is_noticed():
    text = "<!-- table: value-gradient-links -->\n| 5 | 3.0 |\n<!-- end -->\n"
    assert "| 5 | 10 | 2." in docs_tables.with_tables(text)
    with pytest.raises(ValueError, match="there is no table 'speed'"):
        docs_tables.with_tables("<!-- table: speed -->\n<!-- end -->\n")
    with pytest.raises(ValueError, match="no <!-- end -->"):
        docs_tables.with_tables("<!-- table: value-gradient-links -->\n")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_placeholder_is_left(path):
    assert "<<" not in path.read_text(encoding="utf-8")


def test_every_column_of_the_log_is_defined():
    section = page("docs/metrics.md").split("## metrics.csv")[1].split("\n## ")[0]
    assert tuple(re.findall(r"^\| `(\w+)`", section, re.MULTILINE)) == Metrics._fields


def test_every_dependency_has_its_reason():
    (block,) = re.findall(r"^dependencies = \[\n(.*?)^\]", page("pyproject.toml"), re.DOTALL | re.MULTILINE)
    required = re.findall(r'^    "([\w-]+)(?:\[\w+\])?([^";]*)', block, re.MULTILINE)  # mujoco twice
    rows = dict(re.findall(r"^\| ([a-z-]+) \|(.*)\|$", page("docs/dependencies.md"), re.MULTILINE)[1:])
    assert {*rows} == {package for package, _ in required}
    for package, bounds in required:
        for bound in bounds.split(","):
            assert f"`{bound}`" in rows[package], package


def test_the_torch_that_is_installed_beforehand_is_one_that_the_package_takes():
    """On every Python: else pip replaces it, by a build of several GB."""
    (bound,) = re.findall(r'`pip install "torch<([\d.]+)" --index-url', page("docs/installing.md"))
    allowed = re.findall(r'"torch>=[\d.]+,<([\d.]+);', page("pyproject.toml"))
    assert bound == min(allowed, key=Version)


def test_every_package_of_the_docs_extra_has_its_reason():
    (extra,) = re.findall(r"^docs = \[(.*)\]", page("pyproject.toml"), re.MULTILINE)
    (reasons,) = re.findall(r"^- `docs`: (.*?)^- ", page("docs/dependencies.md"), re.DOTALL | re.MULTILINE)
    for package in re.findall(r'"([\w-]+)', extra):
        assert package in reasons


def test_the_first_two_commands_of_the_readme_are_make_demo_and_make_test():
    (block,) = re.findall(r"```sh\n(.*?)```", page("README.md"), re.DOTALL)
    assert [line.partition("#")[0].strip() for line in block.splitlines()] == ["make demo", "make test"]
    assert page("README.md").count("<!-- table:") == 1
    assert len(page("README.md").splitlines()) < 70


def test_the_gallery_has_every_picture():
    shown = {*re.findall(r"\]\(images/([^)]+)\)", page("docs/gallery.md"))}
    assert shown == {path.name for path in (ROOT / "docs" / "images").iterdir()}
