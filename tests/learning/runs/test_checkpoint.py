import json

import pytest
import torch

from swimmer_mj.learning.runs import checkpoint
from swimmer_mj.learning.runs.checkpoint import load_checkpoint, save_checkpoint


def test_round_trip(tmp_path):
    tensors = {"a": torch.randn(3, 4, dtype=torch.float64), "b": torch.randn(5).float()[::2]}
    info = {"trial": 12, "state": 2**120 + 1, "speed": 0.1, "nested": [{"x": None}]}
    path = tmp_path / "deep" / "weights.safetensors"
    save_checkpoint(path, tensors, info)
    loaded, loaded_info = load_checkpoint(path)
    assert loaded.keys() == tensors.keys()
    assert all(torch.equal(loaded[name], tensors[name]) for name in tensors)
    assert loaded["a"].dtype == torch.float64
    assert loaded_info == info
    assert json.loads(path.with_suffix(".json").read_text()) == info


def test_a_failed_save_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "weights.safetensors"
    save_checkpoint(path, {"a": torch.zeros(3)}, {"trial": 1})

    def disk_full(tensors, filename, metadata):
        filename.write_bytes(b"half a file")
        raise OSError("no space left on device")

    monkeypatch.setattr(checkpoint, "save_file", disk_full)
    with pytest.raises(OSError, match="no space left"):
        save_checkpoint(path, {"a": torch.ones(3)}, {"trial": 2})
    tensors, info = load_checkpoint(path)
    assert info == {"trial": 1}
    assert torch.equal(tensors["a"], torch.zeros(3))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["weights.json", "weights.safetensors"]


def test_refuses_what_is_no_checkpoint(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no checkpoint .*none\.safetensors"):
        load_checkpoint(tmp_path / "none.safetensors")
    (tmp_path / "text.safetensors").write_text("weights")
    with pytest.raises(ValueError, match="is not a checkpoint of swimmer-mj"):
        load_checkpoint(tmp_path / "text.safetensors")
