"""Tasks learned with other settings than those of ``train``."""

import csv

import any_model_variants as variants
import model_tables
import pytest

TASK = "gymnasium/InvertedPendulum-v5"


@pytest.mark.filterwarnings("ignore::swimmer_mj.learning.problems.caution.CautionWarning")
def test_each_variant_is_learned_once_with_its_settings(tmp_path, monkeypatch):
    out = tmp_path / "any-model-variants.csv"
    monkeypatch.setattr(variants, "VARIANTS", {TASK: (0.2, ("", "trajectories=224 steps=3"))})
    for _ in range(2):
        variants.main((TASK,), (0,), out)
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 2  # variants, looks
    steps = {row["settings"]: int(row["simulation_steps"]) for row in rows}
    assert steps[""] % (256 * 25) == 0
    assert steps["trajectories=224 steps=3"] % (224 * 3) == 0
    assert (tmp_path / "made.csv").exists()


def test_the_table_has_each_seeds_last_look(tmp_path, monkeypatch):
    looks = [("0", "of the learner", 5, 7.0), ("0", "of the learner", 10, 3.0), ("0", "best", 5, 9.0),
             ("1", "of the learner", 10, 6.0)]  # fmt: skip
    lines = [f"{TASK},huber=null dt=0.1,{seed},{look},{at},0,{value},0,0" for seed, look, at, value in looks]
    (tmp_path / "any-model-variants.csv").write_text("\n".join([",".join(variants.COLUMNS), *lines]) + "\n")
    monkeypatch.setattr(model_tables, "RESULTS", tmp_path)
    (row,) = model_tables.any_model_variants().rows
    assert row == (f"`{TASK}`", "`huber=null`, `dt=0.1`", "10", "4", "3, 6")
