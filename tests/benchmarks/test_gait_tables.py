"""The tables of docs/gaits.md."""

from dataclasses import replace

import gait_replays
import gait_tables
import numpy as np
import pytest
from scipy.integrate import quad

from swimmer_mj.learning.experiments.gaits.gait import BEST, load_gaits
from swimmer_mj.learning.experiments.tables import LOGS, read_table


def test_seconds_from_one_speed_to_another():
    expected, _ = quad(lambda v: 1 / np.exp(np.interp(v, [1.0, 2.0], np.log([1.2, 0.3]))), 1.0, 2.0)
    assert gait_tables.seconds_between((1.0, 2.0), (1.2, 0.3)) == pytest.approx(expected)


def test_every_stored_gait_is_in_the_table_and_the_best_converged_one_of_the_log():
    table, log = read_table(gait_tables.RESULTS / "gait-replays.csv"), read_table(LOGS / "gaits.csv")
    stored = {
        (gait.parameters.n_links, speed): gait.pull
        for path in BEST.glob("swim*.npz")
        for speed, gait in load_gaits(path).items()
    }
    rows = zip(table["links"].astype(int).tolist(), table["speed"].tolist(), strict=True)
    assert dict(zip(rows, table["pull"].tolist(), strict=True)) == pytest.approx(stored, rel=1e-5)
    for (links, speed), pull in stored.items():
        of_it = (log["links"] == links) & (log["speed"] == speed) & (log["kkt_residual"] <= 1e-6)
        assert log["pull"][of_it].max() == pytest.approx(pull, rel=1e-5)


def test_the_gaits_hold_on_mujoco_to_half_a_percent():
    table = read_table(gait_tables.RESULTS / "gait-replays.csv")
    assert (np.abs(table["replayed_speed"] / table["speed"] - 1) < 0.005).all()
    assert (table["largest_error"] < 0.005).all()


def test_whole_turns_are_no_bend():
    gait = load_gaits(BEST / "swim5.npz")[2.0]
    bend, joint = gait_replays.sharpest_bend(gait)
    states = gait.states.copy()
    states[:, 2:5] += 2 * np.pi  # the last three links once round
    assert gait_replays.sharpest_bend(replace(gait, states=states)) == (pytest.approx(bend), joint)
    states[:, 4] += np.radians(100)
    bent, at = gait_replays.sharpest_bend(replace(gait, states=states))
    assert (bent > 100 - bend, at) == (True, 4)


def test_starts_are_told_apart():
    starts = {
        "wave 2 s, 1.5 rad": "wave",
        "random 3": "random",
        "best of 4 links": "best",
        "swim5-joints": "learned",
    }
    assert {start: gait_tables.kind_of_start(start) for start in starts} == starts
    counted = [row[4:8] for row in gait_tables.basins().rows]
    assert all(int(cell.split()[0]) <= int(cell.split()[-1]) for row in counted for cell in row)
    of_all = [sum(int(cell.split()[-1]) for cell in row) for row in counted]
    assert of_all == [int(row[2]) for row in gait_tables.basins().rows]


def test_ways_out_are_summed_up_by_learner(tmp_path, monkeypatch):
    lines = ["name,seed,cpu_seconds,simulation_steps,speed,steady_speed,folded"]
    lines += ["as train,1,20,8000000,2.0,2.1,1.0", "as train,2,20,9000000,2.2,2.5,0.4"]
    lines += ['"joints, held",1,20,4000000,2.8,3.0,0.0', '"joints, held",2,20,4000000,2.8,3.0,0.6']
    (tmp_path / "ways-out.csv").write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(gait_tables, "RESULTS", tmp_path)
    as_train, joints = gait_tables.ways_out().rows
    assert as_train[:3] == ("as train", "2", "8.5")
    assert as_train[3].startswith("2.10 [")
    assert as_train[4].startswith("2.30 [")
    assert as_train[5:] == ("2.10 to 2.50", "1")
    assert joints[5:] == ("3.00 to 3.00", "1")
