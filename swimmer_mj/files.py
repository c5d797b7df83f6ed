"""Writing a file so that nobody ever reads half of it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["replacing"]


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a new sibling of ``path`` to write to; on success it takes the place of ``path``.

    The sibling keeps the suffix, by which writers choose their format. If the block raises, it is removed
    and ``path`` stays as it was. Missing parent directories are made.

    Raises
    ------
    FileExistsError
        ``path`` is a directory, a device such as /dev/null or a pipe: a file would take its place.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path} is there and is no regular file; choose another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
