"""Compiled code on disk. A new process says what it computed, and how much of its code was there."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load_file

from swimmer_mj.cli import main

HELPER = "from numba import njit\n\nSTEP = {step}\n\n\n@njit\ndef helper(x):\n    return x + {shift} * STEP\n"
CALLED = """
from numba import njit
from {place}helper import helper


@njit
def called(x):
    return 2.0 * helper(x)
"""
KERNEL = """
from swimmer_mj.compiled.cache import entry_point
from {place}called import called


@entry_point(nogil=True)
def kernel(form, x):
    return called(x) + form.law(x)
"""
PROGRAM = """
import json
import sys

from numba import njit

from swimmer_mj.compiled.static import Static
from {place}kernel import kernel


def times(k):
    @njit
    def law(x):
        return k * x

    return law


found = [kernel(Static(law=times(k)), 1.0) for k in map(float, sys.argv[1:])]
stats = kernel.dispatcher.stats
print(json.dumps([found, sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""


class Outside:
    """A kernel, in modules side by side or in a package, and where its code is kept."""

    def __init__(self, folder, package):
        self.folder, self.place = folder, "pack." if package else ""
        self.sources = folder / "pack" if package else folder
        self.sources.mkdir(exist_ok=True)
        if package:
            (self.sources / "__init__.py").touch()
        self.cache = folder / "cache"
        self.write_helper()
        self._write(self.sources / "called.py", CALLED)
        self._write(self.sources / "kernel.py", KERNEL)
        self._write(folder / "program.py", PROGRAM)

    def _write(self, path, text):
        path.write_text(text.replace("{place}", self.place))

    def write_helper(self, shift=1.0, step=1.0):
        self._write(self.sources / "helper.py", HELPER.format(shift=shift, step=step))

    def start(self, *laws, cache=None, **environment):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache or self.cache), **environment}
        command = [sys.executable, "-B", "program.py", *map(str, laws)]
        pipe = subprocess.PIPE
        return subprocess.Popen(
            command, cwd=self.folder, env=environment, stdout=pipe, stderr=pipe, text=True
        )

    @staticmethod
    def end(process):
        out, err = process.communicate()
        assert process.returncode == 0, err
        return json.loads(out)

    def run(self, *laws, **options):
        """Results for laws k x at x = 1; how many of them were on disk, and how many were not."""
        return self.end(self.start(*laws, **options))

    def files(self):
        return sorted(self.cache.glob("*.code"))


@pytest.fixture
def outside(tmp_path):
    return Outside(tmp_path, package=False)


@pytest.mark.parametrize(("package", "edit"), [(False, {"shift": 2.0}), (True, {"step": 2.0})])
def test_an_edit_of_what_is_called_by_what_is_called_is_seen(tmp_path, package, edit):
    outside = Outside(tmp_path, package)
    assert outside.run(3) == [[7.0], 0, 1]
    outside.write_helper(**edit)
    assert outside.run(3) == [[9.0], 0, 1]
    (file,) = outside.files()
    written = file.stat().st_mtime_ns
    assert outside.run(3) == [[9.0], 1, 0]
    assert file.stat().st_mtime_ns == written


def test_what_is_called_as_an_attribute_of_a_module_is_seen(outside):
    """Also where the module only passes on what another one has."""
    outside._write(outside.sources / "between.py", "from helper import helper\n")
    outside._write(
        outside.sources / "called.py",
        CALLED.replace("from {place}helper import helper", "import between").replace(
            "helper(x)", "between.helper(x)"
        ),
    )
    assert outside.run(3) == [[7.0], 0, 1]
    outside.write_helper(shift=2.0)
    assert outside.run(3) == [[9.0], 0, 1]
    assert outside.run(3) == [[9.0], 1, 0]


def test_a_number_of_a_module_is_seen_as_it_is_when_compiled(outside):
    outside._write(
        outside.sources / "called.py",
        "import os\n\nimport helper\nfrom numba import njit\n\nhelper.STEP = float(os.environ['STEP'])\n\n\n"
        "@njit\ndef called(x):\n    return x + helper.STEP\n",
    )
    assert outside.run(3, STEP="1") == [[5.0], 0, 1]
    assert outside.run(3, STEP="2") == [[6.0], 0, 1]
    assert outside.run(3, STEP="2") == [[6.0], 1, 0]


def test_closures_of_one_name_are_told_apart(outside):
    """By what they close over: each is the first of its name in the process that compiles it."""
    assert outside.run(3) == [[7.0], 0, 1]
    assert outside.run(5) == [[9.0], 0, 1]
    assert outside.run(3, 5) == [[7.0, 9.0], 2, 0]


def test_processes_that_fill_it_at_once_do_no_harm(outside):
    together = [outside.start(3, 5) for _ in range(3)]
    assert [outside.end(process)[0] for process in together] == [[7.0, 9.0]] * 3
    assert len(list(outside.cache.iterdir())) == 2  # and nothing half written beside them
    assert outside.run(3, 5) == [[7.0, 9.0], 2, 0]


def test_a_damaged_file_is_replaced(outside):
    outside.run(3)
    (file,) = outside.files()
    whole = file.read_bytes()
    for damaged in (b"nonsense\nof two lines", whole[:-100]):
        file.write_bytes(damaged)
        assert outside.run(3) == [[7.0], 0, 1]
        assert len(file.read_bytes()) == len(whole)


def test_each_processor_has_its_own(outside):
    lesser = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert outside.run(3) == [[7.0], 0, 1]
    assert outside.run(3, **lesser) == [[7.0], 0, 1]
    assert outside.run(3) == [[7.0], 1, 0]
    assert len(outside.files()) == 2


def test_works_where_nothing_can_be_written(outside, tmp_path):
    (tmp_path / "file").touch()
    assert outside.run(3, cache=tmp_path / "file" / "cache") == [[7.0], 0, 1]


TRAINS = """
import sys

from numba.core import event

from swimmer_mj.cli import main

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
assert main(sys.argv[1:]) == 0
sys.exit(f"{len(compiled.buffer)} compilations" if compiled.buffer else 0)
"""


@pytest.mark.parametrize(
    "options",
    [["--neurons", "8"], ["--seeds", "0-1", "--engine", "population", "--neurons", "8"]],
    ids=["fused", "population"],
)
def test_the_second_process_that_trains_compiles_nothing(tmp_path, options):
    arguments = [
        "train",
        "--problem",
        "pendulum",
        "--trials",
        "2",
        "--evaluate-every",
        "2",
        *options,
        "--out",
    ]
    assert main([*arguments, str(tmp_path / "first")]) == 0
    command = [sys.executable, "-c", TRAINS, *arguments, str(tmp_path / "second")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, second = (
        [load_file(path)["weight"] for path in sorted((tmp_path / out).rglob("checkpoint.safetensors"))]
        for out in ("first", "second")
    )
    assert len(first) == len(second) > 0
    assert all(map(np.array_equal, first, second))  # it is the same code
