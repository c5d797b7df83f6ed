"""What ``make docs`` and ``make release`` are made of, short of running them."""

import importlib.util
import re
import shutil
import subprocess
import sys
import zlib
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted(path for path in (ROOT / "docs" / "notebooks").glob("*.md") if path.name != "index.md")


def loaded(path):
    """A Python file outside the package, as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


check_site = loaded(ROOT / "tools" / "check_site.py")
licences = loaded(ROOT / "tools" / "licences.py")
matrix = loaded(ROOT / "tools" / "matrix.py")
release = loaded(ROOT / "tools" / "release.py")


@pytest.fixture
def conf(monkeypatch):
    """Sphinx's configuration, which sets MUJOCO_GL unless it is set."""
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    return loaded(ROOT / "docs" / "conf.py")


# Notebooks
def cells(path):
    return re.findall(r"```\{code-cell\} ipython3\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)


def test_there_are_five_notebooks_and_each_opens_on_a_bare_python():
    """Jupytext and myst-nb know them by their first lines; one cell installs; all install alike."""
    assert len(NOTEBOOKS) == 5
    assert len({path.read_text(encoding="utf-8").partition("\n# ")[0] for path in NOTEBOOKS}) == 1
    assert len({cells(path)[0] for path in NOTEBOOKS}) == 1
    assert "%pip install --quiet {source}" in cells(NOTEBOOKS[0])[0]
    for path in NOTEBOOKS:
        assert path.read_text(encoding="utf-8").count("%pip") == 1
        assert "[here](index.md)" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_asserts_what_it_claims_and_labels_its_axes(path):
    assert sum("assert " in cell for cell in cells(path)) >= 1
    for cell in cells(path):
        if "plt.subplots" in cell:
            assert "label=" in cell, cell


# Docstrings
def test_indented_blocks_of_docstrings_are_code_and_bars_are_bars(conf):
    text = [
        "Of |x|.", "", "    dw/dt = |eta| H e", "    de/dt = 0", "", "As ``|u|`` says.", "",
        "- an item", "", "    that goes on", "", "Parameters", "----------", "x : ndarray, |x| < 1", "    m.",
    ]  # fmt: skip
    assert conf.as_read(text) == [
        r"Of \|x\|.", "", "::", "", "    dw/dt = |eta| H e", "    de/dt = 0", "", "As ``|u|`` says.", "",
        "- an item", "", "    that goes on", "", "Parameters", "----------", r"x : ndarray, \|x\| < 1", "    m.",
    ]  # fmt: skip


def test_a_change_of_the_code_runs_the_notebooks_again(conf):
    assert ROOT / "swimmer_mj" / "analytic.py" in conf.SOURCES
    assert ROOT / "learning" / "experiments" / "logs" / "swim5.csv" in conf.SOURCES
    assert conf.nb_execution_cache_path.endswith(conf.CODE)
    assert conf.nb_execution_raise_on_error


# What check_site.py finds
def inventory(names):
    lines = "".join(f"{name} py:function 1 docs/api/swimmer.html#$ -\n" for name in names)
    head = b"# Sphinx inventory version 2\n# Project: p\n# Version: 1\n# The remainder is compressed.\n"
    return head + zlib.compress(lines.encode())


def test_names_that_the_reference_lacks_are_found():
    modules = ["swimmer_mj.integrators", "swimmer_mj.passive"]
    names = check_site.documented(inventory(["swimmer_mj.integrators.rk4_step", "swimmer_mj.passive.law"]))
    missing = check_site.missing_names(modules, names)
    assert "swimmer_mj.integrators.euler_step" in missing
    assert "swimmer_mj.passive.Law" in missing
    assert not {"swimmer_mj.integrators.rk4_step", "swimmer_mj.passive.law"} & {*missing}


def test_a_name_may_be_documented_where_it_is_listed_first_or_again(suite):
    modules = ["swimmer_mj.parameters", "swimmer_mj"]
    for name in ("swimmer_mj.PAPER", "swimmer_mj.parameters.PAPER"):
        assert not [one for one in check_site.missing_names(modules, {name}) if "PAPER" in one]


def test_the_contract_is_public(suite):
    """What others rely on is not taken for internal."""
    modules = {*check_site.public_modules()}
    assert modules >= {
        "swimmer_mj", "swimmer_mj.analytic", "swimmer_mj.dynamics", "swimmer_mj.passive", "swimmer_mj.viscous",
        "swimmer_mj.environments.suite", "swimmer_mj.gymnasium", "swimmer_mj.learning", "swimmer_mj.learning.method",
        "swimmer_mj.learning.problems.mujoco", "swimmer_mj.learning.runs.run", "swimmer_mj.render.page.assemble",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("html", "count"),
    [
        ('<script src="https://cdn.example/x.js"></script>', 1),
        ("<img src='//example/x.png'>", 1),
        ('<link href="https://example/x.css" rel="stylesheet">', 1),
        ('<link rel="stylesheet" href="../_static/x.css"><script src="a.js"></script>', 0),
        ('<a href="https://www.sphinx-doc.org">Sphinx</a><link rel="search" href="search.html">', 0),
    ],
)
def test_what_is_loaded_from_the_network_is_found(html, count):
    assert len(check_site.loaded_elsewhere(html)) == count


# Licences
def test_licences_are_those_of_the_installed_packages(suite):
    """If not: python tools/licences.py. Other machines may have packages that this one lacks."""
    pins = [one for one in map(Requirement, matrix.lowest()) if one.marker is None]
    if all(one.specifier.contains(distribution(one.name).version) for one in pins):
        pytest.skip("these are the lowest versions, some of which word their licences otherwise")
    lines = {*licences.PAGE.read_text(encoding="utf-8").splitlines(keepends=True)}
    assert {*licences.rows()} <= lines
    assert len(licences.rows()) > 40


def test_all_that_is_imported_is_among_them(suite):
    needed = licences.needed()
    assert needed >= {"mujoco", "dm-control", "torch", "numba", "llvmlite", "sympy", "imageio-ffmpeg"}
    assert not needed & {"pytest", "gymnasium", "sphinx", "stable-baselines3"}


def test_a_licence_is_read_from_what_a_package_says(tmp_path):
    folder = tmp_path / "thing-1.dist-info"
    folder.mkdir()
    package = type(distribution("numpy"))(folder)
    for said, expected in (
        ("License-Expression: MIT", "MIT"),
        ("Classifier: License :: OSI Approved :: BSD License", "BSD"),
        ("License: Apache License 2.0", "Apache-2.0"),
    ):
        (folder / "METADATA").write_text(f"Metadata-Version: 2.4\nName: thing\nVersion: 1\n{said}\n")
        assert licences.licence(package) == expected
    (folder / "METADATA").write_text("Metadata-Version: 2.4\nName: thing\nVersion: 1\n")
    with pytest.raises(ValueError, match="thing 1 name no licence"):
        licences.licence(package)


# Releases
@pytest.fixture
def root(tmp_path):
    """A copy of what a release's number and notes come from."""
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def test_the_version_is_in_pyproject_the_citation_and_the_changelog():
    number = release.version()
    assert release.changes(number).startswith("### Added")
    assert "\n## [" not in release.changes(number)


def test_a_version_that_is_not_everywhere_is_refused(root):
    number = release.version(root)
    text = (root / "pyproject.toml").read_text(encoding="utf-8")
    (root / "pyproject.toml").write_text(text.replace(f'version = "{number}"', 'version = "9.9.9"'))
    with pytest.raises(ValueError, match=r"CITATION\.cff must have the line 'version: 9\.9\.9'"):
        release.version(root)
    with pytest.raises(ValueError, match=r"must have a section '## \[9.9.9\] - DATE'"):
        release.changes("9.9.9", root)
    (root / "CHANGELOG.md").write_text(
        "# Changelog\n\n## [9.9.9] - 2030-01-01\n\n## [0.1.0] - Unreleased\n\n- x\n"
    )
    with pytest.raises(ValueError, match="that says what has changed"):
        release.changes("9.9.9", root)
    assert release.changes("0.1.0", root) == "- x"


def test_notes_have_the_changes_and_the_sums_of_the_files(tmp_path):
    file = tmp_path / "swimmer_mj-0.1.0.tar.gz"
    file.write_bytes(b"abc")
    text = release.notes(release.version(), [file])
    assert release.changes(release.version()) in text
    assert f"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  {file.name}" in text


def test_a_command_that_fails_is_told_in_one_line(tmp_path):
    with pytest.raises(RuntimeError, match="ended with status 3: no") as failure:
        release.run(["sh", "-c", "echo no >&2; exit 3"], tmp_path)
    assert str(failure.value).count("\n") == 0


def test_the_lowest_versions_are_those_of_the_metadata():
    pins = {(one.name, str(one.marker)): one.specifier for one in map(Requirement, matrix.lowest())}
    found = 0
    for text in distribution("swimmer-mj").requires:
        one = Requirement(text)
        if one.marker is None or "extra" not in str(one.marker):
            (least,) = (part.version for part in one.specifier if part.operator == ">=")
            assert str(pins[one.name, str(one.marker)]) == f"=={least}"
            found += 1
    assert 12 < found < len(pins)


def test_the_matrix_counts_tests_as_pytest_does(tmp_path):
    (tmp_path / "test_it.py").write_text(
        "import pytest\ndef test_passes(): pass\ndef test_fails(): assert False\n"
        "@pytest.fixture\ndef broken(): raise ValueError\ndef test_errs(broken): pass\n"
        "@pytest.mark.skip\ndef test_skips(): pass\n@pytest.mark.skip\ndef test_skips_too(): pass\n"
    )
    report = tmp_path / "report.xml"
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        f"--junitxml={report}",
        tmp_path,
    ]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True).returncode == 1
    assert matrix.counts(report) == {"passed": 1, "failed": 2, "skipped": 2}
