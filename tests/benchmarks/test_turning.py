"""How swimmers turn."""

import math

import numpy as np
import pytest
import turning

from swimmer_mj import state as st
from swimmer_mj.learning.pretrained import load_pretrained
from swimmer_mj.learning.problems.swim.environment import evaluation_states, record_episode


def test_a_turn_of_known_course():
    """Ahead at 2 m/s without a turn; with it sideways at 2 m/s for 3 s, then along at 1 m/s, from 8 s on at 2 m/s."""
    time = np.arange(0, 15.005, 0.01)
    unturned = np.stack([2 * time, 0 * time], axis=1)
    along = np.clip(time - 3, 0, 5) + 2 * np.clip(time - 8, 0, None)
    turned = np.stack([along, 2 * np.minimum(time, 3)], axis=1)
    sideways = np.stack([0 * time, 2 * time], axis=1)
    way, without = np.stack([turned, sideways], axis=1), np.stack([unturned, unturned], axis=1)
    found = turning.measure(way, without)
    # A mean over s seconds of ahead and 1 - s of sideways points there at atan(2 (1 - s) / s)
    share = 2 / (2 + math.tan(math.radians(20)))
    np.testing.assert_allclose(found.turned_after, [3 + share, np.nan], atol=0.011)
    np.testing.assert_allclose(found.at_speed_after, [8.8, np.nan], atol=0.011)
    np.testing.assert_allclose(found.metres_lost, [30 - 5 - 14, 30])
    np.testing.assert_allclose(found.speed_in_the_end, [2, 0])


@pytest.mark.parametrize("place", range(len(turning.TURNS)))
def test_the_way_is_that_of_the_environment(monkeypatch, place):
    """MuJoCo's swimmer, whose target is turned: the frame of the target differs, the water does not."""
    monkeypatch.setattr(turning, "SETTLED", 1.0)
    monkeypatch.setattr(turning, "AFTER", 1.0)
    policy, start = load_pretrained("swim3-value-gradient").policy, evaluation_states(3)[:1]
    parameters, angle = policy.problem.parameters, math.radians(turning.TURNS[place])
    seen = record_episode(policy, parameters, start[0], 2.0, lambda time: angle if time > 0.995 else 0.0)
    expected = st.rotate(seen.centers_of_mass()[100:] - seen.centers_of_mass()[100], -angle)
    way = turning.ways(policy, parameters, start)[place, :, 0]
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(way, expected, atol=1e-4)


def test_a_row_for_each_turn_and_start(tmp_path, monkeypatch):
    for name, seconds in (("SETTLED", 0.5), ("AFTER", 1.5), ("END", 0.5)):
        monkeypatch.setattr(turning, name, seconds)
    turning.main(policies=("swim3-paper",), starts=2, out=tmp_path / "turning.csv")
    table = turning.read_table(tmp_path / "turning.csv")
    assert table["turn"].tolist() == [90, 90, -90, -90, 180, 180]
    rows = turning.summary(tmp_path / "turning.csv").rows
    assert [row[:2] for row in rows] == [("`swim3-paper`", "90°"), ("`swim3-paper`", "180°")]


def test_the_table_averages_both_sides(tmp_path):
    columns = {
        "policy": ["p"] * 6, "turn": [90, 90, -90, -90, 180, 180], "start": [0, 1] * 3, "speed": [1.0] * 6,
        "turned_after": [1.0, 2.0, 3.0, math.nan, 4.0, 5.0], "at_speed_after": [math.nan] * 6,
        "metres_lost": [1.0, 2.0, 3.0, 4.0, 5.0, 7.0], "speed_in_the_end": [1.0] * 6,
    }  # fmt: skip
    turning.write_table(tmp_path / "t.csv", turning.COLUMNS, list(zip(*columns.values(), strict=True)))
    sides, back = turning.summary(tmp_path / "t.csv").rows
    assert sides[2:6] == ("1 of 4", "1.00 [1.00, 1.00]", "2.00; 1 of 2", "none")
    assert sides[6:] == ("2.50 [-3.85, 8.85]", "1.00 [1.00, 1.00]")
    assert back[6] == "6.00 [-6.71, 18.71]"
