"""Which OpenGL draws MuJoCo's pictures.

MuJoCo binds its OpenGL backend when it is imported, from the environment variable ``MUJOCO_GL``, and it
cannot be changed afterwards. So :func:`use_backend` comes before the first import of mujoco or dm_control
in a program that renders. It is the only place in this package that sets ``MUJOCO_GL``.
"""
# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from typing import Literal, get_args

from swimmer_mj.libraries import load_triton_apart

__all__ = ["Backend", "BackendError", "Probe", "default_backend", "probe", "use_backend"]

Backend = Literal["osmesa", "egl", "glfw", "cgl"]
"""OSMesa draws on the CPU and needs no screen; EGL draws without a screen, GLFW and CGL (macOS) with one."""

_OSMESA = ["libOSMesa.so", *(f"libOSMesa.so.{major}" for major in range(9, -1, -1))]
_EGL = ["libEGL.so", "libEGL.so.1"]


class BackendError(RuntimeError):
    """A backend cannot be used; the message is one line and says what to do."""


@dataclass(frozen=True)
class Probe:
    """What drawing one frame showed."""

    backend: str
    mujoco: str
    """Version of MuJoCo."""
    opengl: str
    """Version of OpenGL, as the driver states it."""
    vendor: str
    renderer: str
    first_frame_seconds: float
    """To create the context, compile the model and draw 320x240 pixels, s."""


def default_backend() -> Backend:
    """Return the backend that ``MUJOCO_GL`` names, else the one for this system.

    That is OSMesa, which draws the same everywhere; EGL where there is EGL and no OSMesa, which Mesa has no longer
    since 25.1; CGL on macOS and GLFW on Windows, which have neither.
    """
    named = os.environ.get("MUJOCO_GL", "").strip().lower()
    if named not in ("", "1", "on", "true", "enable", "enabled"):
        return _known(named, "the environment variable MUJOCO_GL")
    if sys.platform in ("darwin", "win32"):
        return "cgl" if sys.platform == "darwin" else "glfw"
    return "egl" if not _loads(_OSMESA) and _loads(_EGL) else "osmesa"


def use_backend(backend: str | None = None) -> Backend:
    """Make MuJoCo draw with ``backend``; call it before mujoco or dm_control is imported.

    Parameters
    ----------
    backend : {"osmesa", "egl", "glfw", "cgl"}, optional
        By default the one MuJoCo already draws with, if it is usable, or else :func:`default_backend`.

    Returns
    -------
    str
        The backend in force.

    Raises
    ------
    BackendError
        If MuJoCo is already bound to another backend, or the system lacks what this one needs.
    """
    bound = _bound_backend()
    if backend is not None:
        chosen = _known(backend, "backend")
    elif bound is not None and _lacks(bound) is None:
        chosen = bound
    else:
        chosen = default_backend()
    if lack := _lacks(chosen):
        raise BackendError(lack)
    if bound not in (None, chosen):
        raise BackendError(
            f"mujoco was imported with the OpenGL backend {bound!r} and cannot change to {chosen!r}: "
            f"set MUJOCO_GL={chosen} before Python starts, or call use_backend() before importing mujoco"
        )
    platform = os.environ.get("PYOPENGL_PLATFORM")
    if bound is None and chosen in ("osmesa", "egl") and platform not in (None, "", chosen):
        raise BackendError(f"PYOPENGL_PLATFORM is {platform!r} and forbids {chosen!r}: unset it")
    os.environ["MUJOCO_GL"] = chosen
    load_triton_apart()
    return chosen


def probe(backend: str | None = None, timeout: float = 60.0) -> Probe:
    """Draw one frame with ``backend`` in a process of its own, and say what drew it.

    Raises
    ------
    BackendError
        If it could not be drawn within ``timeout`` (s).
    """
    chosen = default_backend() if backend is None else _known(backend, "backend")
    if lack := _lacks(chosen):
        raise BackendError(lack)
    command = [sys.executable, "-c", f"from {__name__} import _probe_here; _probe_here()"]
    environment = {**os.environ, "MUJOCO_GL": chosen}
    environment.pop("PYOPENGL_PLATFORM", None)  # mujoco sets it to go with MUJOCO_GL
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise BackendError(f"{chosen} drew no frame within {timeout:g} s") from None
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise BackendError(f"{chosen} drew no frame: {reason}")
    return Probe(**json.loads(done.stdout.splitlines()[-1]))


def _known(name: str, what: str) -> Backend:
    for backend in get_args(Backend):
        if backend == name:
            return backend
    raise BackendError(f"{what} must be one of {', '.join(get_args(Backend))}; got {name!r}")


def _bound_backend() -> Backend | None:
    """Return the backend that mujoco is bound to in this process; None if mujoco is not imported."""
    mujoco = sys.modules.get("mujoco")
    if mujoco is None:
        return None
    if not hasattr(mujoco, "GLContext"):
        raise BackendError("mujoco was imported without OpenGL: unset MUJOCO_GL and PYOPENGL_PLATFORM")
    return _known(mujoco.GLContext.__module__.removeprefix("mujoco."), "mujoco's backend")


def _lacks(backend: Backend) -> str | None:
    """Say what the system lacks to use ``backend``, in one line; None if nothing is known to be missing."""
    if backend == "osmesa" and not _loads(_OSMESA):
        return (
            "the OSMesa library is missing; install it with: sudo apt-get install libosmesa6, "
            "or where that is no longer had: libegl1 libgl1-mesa-dri"
        )
    if backend == "egl" and not _loads(_EGL):
        return "the EGL library is missing; install it with: sudo apt-get install libegl1 libgl1-mesa-dri"
    if backend == "glfw" and sys.platform == "linux" and not _has_display():
        return "glfw needs a screen and there is none (DISPLAY is not set); use osmesa or egl"
    return None


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _loads(names: list[str]) -> bool:
    for name in names:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def _probe_here() -> None:
    """Draw one frame in this process and print a :class:`Probe` as JSON."""
    import mujoco
    from OpenGL import GL

    start = time.perf_counter()
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model) as renderer:
        renderer.update_scene(data)
        frame = renderer.render()
        seconds = time.perf_counter() - start
        opengl, vendor, renderer_name = (
            GL.glGetString(name).decode() for name in (GL.GL_VERSION, GL.GL_VENDOR, GL.GL_RENDERER)
        )
    if frame.min() == frame.max():
        raise BackendError("the frame is blank")
    backend = _bound_backend()
    result = Probe(str(backend), mujoco.__version__, opengl, vendor, renderer_name, round(seconds, 4))
    print(json.dumps(asdict(result)))
