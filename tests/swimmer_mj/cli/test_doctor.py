"""``doctor``: each piece is broken on purpose, and the command that mends it is named."""

import importlib
import json
import shutil
import subprocess
import sys
from collections import namedtuple

import mujoco
import pytest

from swimmer_mj import validation
from swimmer_mj.cli import main
from swimmer_mj.compiled import cache
from swimmer_mj.render import backend

doctor = importlib.import_module("swimmer_mj.cli.doctor")  # the package has the command under that name


def no_osmesa(monkeypatch, tmp_path):
    monkeypatch.setattr(backend, "_OSMESA", ["libNoOSMesa.so"])
    monkeypatch.setenv("MUJOCO_GL", "osmesa")


def no_ffmpeg(monkeypatch, tmp_path):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "ffmpeg"))


def another_ffmpeg(monkeypatch, tmp_path):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "false")


def no_encoder(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)


def no_compiler(monkeypatch, tmp_path):
    monkeypatch.setitem(
        sys.modules, "swimmer_mj.compiled.cache", None
    )  # which cannot be imported without numba


def no_imageio(monkeypatch, tmp_path):
    real = doctor.version
    monkeypatch.setattr(doctor, "version", lambda name: "1.2.3" if name == "imageio" else real(name))


def no_cache(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(cache.config, "CACHE_DIR", str(tmp_path / "file" / "cache"))


def full_disk(monkeypatch, tmp_path):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 10**9 - 10**6, 10**6))


def old_version(monkeypatch, tmp_path):
    real = doctor.version
    monkeypatch.setattr(doctor, "version", lambda name: "1.2.3" if name == "numpy" else real(name))


def no_package(monkeypatch, tmp_path):
    real = doctor.requires
    monkeypatch.setattr(doctor, "requires", lambda name: [*real(name), "no-such-package>=7"])


def another_callback(monkeypatch, tmp_path):
    mujoco.set_mjcb_passive(lambda model, data: None)


def wrong_callback(monkeypatch, tmp_path):
    wrong = validation.Check("a rod", 1.0, 1e-9, "")
    monkeypatch.setattr(validation, "callback_self_test", lambda: wrong)


def raising_callback(monkeypatch, tmp_path):
    def test():
        raise RuntimeError("the law does not compile")

    monkeypatch.setattr(validation, "callback_self_test", test)


@pytest.fixture(autouse=True)
def no_callback_is_left():
    yield
    mujoco.set_mjcb_passive(None)


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        pytest.param(
            no_osmesa,
            "rendering: the OSMesa library is missing; install it with: sudo apt-get install libosmesa6, or",
            marks=pytest.mark.skipif(not backend._loads(backend._OSMESA), reason="there is none to be missed"),
        ),
        (no_ffmpeg, "ffmpeg: it does not run (IMAGEIO_FFMPEG_EXE names it): "),
        (another_ffmpeg, "mend it with: unset IMAGEIO_FFMPEG_EXE"),
        (no_encoder, "ffmpeg: it does not run: import of imageio_ffmpeg halted; None in sys.modules; mend it"),
        (no_compiler, "cache: import of swimmer_mj.compiled.cache halted; None in sys.modules; mend it with"),
        (no_imageio, "mend it with: pip install 'imageio[ffmpeg]>="),
        (no_cache, "mend it with: export NUMBA_CACHE_DIR=$HOME/.cache/swimmer-mj"),
        (full_disk, "disk: 1 MB are free in "),
        (old_version, "versions: numpy is 1.2.3, and must be >=2; mend it with: pip install 'numpy>=2'"),
        (no_package, "versions: no-such-package is missing, and must be >=7; mend it with: pip install"),
        (another_callback, "as MuJoCo's passive callback, for every model of the process; find it with: python -X"),
        (wrong_callback, "callback: a rod: error 1.0e+00 exceeds 1e-09; mend it with: pip install --force"),
        (raising_callback, "callback: the law does not compile; mend it with: pip install --force-reinstall"),
    ],
)  # fmt: skip
def test_a_broken_piece_is_named_with_what_mends_it(break_it, said, monkeypatch, tmp_path, capsys):
    if break_it is not no_osmesa:  # which takes a process of its own to see that it works
        monkeypatch.setattr(backend, "probe", lambda name: backend.Probe("osmesa", "3", "4", "", "", 0.1))
    break_it(monkeypatch, tmp_path)
    assert main(["doctor", "--json"]) == 1
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert said in problem


def test_without_mujoco_it_still_says_what_mends_it():
    code = (
        "import sys\nsys.modules['mujoco'] = None\nfrom swimmer_mj.cli import main\n"
        "sys.exit(main(['doctor', '--json']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "")
    (problem,) = json.loads(done.stdout)["problems"]
    assert problem.startswith(
        "callback: import of mujoco halted; None in sys.modules; mend it with: pip install"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="cores are told apart there")
def test_cores_that_may_not_be_used_are_named(monkeypatch, capsys):
    monkeypatch.setattr(backend, "probe", lambda name: backend.Probe("osmesa", "3", "4", "", "", 0.1))
    monkeypatch.setattr(doctor.os, "cpu_count", lambda: 64)
    monkeypatch.setattr(doctor.os, "sched_getaffinity", lambda process: {0, 1})
    assert main(["doctor"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "cores 64, of which 2 may be used; all with: taskset -c 0-63 swimmer-mj" in said
