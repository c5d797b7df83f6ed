"""Weights on disk: safetensors, never pickles; replaced as a whole or not at all.

A checkpoint is one .safetensors file of tensors. What else belongs to it (configuration, counters, state of
the random generator) is JSON in the file's own metadata, so that the two can never disagree; the same JSON is
written beside it, to be read by people. A digest of all of it is in the metadata too: a file that was damaged is
refused. Files of version 0.1 have none.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from swimmer_mj.files import replacing

__all__ = ["load_checkpoint", "save_checkpoint"]

_OLD, _KEY, _DIGEST = "swimmer_mj", "swimmer_mj.2", "sha256"
"""The names of the JSON in files of version 0.1 and of today, and of the digest."""


def save_checkpoint(
    path: str | os.PathLike[str], tensors: Mapping[str, Tensor], info: Mapping[str, Any]
) -> None:
    """Write ``tensors`` and ``info`` (JSON values) to ``path``, and ``info`` to the .json beside it.

    OSError if there is no room for it; then what was there before is there still.
    """
    text = json.dumps(info, indent=2)
    # Copies, for safetensors refuses tensors that share memory.
    contiguous = {
        name: tensor.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, tensor in tensors.items()
    }
    content = save(contiguous, metadata={_KEY: text, _DIGEST: _digest(contiguous, text)})
    with replacing(path) as partial:
        try:
            partial.write_bytes(content)  # save_file() would leave a file of its own behind when it is killed
        except OSError as error:
            reason = f"could not be written: {error.strerror or error}"
            raise OSError(error.errno, reason, os.fspath(path)) from error
    with replacing(Path(path).with_suffix(".json")) as partial:
        partial.write_text(text + "\n")


def load_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and info that :func:`save_checkpoint` wrote.

    Raises
    ------
    FileNotFoundError
        If there is none.
    ValueError
        In one line: it is no checkpoint, or it is damaged, or a later version wrote it.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no checkpoint {os.fspath(path)}")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    except (SafetensorError, RuntimeError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{os.fspath(path)} is not a checkpoint of swimmer-mj, or is damaged: {error}"
        ) from error
    if _KEY not in metadata and _OLD not in metadata:
        later = any(key.startswith(f"{_OLD}.") for key in metadata)
        reason = "it was written by a later version" if later else "it says nothing of itself"
        raise ValueError(f"{os.fspath(path)} is not a checkpoint of swimmer-mj, or is damaged: {reason}")
    text = metadata.get(_KEY, metadata.get(_OLD, ""))
    if _KEY in metadata and metadata.get(_DIGEST) != _digest(tensors, text):
        raise ValueError(
            f"{os.fspath(path)} is damaged: its content does not have the digest that was written with it"
        )
    try:
        info = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(
            f"{os.fspath(path)} is not a checkpoint of swimmer-mj, or is damaged: {error}"
        ) from error
    if not isinstance(info, dict):
        raise ValueError(
            f"{os.fspath(path)} is not a checkpoint of swimmer-mj, or is damaged: it says {text[:40]!r}"
        )
    return tensors, info


def _digest(tensors: Mapping[str, Tensor], text: str) -> str:
    """SHA-256 of the tensors, by their names in order, and of the text."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
