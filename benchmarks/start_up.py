"""How long do Python, ``import swimmer_mj`` and ``swimmer-mj --help`` take, and how much disk has the package?

    python benchmarks/start_up.py

Each in a process of its own, in turns, 20 times; medians of wall time, on a machine that should be idle.
Prints a table and writes benchmarks/results/start-up.json.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from importlib.metadata import version
from pathlib import Path

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made

ROOT = Path(__file__).parents[1]
OUT = ROOT / "benchmarks" / "results" / "start-up.json"
TIMES = 20
COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "python -c 'import swimmer_mj'": ["-c", "import swimmer_mj"],
    "swimmer-mj --help": ["-m", "swimmer_mj", "--help"],
}


def seconds(arguments: list[str]) -> float:
    """Wall time of Python with ``arguments``, s."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.perf_counter() - start


def installed_bytes() -> int:
    """Of our own part, as the wheel unpacks it."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "build", "--wheel", "--outdir", folder, str(ROOT)]
        subprocess.run(command, check=True, capture_output=True)
        (wheel,) = Path(folder).iterdir()
        with zipfile.ZipFile(wheel) as archive:
            return sum(file.file_size for file in archive.infolist())


def main() -> None:
    """Measure, print, write."""
    for arguments in COMMANDS.values():
        seconds(arguments)  # from disk
    times = {name: [] for name in COMMANDS}
    for _ in range(TIMES):
        for name, arguments in COMMANDS.items():
            times[name].append(seconds(arguments))
    found = {
        "version": version("swimmer-mj"),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),
        "times": TIMES,
        "seconds": {name: round(statistics.median(of), 4) for name, of in times.items()},
        "installed_bytes": installed_bytes(),
    }
    for name, value in found["seconds"].items():
        print(f"{name:32} {1000 * value:6.0f} ms")
    print(f"installed: {found['installed_bytes'] / 1e6:.1f} MB")
    with replacing(OUT) as path:
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    note_made(OUT)


if __name__ == "__main__":
    main()
