import os
import subprocess
import sys
import time
from importlib.metadata import version

import pytest

from swimmer_mj.render import backend
from swimmer_mj.render.backend import BackendError, default_backend, probe, use_backend

SCREENLESS = "osmesa" if backend._loads(backend._OSMESA) else "egl"  # what this system has


def run(code, **environment):
    """The outcome of ``code`` in a new Python, with nothing said about OpenGL but ``environment``."""
    clean = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY")}
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=clean | environment,
        capture_output=True,
        text=True,
    )


def test_probe_draws_a_frame_and_says_with_what():
    started = time.perf_counter()
    result = probe(timeout=600)
    assert result.backend == default_backend()
    assert result.vendor
    assert result.renderer
    assert result.opengl[0].isdigit()
    assert result.mujoco == version("mujoco")
    assert 0 < result.first_frame_seconds < time.perf_counter() - started


def test_importing_the_library_leaves_opengl_alone():
    done = run(
        "import os, sys, swimmer_mj.trajectory\n"
        "from swimmer_mj.render import backend, curves, figures, strip, video\n"
        "assert 'MUJOCO_GL' not in os.environ\n"
        "assert not {'mujoco', 'dm_control', 'matplotlib.pyplot', 'torch'} & set(sys.modules)\n"
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform != "linux", reason="the default is OSMesa on Linux")
def test_use_backend_binds_mujoco_without_a_screen():
    done = run(
        "from swimmer_mj.render.backend import use_backend\n"
        "print(use_backend())\n"
        "import mujoco\n"
        f"print(mujoco.GLContext.__module__, use_backend(), use_backend({SCREENLESS!r}))\n"
    )
    assert done.stdout.split() == [SCREENLESS, f"mujoco.{SCREENLESS}", SCREENLESS, SCREENLESS], done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="GLFW is bound by default on Linux")
def test_a_bound_mujoco_cannot_change_its_backend():
    done = run(
        f"import mujoco\nfrom swimmer_mj.render.backend import use_backend\nuse_backend({SCREENLESS!r})\n",
    )
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1
    assert f"mujoco was imported with the OpenGL backend 'glfw' and cannot change to {SCREENLESS!r}" in last
    assert f"MUJOCO_GL={SCREENLESS}" in last


def test_a_conflicting_platform_of_pyopengl_is_refused():
    done = run(
        f"from swimmer_mj.render.backend import use_backend\nuse_backend({SCREENLESS!r})\n",
        PYOPENGL_PLATFORM="glx",
    )
    assert f"PYOPENGL_PLATFORM is 'glx' and forbids {SCREENLESS!r}: unset it" in done.stderr


def test_mujoco_gl_is_respected(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", " EGL ")
    assert default_backend() == "egl"
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    with pytest.raises(BackendError, match="MUJOCO_GL must be one of osmesa, egl, glfw, cgl; got 'vulkan'"):
        default_backend()


@pytest.mark.parametrize(
    ("system", "osmesa", "egl", "expected"),
    [
        ("linux", True, True, "osmesa"),
        ("linux", False, True, "egl"),
        ("linux", False, False, "osmesa"),  # whose absence is then told
        ("darwin", False, False, "cgl"),
        ("win32", False, False, "glfw"),
    ],
)
def test_the_default_is_what_the_system_has(monkeypatch, system, osmesa, egl, expected):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(backend, "_loads", lambda names: {"_OSMESA": osmesa, "_EGL": egl}[names])
    monkeypatch.setattr(backend, "_OSMESA", "_OSMESA")
    monkeypatch.setattr(backend, "_EGL", "_EGL")
    assert default_backend() == expected


def test_unknown_backends_are_refused():
    with pytest.raises(BackendError, match="backend must be one of osmesa, egl, glfw, cgl; got 'vulkan'"):
        use_backend("vulkan")


def test_a_missing_library_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setattr(backend, "_OSMESA", ["libNoSuchMesa.so"])
    for function in (use_backend, probe):
        with pytest.raises(
            BackendError, match=r"sudo apt-get install libosmesa6, or .*: libegl1 libgl1-mesa-dri"
        ):
            function("osmesa")


@pytest.mark.skipif(sys.platform != "linux", reason="asks for X11 or Wayland")
def test_glfw_needs_a_screen(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(BackendError, match="glfw needs a screen"):
        probe("glfw")
