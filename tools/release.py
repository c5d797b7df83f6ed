"""Build a release, check it, and write its notes: ``make release``.

    python tools/release.py

1. The version of pyproject.toml is that of CITATION.cff, and CHANGELOG.md has a section of it.
2. ``dist/`` gets the sdist, and the wheel that is built from the sdist.
3. Each is installed into a fresh environment outside the checkout, and used there: the checks of the physics, and the
   browser page of a pretrained policy.
4. ``dist/release-notes.md`` gets the section of the changelog, and the files with their SHA-256.

It publishes nothing.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

from swimmer_mj.files import replacing

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
NOTES = "release-notes.md"


def version(root: Path = ROOT) -> str:
    """The version, which pyproject.toml has; CITATION.cff must have the same.

    Raises
    ------
    ValueError
        It has another one.
    """
    number = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    cited = re.search(r"^version: (.*)$", (root / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    if cited is None or cited[1] != number:
        raise ValueError(f"CITATION.cff must have the line 'version: {number}', as pyproject.toml has it")
    return number


def changes(number: str, root: Path = ROOT) -> str:
    """The section of a version in CHANGELOG.md, without its heading.

    Raises
    ------
    ValueError
        There is none, or it is empty.
    """
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = re.search(
        rf"^## \[{re.escape(number)}\][^\n]*\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL
    )
    if section is None or not section[1].strip():
        raise ValueError(
            f"CHANGELOG.md must have a section '## [{number}] - DATE' that says what has changed"
        )
    return section[1].strip()


def notes(number: str, files: list[Path], root: Path = ROOT) -> str:
    """What a release is announced with."""
    sums = "".join(f"    {hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files)
    return f"# swimmer-mj {number}\n\n{changes(number, root)}\n\n## Files\n\nSHA-256:\n\n{sums}"


def build() -> list[Path]:
    """The sdist and the wheel made of it, in an empty ``dist/``."""
    shutil.rmtree(DIST, ignore_errors=True)
    run([sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT)])
    return sorted(DIST.iterdir())


def check(file: Path, folder: Path) -> None:
    """Install ``file`` into a fresh environment in ``folder``, and use it there."""
    venv.create(folder / "venv", with_pip=True)
    python, program = (str(folder / "venv" / "bin" / name) for name in ("python", "swimmer-mj"))
    run([python, "-m", "pip", "install", "--quiet", str(file)], folder)
    where = run(
        [python, "-c", "import swimmer_mj; print(swimmer_mj.__file__, swimmer_mj.__version__)"], folder
    )
    if str(folder) not in where or where.split()[-1] != version():
        raise RuntimeError(f"{file.name} was not imported from its environment: {where.strip()}")
    run([program, "validate", "--json"], folder)
    run([program, "info", "--json"], folder)
    made = json.loads(run([program, "page", "swim5-value-gradient", "--out", "swim.html", "--json"], folder))
    if (folder / "swim.html").stat().st_size != made["bytes"]:
        raise RuntimeError(f"{file.name}: swim.html has not the {made['bytes']:,} bytes that were written")
    print(f"{file.name}: checked in a fresh environment; swim.html has {made['bytes']:,} bytes")


def run(command: list[str], folder: Path = ROOT) -> str:
    """What a command prints on standard output; RuntimeError with its last line if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip() or done.stdout.strip() or "it says nothing").splitlines()[-1]
        raise RuntimeError(f"{' '.join(command)} ended with status {done.returncode}: {last}")
    return done.stdout


def main() -> None:
    """Do all of it."""
    number = version()
    changes(number)  # before anything is built
    files = build()
    for file in files:
        with tempfile.TemporaryDirectory() as folder:
            check(file, Path(folder).resolve())
    with replacing(DIST / NOTES) as partial:
        partial.write_text(notes(number, files), encoding="utf-8")
    print(f"swimmer-mj {number}: {', '.join(file.name for file in files)} and {NOTES} are in {DIST}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, RuntimeError) as error:
        raise SystemExit(f"release: {error}") from None
