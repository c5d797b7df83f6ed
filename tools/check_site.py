"""What Sphinx does not see of a site that it has built; ``make docs`` runs it.

    python tools/check_site.py build/site

- The API reference has every public name: all that a module lists in ``__all__``, but for the modules that only serve
  others from within (:data:`INTERNAL`).
- The first page shows the browser page, which is there.
- No page loads anything from the network.
"""

from __future__ import annotations

import re
import sys
import tomllib
import zlib
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[1]

INTERNAL = (
    "swimmer_mj.cli",
    "swimmer_mj.compiled",
    "swimmer_mj.environments.gymnasium",  # swimmer_mj.gymnasium has its name
    "swimmer_mj.files",
    "swimmer_mj.libraries",
    "swimmer_mj.learning.experiments.",
    "swimmer_mj.learning.networks.actors",
    "swimmer_mj.learning.networks.batched",
    "swimmer_mj.learning.networks.layered",
    "swimmer_mj.learning.problems.mujoco.",
    "swimmer_mj.learning.problems.pendulum.",
    "swimmer_mj.learning.problems.cart_pole.",
    "swimmer_mj.learning.problems.swim.",
    "swimmer_mj.learning.td.fused_kernel",
    "swimmer_mj.learning.td.greedy",
    "swimmer_mj.learning.td.linear_kernel",
    "swimmer_mj.learning.td.population_kernel",
    "swimmer_mj.learning.value_gradient.engines",
    "swimmer_mj.passive.",
    "swimmer_mj.render.bands",
    "swimmer_mj.render.chain",
    "swimmer_mj.render.at_length",
    "swimmer_mj.render.long_runs",
    "swimmer_mj.render.overlay",
    "swimmer_mj.render.second_order",
    "swimmer_mj.render.strokes",
    "swimmer_mj.render.value_gradients",
    "swimmer_mj.validation.",
)
"""Beginnings of names. What is documented all the same is welcome."""
LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*\bsrc=["'](https?:)?//[^>]*>"""
    r"""|<link\b(?=[^>]*\brel=["'](?:stylesheet|icon|preload|modulepreload)["'])[^>]*\bhref=["'](https?:)?//[^>]*>"""
)
"""Elements that a browser fetches from elsewhere; links that one may follow are no such thing."""


def modules() -> Iterator[str]:
    """All modules of the package. Its folders stand side by side in the repository, as pyproject.toml says."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    places = setup["package-dir"]
    for package in setup["packages"]:
        folder = ROOT / places.get(package, package.replace(".", "/"))
        yield package
        yield from (f"{package}.{path.stem}" for path in sorted(folder.glob("[!_]*.py")))


def public_modules() -> Iterator[str]:
    """Those with an ``__all__``, but for internal ones."""
    for name in modules():
        if not name.startswith(INTERNAL) and hasattr(import_module(name), "__all__"):
            yield name


def documented(inventory: bytes) -> set[str]:
    """The names of Python's domain in an ``objects.inv``."""
    body = zlib.decompress(inventory.split(b"\n", 4)[4]).decode()
    return set(re.findall(r"^(\S+) py:\w+ ", body, re.MULTILINE))


def missing_names(modules: Iterable[str], names: set[str]) -> list[str]:
    """Public names that are documented under none of the modules that list them."""
    homes: dict[int | str, list[str]] = {}
    for module in modules:
        for name in import_module(module).__all__:
            thing = getattr(import_module(module), name)
            plain = isinstance(thing, str | int | float)  # equal ones may be one object
            homes.setdefault(f"{module}.{name}" if plain else id(thing), []).append(f"{module}.{name}")
    return sorted(places[0] for places in homes.values() if not names & {*places})


def loaded_elsewhere(html: str) -> list[str]:
    """Elements of a page that are fetched from the network."""
    return [match[0] for match in LOADED.finditer(html)]


def problems(site: Path) -> list[str]:
    """All that is wrong, a line each."""
    found = [
        f"the API reference (docs/api) lacks {name}"
        for name in missing_names(public_modules(), documented((site / "objects.inv").read_bytes()))
    ]
    for page in sorted(site.rglob("*.html")):
        if page.name != "swim.html":  # it has scripts inside, and tests of its own
            text = page.read_text(encoding="utf-8")
            found += [
                f"{page.relative_to(site)} loads from the network: {one}" for one in loaded_elsewhere(text)
            ]
    first = (site / "docs" / "index.html").read_text(encoding="utf-8")
    if 'src="swim.html"' not in first or not (site / "docs" / "swim.html").is_file():
        found.append("docs/index.html does not show docs/swim.html")
    return found


if __name__ == "__main__":
    if wrong := problems(Path(sys.argv[1])):
        print("\n".join(wrong), file=sys.stderr)
        raise SystemExit(1)
