"""OSMesa's LLVM and triton's in one process."""

import importlib.util
import os
import shutil
import subprocess
import sys

import pytest
from numba import _helperlib

from swimmer_mj.render.backend import _OSMESA, _loads

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "RTLD_DEEPBIND"), reason="libraries are bound otherwise here"),
    pytest.mark.skipif(not _loads(_OSMESA), reason="there is no OSMesa here"),
]
LEARN = """
import torch
weight = torch.zeros(3, requires_grad=True)
optimizer = torch.optim.Adam([weight])
weight.sum().backward()
optimizer.step()
"""
WAYS = {
    "drawing": "from swimmer_mj.render.backend import use_backend\nuse_backend('osmesa')\nimport mujoco",
    "Gymnasium": "import gymnasium, swimmer_mj.gymnasium\ngymnasium.make('swimmer_mj/Swim3-v0')",
    "vectors": "from swimmer_mj.environments.vector import SwimmerVectorEnv\nSwimmerVectorEnv('swim3', 2)",
    "dm_control": "import swimmer_mj\nswimmer_mj.load('swim3')",
}


def run(code, **environment):
    clean = {**os.environ}
    clean.pop("PYOPENGL_PLATFORM", None)  # MuJoCo sets it
    return subprocess.run(
        [sys.executable, "-c", code], env=clean | environment, capture_output=True, text=True
    )


@pytest.mark.skipif(importlib.util.find_spec("triton") is None, reason="torch came without triton")
@pytest.mark.parametrize("way", WAYS)
def test_torch_learns_where_osmesa_draws(way):
    if way == "dm_control":
        pytest.importorskip("dm_control")
    done = run(WAYS[way] + LEARN + "print('learned')", MUJOCO_GL="osmesa")
    assert (done.returncode, done.stdout) == (0, "learned\n"), done.stderr


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("backend", ["osmesa", "disabled"])
def test_tritons_library_is_loaded_first_where_osmesa_draws(tmp_path, way, backend):
    """Another library in its place, for there may be no triton."""
    if way == "dm_control":
        pytest.importorskip("dm_control")
    (tmp_path / "triton" / "_C").mkdir(parents=True)
    (tmp_path / "triton" / "__init__.py").touch()
    library = tmp_path / "triton" / "_C" / "libtriton.so"
    shutil.copy(_helperlib.__file__, library)
    if way == "drawing" and backend == "disabled":
        pytest.skip("it draws by OSMesa, whatever MUJOCO_GL says")
    code = WAYS[way] + f"\nprint({str(library)!r} in open('/proc/self/maps').read())"
    done = run(code, MUJOCO_GL=backend, PYTHONPATH=str(tmp_path))
    assert (done.returncode, done.stdout) == (0, f"{backend == 'osmesa'}\n"), done.stderr
