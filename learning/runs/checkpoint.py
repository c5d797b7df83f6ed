"""Weights on disk: safetensors, never pickles; replaced as a whole or not at all.

A checkpoint is one .safetensors file of tensors. What else belongs to it (configuration, counters, state of
the random generator) is JSON in the file's own metadata, so that the two can never disagree; the same JSON is
written beside it, to be read by people.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from swimmer_mj.files import replacing

__all__ = ["load_checkpoint", "save_checkpoint"]

_KEY = "swimmer_mj"


def save_checkpoint(
    path: str | os.PathLike[str], tensors: Mapping[str, Tensor], info: Mapping[str, Any]
) -> None:
    """Write ``tensors`` and ``info`` (JSON values) to ``path``, and ``info`` to the .json beside it."""
    text = json.dumps(info, indent=2)
    contiguous = {name: tensor.detach().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as partial:
        save_file(contiguous, partial, metadata={_KEY: text})
    with replacing(Path(path).with_suffix(".json")) as partial:
        partial.write_text(text + "\n")


def load_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and info that :func:`save_checkpoint` wrote."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no checkpoint {os.fspath(path)}")
    try:
        with safe_open(path, framework="pt") as file:
            info = json.loads((file.metadata() or {})[_KEY])
            return {name: file.get_tensor(name) for name in file.keys()}, info  # noqa: SIM118 - not a mapping
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{os.fspath(path)} is not a checkpoint of swimmer-mj: {error}") from error
