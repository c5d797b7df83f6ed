"""What shared libraries do to a process, and to each other in it."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from pathlib import Path

__all__ = ["load_triton_apart", "report_mujoco_warnings"]


def load_triton_apart() -> None:
    """Load triton's library so that it takes its own LLVM for its own, if MuJoCo draws by OSMesa and triton is there.

    PyOpenGL makes the symbols of OSMesa visible to all libraries, and with them Mesa's LLVM. triton has an LLVM too.
    torch imports triton at the first step of an optimizer; triton then takes the other one, and the process ends with
    a segmentation fault. Loaded here, with RTLD_DEEPBIND, it does not. It takes some 50 ms, once.
    """
    osmesa = "mujoco.osmesa" in sys.modules or os.environ.get("MUJOCO_GL") == "osmesa"
    if not osmesa or not hasattr(os, "RTLD_DEEPBIND") or "triton" in sys.modules:
        return
    found = importlib.util.find_spec("triton")
    for folder in (found and found.submodule_search_locations) or ():
        library = Path(folder) / "_C" / "libtriton.so"
        if library.is_file():
            ctypes.CDLL(str(library), mode=os.RTLD_NOW | os.RTLD_LOCAL | os.RTLD_DEEPBIND)


def report_mujoco_warnings() -> None:
    """Have MuJoCo's warnings, as of an unstable simulation, a line each on standard error; each kind once.

    By itself MuJoCo prints each of them there and appends it to MUJOCO_LOG.TXT where the process is. dm_control,
    when it is imported, has a way of its own.
    """
    import mujoco

    said: set[str] = set()

    def report(message: str) -> None:
        kind = message.partition(" Time = ")[0]  # without the moment
        if kind not in said:
            said.add(kind)
            print("MuJoCo:", *message.split(), file=sys.stderr)

    mujoco.set_mju_user_warning(report)  # pyright: ignore[reportAttributeAccessIssue]
