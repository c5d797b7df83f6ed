"""The wave that looks at nothing: its torques, its speed on two engines, and the numbers that are quoted of it."""

import csv

import numpy as np
import open_loop_wave
import pytest

from swimmer_mj.render.curves import OPEN_LOOP_SPEED


def test_torques_of_a_wave():
    """With a quarter of a turn from joint to joint, the third lags by half a period."""
    period, lag = np.array([2.0]), np.array([np.pi / 2])
    along = np.array([open_loop_wave.wave(3, period, lag, t)[:, 0] for t in (0.25, 0.75, 1.25, 1.75)])
    np.testing.assert_array_equal(along[:, 0], [1, 1, -1, -1])
    np.testing.assert_array_equal(along[:, 1], np.roll(along[:, 0], 1))
    np.testing.assert_array_equal(along[:, 2], -along[:, 0])


def test_speed_is_that_from_10_to_20_s_in_whatever_direction():
    def velocity(t):
        return np.array([[3.0, 1.0], [-4.0, 0.0]]) if t >= 10 - 1e-9 else np.full((2, 2), 9.0)

    np.testing.assert_allclose(open_loop_wave.net_speed(velocity), [5.0, 1.0])


def test_mujoco_swims_the_wave_as_the_equations_do(monkeypatch):
    """The one by Runge-Kutta, the other by Euler steps; over a time in which they have not drifted apart."""
    monkeypatch.setattr(open_loop_wave, "EPISODE_DURATION", 1.0)
    monkeypatch.setattr(open_loop_wave, "SETTLING_TIME", 0.0)
    speed = open_loop_wave.on_equations(5, np.array([1.75]), np.array([0.9]), seed=3)
    assert speed[0] > 0.1
    assert open_loop_wave.on_mujoco(5, 1.75, 0.9, seed=3) == pytest.approx(speed[0], rel=0.05)


def test_what_pictures_quote_is_in_the_log():
    with open_loop_wave.OUT.open(newline="") as file:
        found = {int(row["links"]): round(float(row["speed_on_mujoco"]), 2) for row in csv.DictReader(file)}
    assert found == OPEN_LOOP_SPEED
