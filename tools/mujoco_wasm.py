"""Bring MuJoCo's own WebAssembly build for the browser page into render/page/mujoco.

    python tools/mujoco_wasm.py

needs npm, which fetches one pinned version of ``@mujoco/mujoco``; its hash is checked. The single-threaded build is
taken, for the threaded one needs HTTP headers that a file on disk does not have. The package has no licence texts:
they are taken from MuJoCo's wheel.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.metadata
import re
import subprocess
import tarfile
import tempfile
from pathlib import Path

from swimmer_mj.files import replacing

PACKAGE = "@mujoco/mujoco@3.14.0"
SHA512 = "WPUYidu4Fx8+uM4hQv80SOA0ifpWGrsNJguKs8JBV8SCTxjKQ2/rqsh880nUH0/Vwa8vuefghvCQkkoed3bkUg=="
"""Of the package, as npm states it."""
TARGET = Path(__file__).parents[1] / "render" / "page" / "mujoco"
MAX_BYTES = 3_000_000
"""Of all that is kept."""
LINKED = (
    "cereal", "Collisions", "Eigen", "libccd", "LLVM", "LodePNG", "MarchingCubeCpp", "miniz", "Qhull", "TinyOBJLoader",
    "TinyXML2",
)  # fmt: skip
"""What MuJoCo's library is linked with, as its list of third parties names them; the rest belongs to its programs."""


def write_licenses() -> None:
    """MuJoCo's licence, and those of what it is linked with."""
    texts = {
        Path(file).name: file.read_text()
        for file in importlib.metadata.files("mujoco") or ()
        if file.name.startswith("LICENSE")
    }
    sections = re.split(r"^(?=### )", texts["LICENSES_THIRD_PARTY.md"], flags=re.MULTILINE)
    kept = [one for one in sections if any(one.startswith(f"### {name}") for name in LINKED)]
    if len(kept) < len(LINKED):
        raise SystemExit(f"of {', '.join(LINKED)}, MuJoCo's wheel has {len(kept)} licences")
    for name, text in (("LICENSE", texts["LICENSE"]), ("LICENSES_THIRD_PARTY.md", "".join(kept))):
        with replacing(TARGET / name) as partial:
            partial.write_text(text, encoding="utf-8")


def main() -> None:
    """Fetch, check, compress."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            ["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL
        )
        (archive,) = Path(folder).glob("*.tgz")
        found = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
        if found != SHA512:
            raise SystemExit(f"{PACKAGE} has the hash {found}, and {SHA512} was expected")
        total = 0
        with tarfile.open(archive) as package:
            for name in ("mujoco.wasm", "mujoco.js"):
                member = package.extractfile(f"package/{name}")
                assert member is not None
                # No time and no name inside: the same bytes give the same file.
                compressed = gzip.compress(member.read(), compresslevel=9, mtime=0)
                with replacing(TARGET / f"{name}.gz") as partial:
                    partial.write_bytes(compressed)
                total += len(compressed)
                print(f"{name}.gz: {len(compressed):,} bytes")
    write_licenses()
    if total > MAX_BYTES:
        raise SystemExit(f"{total:,} bytes are too many; {MAX_BYTES:,} are allowed")


if __name__ == "__main__":
    main()
