"""The licences of what this package is installed with, from the metadata of the installed packages.

    python tools/licences.py          # write docs/licences.md
    python tools/licences.py --check  # only say whether it is as the metadata says; exit status 1 if not

Listed are the packages that ``pip install .`` brings, and those that they bring in their turn. What differs between
machines is left out: versions, and the packages of NVIDIA's that torch's CUDA build adds.
"""

from __future__ import annotations

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import tyro
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from swimmer_mj.files import replacing

PAGE = Path(__file__).parents[1] / "docs" / "licences.md"
START, END = "<!-- licences -->\n", "<!-- end of licences -->"
OF_CUDA = re.compile(r"nvidia-|cuda-|triton$")
CLASSIFIER = "License :: OSI Approved :: "
NAMES = {
    "Apache Software License": "Apache-2.0",
    "Apache 2.0": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "BSD License": "BSD",
    "BSD": "BSD",
    "3-Clause BSD License": "BSD",
    "BSD-2-Clause": "BSD",
    "BSD-3-Clause": "BSD",
    "MIT License": "MIT",
    "MIT": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "The Unlicense (Unlicense)": "Unlicense",
    "Unlicense": "Unlicense",
}
"""How a licence is called here, by what metadata call it; SPDX expressions stay as they are."""


def needed(name: str = "swimmer-mj") -> set[str]:
    """The packages that ``name`` brings, of those that are installed here."""
    found = set()
    todo = [(name, frozenset[str]())]
    done = set()
    while todo:
        package, extras = one = todo.pop()
        if one in done:
            continue
        done.add(one)
        for text in distribution(package).requires or []:
            requirement = Requirement(text)
            marker, child = requirement.marker, canonicalize_name(requirement.name)
            wanted = marker is None or any(
                marker.evaluate({**default_environment(), "extra": extra}) for extra in ("", *extras)
            )
            if wanted and not OF_CUDA.match(child) and _installed(child):
                found.add(child)
                todo.append((child, frozenset(requirement.extras)))
    return found


def _installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def licence(package: Distribution) -> str:
    """What the metadata say, from the most exact to the least."""
    metadata = package.metadata
    if expression := metadata.get("License-Expression"):
        return NAMES.get(expression, expression)
    if named := [
        line[len(CLASSIFIER) :] for line in metadata.get_all("Classifier", []) if line.startswith(CLASSIFIER)
    ]:
        return ", ".join(NAMES.get(one, one) for one in named)
    text = (metadata.get("License") or "").strip().splitlines()
    if text and len(text[0]) < 60:
        return NAMES.get(text[0], text[0])
    raise ValueError(f"the metadata of {package.name} {package.version} name no licence")


def rows() -> list[str]:
    """A line of Markdown for each package that is installed here."""
    return [f"| {name} | {licence(distribution(name))} |\n" for name in sorted(needed())]


def with_table(text: str) -> str:
    """The text of the page with its table as the metadata have it."""
    before, start, rest = text.partition(START)
    _, end, after = rest.partition(END)
    if not (start and end):
        raise ValueError(f"{PAGE} must have the lines {START.strip()} and {END}")
    head = "| package | licence |\n| --- | --- |\n"
    return f"{before}{start}\n{head}{''.join(rows())}\n{end}{after}"


def main(check: bool = False) -> None:
    """Write the table.

    Args:
        check: Write nothing; say whether the page differs, and exit with 1 if it does.
    """
    text = PAGE.read_text(encoding="utf-8")
    new = with_table(text)
    if new == text:
        return
    print(f"{'not as the metadata say' if check else 'written'}: {PAGE}")
    if check:
        raise SystemExit(1)
    with replacing(PAGE) as partial:
        partial.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
