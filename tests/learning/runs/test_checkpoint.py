import errno
import json
import os

import pytest
import torch
from safetensors.torch import save

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


def test_tensors_may_share_memory(tmp_path):
    whole = torch.arange(6.0)
    tensors = {"whole": whole, "same": whole, "part": whole[2:4], "turned": whole.view(2, 3).T}
    save_checkpoint(tmp_path / "weights.safetensors", tensors, {})
    loaded, _ = load_checkpoint(tmp_path / "weights.safetensors")
    assert all(torch.equal(loaded[name], tensor) for name, tensor in tensors.items())


def test_a_failed_save_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "weights.safetensors"
    save_checkpoint(path, {"a": torch.zeros(3)}, {"trial": 1})

    def disk_full(path, content):
        path.write_text("half a file")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(checkpoint.Path, "write_bytes", disk_full)
    with pytest.raises(OSError, match="could not be written: No space left on device") as refused:
        save_checkpoint(path, {"a": torch.ones(3)}, {"trial": 2})
    assert refused.value.filename == str(path)
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


@pytest.mark.parametrize("place", [0.02, 0.5, 0.999])
def test_a_bit_that_has_changed_is_noticed(tmp_path, place):
    """In the header, in the JSON, in the tensors."""
    path = tmp_path / "weights.safetensors"
    save_checkpoint(path, {"a": torch.ones(30)}, {"trial": 2})
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"is not a checkpoint of swimmer-mj, or is|is damaged: its"):
        load_checkpoint(path)


def test_a_checkpoint_of_a_later_version_is_refused(tmp_path):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(save({"a": torch.ones(3)}, metadata={"swimmer_mj.3": "{}"}))
    with pytest.raises(ValueError, match="it was written by a later version"):
        load_checkpoint(path)


def test_a_checkpoint_of_version_0_1_has_no_digest_and_loads(tmp_path):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(save({"a": torch.ones(3)}, metadata={"swimmer_mj": '{"trial": 7}'}))
    assert load_checkpoint(path)[1] == {"trial": 7}
