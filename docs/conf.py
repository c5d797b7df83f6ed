"""Sphinx's configuration of the site, which ``make docs`` builds into ``build/site``.

Sphinx's source directory is the root of the repository: relative links lead to the same files here and on a Git host.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import io
import logging
import os
import re
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes

os.environ.setdefault("MUJOCO_GL", "disabled")  # nothing here draws by OpenGL
logging.getLogger("absl").setLevel(logging.WARNING)  # dm_control says which OpenGL it takes

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = PROJECT["name"]
release = PROJECT["version"]
author = "The swimmer-mj developers"
copyright = f"{author}; {PROJECT['license']}"

root_doc = "docs/index"
include_patterns = ["docs/**", "CHANGELOG.md", "CONTRIBUTING.md", "models/README.md"]
exclude_patterns = [".*", "build", "dist", "runs", "**/__pycache__"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
highlight_language = "none"

# Pages
html_theme = "furo"
html_title = f"swimmer-mj {release}"
html_static_path = ["site"]
html_css_files = ["site.css"]
html_extra_path = ["site/index.html"]  # at the top: leads to docs/index.html
html_copy_source = False
html_show_sphinx = False
myst_heading_anchors = 3

# Notebooks: executed where they, or the code that they run, are not as they are in the cache
SOURCES = sorted(
    path
    for folder in ("models", "swimmer_mj", "learning", "render")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".py", ".xml", ".csv", ".js", ".safetensors"}
)
CODE = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:16]
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "notebooks" / CODE)
nb_execution_in_temp = True
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

# The API reference
napoleon_google_docstring = False
napoleon_use_param = False  # what kind of array it is, in words: no names to be looked up
napoleon_use_rtype = False
autodoc_default_options = {"members": True, "undoc-members": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autodoc_type_aliases = {"Array": "Array"}
python_use_unqualified_type_names = True
toc_object_entries = False
ARRAY = re.compile(r"TypeAliasForwardRef\('Array'\)|ndarray\[tuple\[Any, \.\.\.\], dtype\[float64\]\]")


def write_swim_page(app: Any, exception: Exception | None) -> None:
    """The page of the first screen, by the command that users have."""
    if exception is None and app.builder.format == "html":
        from swimmer_mj.cli import main

        out = Path(app.outdir) / "docs" / "swim.html"
        with contextlib.redirect_stdout(io.StringIO()):
            status = main(["page", "swim5-value-gradient", "--out", str(out)])
        if status != 0:
            raise RuntimeError(f"swimmer-mj page did not write {out}")


def docstring(_app: Any, what: str, _name: str, obj: Any, _options: Any, lines: list[str]) -> None:
    """Docstrings as they are read in the source."""
    if what == "data" and "\n".join(lines).strip() == inspect.cleandoc(obj.__doc__ or ""):
        lines.clear()  # of the class, a tuple's for instance
    lines[:] = as_read(lines)
    if what in {"attribute", "data", "property"}:
        lines[:1] = [f": {line}" for line in lines[:1]]  # there is no type before a colon


def as_read(lines: list[str]) -> list[str]:
    """reStructuredText in which a block that is indented after a blank line is code, and |x| a norm."""
    found: list[str] = []
    code, sections = False, False
    for line, after in zip(lines, [*lines, ""][1:], strict=True):
        sections = sections or bool(re.fullmatch(r"-{3,}", after))  # Parameters, Returns, ...
        indented = line.startswith("    ") and not sections
        if indented and not code and found and not found[-1] and not _introduces(found):
            found += ["::", ""]
        code = indented if line else code
        found.append(line if code else re.sub(r"(``.*?``)|\|", lambda match: match[1] or r"\|", line))
    return found


def _introduces(lines: list[str]) -> bool:
    """Whether what is indented below ``lines`` is code already, or goes on with an item of a list."""
    last = next(line for line in reversed(lines) if line)
    return last.endswith("::") or bool(re.match(r" *([-*]|\d+\.|\.\.) ", last))


def short_arrays(_app: Any, doctree: nodes.document, _docname: str) -> None:
    """Signatures say Array, as the source does."""
    for kind in (addnodes.desc_annotation, addnodes.desc_parameter, addnodes.desc_returns):
        for node in doctree.findall(kind):
            text = "".join(child.astext() for child in node.children)
            if (short := ARRAY.sub("Array", text)) != text:
                node.clear()
                node += nodes.Text(short)


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", docstring, priority=100)  # napoleon is at 500
    app.connect("doctree-resolved", short_arrays)
    app.connect("build-finished", write_swim_page)
