"""One process at a time learns in a run directory.

The lock is the operating system's, on a file in the directory (filelock: flock, on Windows LockFile): it goes when its
process ends, however that ends, and a copy of the directory is not locked. Who holds it is written beside, for the
message only.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

__all__ = ["LOCK", "RunInUseError", "locked"]

LOCK, OWNER = ".lock", ".owner"


class RunInUseError(OSError):
    """Another process learns in the directory."""


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Hold ``directory``, which is made if need be, for a block; RunInUseError if another one holds it."""
    directory.mkdir(parents=True, exist_ok=True)
    lock, owner = FileLock(directory / LOCK), directory / OWNER
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise RunInUseError(
            f"{directory} is in use by {_name(owner)}; wait for it, or stop it with SIGTERM, and it saves"
        ) from None
    try:
        owner.write_text(f"process {os.getpid()} on {socket.gethostname()}\n", encoding="utf-8")
        yield
    finally:
        with contextlib.suppress(OSError):  # the directory may have been moved or removed meanwhile
            owner.unlink(missing_ok=True)
            (directory / LOCK).unlink(missing_ok=True)
        lock.release()


def _name(owner: Path) -> str:
    """What the owner wrote of itself."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if text := owner.read_text(encoding="utf-8").strip()[:200]:
            return text
    return "another process"
