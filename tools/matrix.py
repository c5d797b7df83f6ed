"""Run the tests in an environment of its own, and add a row to the table of platforms.

    python tools/matrix.py --python python3.13 --pins mujoco==3.17.0 -- tests/swimmer_mj

makes a virtual environment, installs this checkout into it with the newest versions of its dependencies but for those
that are pinned, or with the lowest that pyproject.toml allows, runs pytest with the arguments behind ``--``, and
appends what came of it to ``benchmarks/results/platforms.csv``, from which the table of docs/platforms.md is.
``--environment DIR`` keeps the environment in DIR; one that is there already keeps its dependencies. The exit status is
pytest's. tools/debian.sh runs this in another Debian, or on another processor.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import json
import re
import subprocess
import sys
import tempfile
import time
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "benchmarks" / "results" / "platforms.csv"
PACKAGES = ("swimmer-mj", "mujoco", "dm-control", "numpy", "torch", "numba")
EXTRAS = ("gymnasium", "peers", "cluster", "tensorboard", "gaits")
"""Those that a user may want; what develops and documents the package is always the newest."""
UV = ("-m", "uv", "pip", "install")
COLUMNS = (
    "date", "system", "processor", "python", *PACKAGES, "dependencies", "tests", "passed", "failed", "skipped",
    "seconds",
)  # fmt: skip

_ASK = """
import json, platform
from importlib.metadata import PackageNotFoundError, version
def found(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"
try:
    system = platform.freedesktop_os_release()["PRETTY_NAME"]
except (OSError, KeyError):
    system = platform.platform(terse=True)
print(json.dumps({"system": system, "processor": platform.machine(), "python": platform.python_version(),
                  **{package: found(package) for package in PACKAGES}}))
"""


def lowest(root: Path = ROOT) -> list[str]:
    """The dependencies of pyproject.toml and of the extras that are used, each at its lower bound.

    Those of other Pythons keep their markers, so that pip leaves them out.
    """
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = list(project["dependencies"])
    for extra in EXTRAS:
        wanted += [one for one in project["optional-dependencies"][extra] if not one.startswith("swimmer-mj")]
    pinned = (re.sub(r">=([\d.]+)(,<[\d.]+)?", r"==\1", requirement) for requirement in wanted)
    return [one.replace("[ffmpeg]", "") for one in pinned]  # constraints have no extras


def make(environment: Path, python: str, pins: list[str]) -> None:
    """Install this checkout, and what its tests need, into a new environment; by uv, which is quick at it."""
    subprocess.run([python, "-m", "venv", str(environment)], check=True)
    own = str(program(environment))
    subprocess.run([own, "-m", "pip", "install", "--quiet", "uv"], check=True)
    with tempfile.TemporaryDirectory() as folder:
        constraints = Path(folder) / "constraints.txt"
        constraints.write_text("\n".join(pins) + "\n", encoding="utf-8")
        install(own, "--constraint", str(constraints), "-e", f"{ROOT}[dev]")


def install(python: str, *arguments: str) -> None:
    """By the uv of an environment, into it."""
    subprocess.run([python, *UV, "--quiet", "--python", python, *arguments], check=True)


def program(environment: Path) -> Path:
    """The interpreter of a virtual environment."""
    return environment / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def counts(report: Path) -> dict[str, int]:
    """Passed, failed and skipped tests of pytest's JUnit report."""
    suite = ET.parse(report).getroot().find("testsuite")
    if suite is None:
        raise ValueError(f"{report} has no testsuite")
    total, failed, errors, skipped = (
        int(suite.get(name, 0)) for name in ("tests", "failures", "errors", "skipped")
    )
    return {"passed": total - failed - errors - skipped, "failed": failed + errors, "skipped": skipped}


def run(environment: Path, arguments: list[str], dependencies: str) -> int:
    """Run pytest, and append a row to the table; returns pytest's exit status."""
    python = str(program(environment))
    ask = _ASK.replace("in PACKAGES", f"in {PACKAGES}")
    facts = json.loads(subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout)
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        started = time.perf_counter()
        done = subprocess.run([python, "-m", "pytest", "-q", f"--junitxml={report}", *arguments], cwd=ROOT)
        seconds = round(time.perf_counter() - started)
        row = {
            "date": datetime.date.today().isoformat(),
            **facts,
            "dependencies": dependencies,
            "tests": " ".join(a for a in arguments if a.startswith("tests")) or "all",
            **counts(report),
            "seconds": seconds,
        }
    new = not TABLE.exists()
    with TABLE.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)
    return done.returncode


def main() -> int:
    """Make an environment or take one, and run the tests in it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--python", default=sys.executable, help="the interpreter to make the environment with"
    )
    parser.add_argument("--dependencies", choices=("lowest", "newest"), default="newest")
    parser.add_argument("--pins", nargs="*", default=[], help="as mujoco==3.17.0")
    parser.add_argument("--environment", type=Path, help="where to keep it; taken as it is if it is there")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest, behind --")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        environment = (arguments.environment or Path(folder) / "venv").absolute()
        if not environment.exists():
            pins = lowest() if arguments.dependencies == "lowest" else []
            make(environment, arguments.python, [*arguments.pins, *pins])
        install(str(program(environment)), "--no-deps", "-e", str(ROOT))  # of this checkout, as it is now
        return run(environment, arguments.pytest, arguments.dependencies)


if __name__ == "__main__":
    sys.exit(main())
