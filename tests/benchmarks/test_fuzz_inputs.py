"""A short version of benchmarks/fuzz_inputs.py: its long one is run by hand."""

import fuzz_inputs
import numpy as np
import pytest


@pytest.fixture(scope="module")
def attack(tmp_path_factory):
    return fuzz_inputs.Fuzz(tmp_path_factory.mktemp("fuzz") / "fuzz")


@pytest.mark.parametrize(
    ("target", "inputs"),
    [
        ("config.json", 300),
        ("config.json of a policy", 100),
        ("config.json to resume", 60),
        ("best.safetensors", 300),
        ("checkpoint.safetensors", 100),
        ("unfinished.safetensors", 60),
        ("metrics.csv", 200),
        ("trajectory.npz", 200),
        ("sweep.toml", 100),
        ("model.xml", 60),
        ("--seeds", 200),
        ("--set", 200),
        ("options", 200),
        ("command line", 40),
    ],
)
def test_inputs_are_taken_or_refused_in_one_line(attack, target, inputs):
    found = fuzz_inputs.examine(attack, target, inputs, seed=1)
    assert found["wrong"] == []
    assert found["refused"] > inputs / 10


def test_every_target_is_tried(attack):
    (marker,) = (
        mark for mark in test_inputs_are_taken_or_refused_in_one_line.pytestmark if mark.name == "parametrize"
    )
    assert [target for target, _ in marker.args[1]] == list(attack.targets)


def test_what_is_wrong_is_noticed(attack, monkeypatch):
    def crash(rng):
        raise KeyError("x")

    def change(rng):
        (attack.place / "new").write_text("")

    def silent(rng):
        raise ValueError

    for act, message in ((crash, "KeyError: 'x'"), (change, "on disk has changed"), (silent, "says nothing")):
        monkeypatch.setitem(attack.targets, "metrics.csv", act)
        assert message in fuzz_inputs.examine(attack, "metrics.csv", 2, seed=0)["wrong"][0]
        (attack.place / "new").unlink(missing_ok=True)


def test_damage_is_of_every_kind():
    rng = np.random.default_rng(0)
    whole = b'{"a": 1, "b": [2, 3]}'
    found = [fuzz_inputs.damaged(whole, rng) for _ in range(5000)]
    assert b"" in found
    assert any(len(data) > len(whole) for data in found)
    assert any(
        len(data) == len(whole) and sum(a != b for a, b in zip(data, whole, strict=True)) == 1
        for data in found
    )
    assert any(b"NaN" in data for data in found)
