"""TD(lambda) on a task of dm_control is learned once, looked at, and summed up."""

import csv

import any_model
import model_tables
import pytest
import td_on_mujoco as td

TASK = "dm_control/pendulum/swingup"


def test_a_seed_is_learned_once_and_its_best_look_is_kept(tmp_path, monkeypatch):
    pytest.importorskip("dm_control.suite", reason="there is no dm_control here")
    out = tmp_path / "td-on-mujoco.csv"
    monkeypatch.setattr(td, "EVERY", 1.0)
    monkeypatch.setattr(any_model, "looked_at", lambda task: range(1))
    monkeypatch.setattr(any_model, "fresh", lambda task: range(1000, 1002))
    for _ in range(2):
        td.main((TASK,), (0,), 2.0, out)
    with out.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["look"] for row in rows] == ["of the learner"] * (len(rows) - 1) + ["best"]
    assert len(rows) >= 2
    steps = [int(row["simulation_steps"]) for row in rows]
    assert steps == sorted(steps)
    assert all(of % 250 == 0 and of > 250 for of in steps)  # trials of 5 s by steps of 0.02 s
    assert all(0 <= float(row["return_mean"]) <= 1000 for row in rows)


def test_the_table_has_what_was_kept_beside_value_gradients(tmp_path, monkeypatch):
    looks = [(0, "of the learner", 10, 500, 700.0), (0, "of the learner", 20, 1000, 30.0), (0, "best", 10, 1000, 690.0),
             (1, "of the learner", 20, 800, 500.0), (1, "best", 20, 800, 510.0)]  # fmt: skip
    lines = [f"{TASK},{seed},{look},{at},{steps},{value},0,0" for seed, look, at, steps, value in looks]
    (tmp_path / "td-on-mujoco.csv").write_text("\n".join([",".join(td.COLUMNS), *lines]) + "\n")
    (tmp_path / "any-model.csv").write_text(
        "\n".join([",".join(td.COLUMNS), f"{TASK},5,best,9,1,850,0,0"]) + "\n"
    )
    (tmp_path / "published-returns.csv").write_text(f"task,learner,return\n{TASK},SAC,589\n")
    monkeypatch.setattr(model_tables, "RESULTS", tmp_path)
    (row,) = model_tables.td_on_mujoco().rows
    assert row == (f"`{TASK}`", "2", "20", "900", "690, 510", "510", "1", "850", "SAC 589")
