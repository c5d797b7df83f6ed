"""Does ``swimmer-mj validate`` catch an error in one of the statements of the physics?

    python benchmarks/planted_errors.py [--json FILE] [NUMBER ...]

A sign, a factor of 2 and an index are spoilt, one at a time, in the source text of each statement, in a copy of the
package in a temporary directory; ``swimmer-mj validate --json`` then runs on the copy. Printed are its exit status, how
many checks failed, and the pairs of statements whose accelerations disagree: those with the spoilt one among them,
and no other. An error that spoils no statement, the friction on models that do not declare it, must fail the check of
other models and nothing else. Exit status 1 if a planted error is not caught so.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class PlantedError:
    """One edit of one source file."""

    statement: str
    kind: str
    file: str
    right: str
    wrong: str
    only: str = ""
    """The one check that fails; of an error in a statement, many do."""

    def plant(self, source: str) -> str:
        """The spoilt source text."""
        if source.count(self.right) != 1:
            raise ValueError(f"{self.file} has {source.count(self.right)} times, not once: {self.right}")
        return source.replace(self.right, self.wrong)


PLANTED_ERRORS = [
    PlantedError("A.3", *rest)
    for rest in (
        ("sign", "analytic.py", "f[..., -1] -= F[..., i, :]", "f[..., -1] += F[..., i, :]"),
        (
            "factor 2",
            "analytic.py",
            "-k * angular_velocities * lengths**3 / 12",
            "-k * angular_velocities * lengths**3 / 6",
        ),
        ("index", "analytic.py", "T[3 + joints, joints] = -1.0", "T[2 + n - 1 - joints, joints] = -1.0"),
    )
]
PLANTED_ERRORS += [
    PlantedError("MuJoCo + callback", *rest)
    for rest in (
        ("sign", "viscous.py", "spin = -k * l**3 / 12", "spin = k * l**3 / 12"),
        ("factor 2", "viscous.py", "2 * site.size[1]", "site.size[1]"),
        ("index", "viscous.py", "tx, ty, tz = site.axes[2]", "tx, ty, tz = site.axes[1]"),
    )
]
PLANTED_ERRORS += [
    PlantedError("MuJoCo + actuators", *rest)
    for rest in (
        ("sign", "mjcf.py", "biasprm=_numbers(0, 0, -coefficient)", "biasprm=_numbers(0, 0, coefficient)"),
        ("factor 2", "mjcf.py", '("drag", "0 1 0 0 0 0", k * l)', '("drag", "0 1 0 0 0 0", k * l / 2)'),
        (
            "index",
            "mjcf.py",
            'site=f"rod_{i}",\n                gear=gear',
            'site=f"rod_{max(1, i - 1)}",\n                gear=gear',
        ),
    )
]
PLANTED_ERRORS += [
    PlantedError(
        "MuJoCo + callback",
        "name",
        "passive/evaluation.py",
        "return c == n",
        "return True",
        only="another model beside a swimmer: change of its state",
    )
]


def caught(error: PlantedError, failed: list[str], pairs: list[str]) -> bool:
    """Whether the failed checks, and the ``pairs`` of statements that disagree, are those of ``error``."""
    if error.only:
        return failed == [error.only]
    return len(pairs) == 3 and all(error.statement in pair.split(" and ") for pair in pairs)


def validate(error: PlantedError) -> tuple[int, dict[str, object]]:
    """Run the report on a copy of the package with ``error`` in it; exit status and JSON."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "swimmer_mj"
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "swimmer_mj", package, ignore=ignore)
        shutil.copytree(ROOT / "models", package / "models", ignore=ignore)
        source = package / error.file
        source.write_text(error.plant(source.read_text(encoding="utf-8")), encoding="utf-8")
        where = "import swimmer_mj, sys; sys.stdout.write(swimmer_mj.__file__)"
        environment = {**os.environ, "PYTHONPATH": folder}
        found = subprocess.run(
            [sys.executable, "-c", where],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
        if Path(found.stdout).parent.resolve() != package.resolve():
            raise RuntimeError(f"not the copy was imported but {found.stdout}")
        command = [sys.executable, "-m", "swimmer_mj", "validate", "--json"]
        run = subprocess.run(
            command, env=environment, cwd=folder, capture_output=True, text=True, check=False
        )
        if run.returncode not in (0, 1):
            raise RuntimeError(run.stderr)
        return run.returncode, json.loads(run.stdout)


def main() -> int:
    """Print the table; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="also write the results to this file")
    parser.add_argument("numbers", nargs="*", type=int, help="which errors, from 0; all by default")
    arguments = parser.parse_args()
    results, all_caught = [], True
    for number in arguments.numbers or range(len(PLANTED_ERRORS)):
        error = PLANTED_ERRORS[number]
        status, report = validate(error)
        checks = report["checks"]
        assert isinstance(checks, list)
        failed = [check["name"] for check in checks if not check["passed"]]
        kinds = ("accelerations: ", "control matrices: ")
        pairs = sorted({name.split(": ")[1] for name in failed if name.startswith(kinds)})
        singled_out = caught(error, failed, pairs)
        all_caught &= status == 1 and singled_out
        print(
            f"{number}. {error.statement}, {error.kind}: {error.right}  ->  {error.wrong}".replace("\n", " ")
        )
        print(
            f"   exit status {status}, {len(failed)} of {len(checks)} checks failed; apart: {'; '.join(pairs)}"
        )
        results.append({**asdict(error), "status": status, "failed": failed, "singled_out": singled_out})
    print(
        "every planted error caught and singled out" if all_caught else "NOT every planted error was caught"
    )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0 if all_caught else 1


if __name__ == "__main__":
    sys.exit(main())
