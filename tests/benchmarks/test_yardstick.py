"""What learners are timed and measured by."""

import dataclasses
import time

import numpy as np
import pytest
import robustness
import yardstick

from swimmer_mj.learning.problems.swim.environment import (
    distances,
    evaluate_swimming,
    evaluation_states,
    mean_speed,
)
from swimmer_mj.parameters import PAPER, SwimmerParameters


def test_the_clock_stands_still_between_stop_and_start(monkeypatch):
    now = {"process_time": 5.0, "perf_counter": 70.0}
    for name in now:
        monkeypatch.setattr(time, name, lambda name=name: now[name])

    def passes(processor, wall):
        now["process_time"] += processor
        now["perf_counter"] += wall

    clock = yardstick.Clock()
    passes(1.0, 3.0)
    assert clock.read() == (1.0, 3.0)
    clock.stop()
    passes(10.0, 30.0)
    clock.start()
    passes(0.5, 1.0)
    assert clock.read() == (1.5, 4.0)


def test_looks_come_when_it_is_time_and_take_none(monkeypatch):
    """A learner of a second a step, looks of 100 s: at 2 and 5 s, and at the end."""
    now = {"process_time": 5.0, "perf_counter": 70.0}
    for name in now:
        monkeypatch.setattr(time, name, lambda name=name: now[name])

    def passes(seconds):
        for name in now:
            now[name] += seconds

    seen = []
    for clock in yardstick.looks(lambda: passes(1.0), (2.0, 4.5, 9.0), 7.0):
        passes(100.0)
        seen.append(clock.before)
    assert seen == [(2.0, 2.0), (5.0, 5.0), (7.0, 7.0)]


def test_swimming_speed_is_that_of_the_library(monkeypatch):
    """Of one policy, by vector environment and by dm_control; of three episodes, to be quick."""
    monkeypatch.setattr(yardstick, "N_EPISODES", 3)
    monkeypatch.setattr(yardstick, "evaluation_states", lambda n_links: evaluation_states(n_links, 3))
    swimmer = SwimmerParameters(n_links=3)
    gain = np.array([[1.0, -2.0, 0.3], [0.5, 1.0, -1.0]])

    def act(states):
        return np.tanh(states[:, 3:6] @ gain.T + np.sin(states[:, :3]) @ gain.T)

    def agent(observation):
        return np.tanh(observation["angular_velocities"] @ gain.T + np.sin(observation["angles"]) @ gain.T)

    fast, slow = yardstick.swimming_speed(act, swimmer), evaluate_swimming(agent, swimmer, n_episodes=3)
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-9)
    assert np.ptp(slow.speeds) > 0.01
    spans = ((1.0, 3.0), (10.0, 20.0))
    early, late = yardstick.swimming_speeds(act, spans, swimmer)
    travelled = distances(agent, swimmer, evaluation_states(3, 3), 3.0)
    np.testing.assert_allclose(early.speeds, mean_speed(travelled, *spans[0]), atol=1e-9)
    np.testing.assert_array_equal(late.speeds, fast.speeds)


def test_each_changed_swimmer_is_off_in_what_it_says():
    swimmers = dict(robustness.changed_swimmers())
    assert swimmers.pop("none") == PAPER
    fields = {field.name for field in dataclasses.fields(PAPER)}
    for change, swimmer in swimmers.items():
        ratios = {
            name: np.asarray(getattr(swimmer, name)) / np.asarray(getattr(PAPER, name)) for name in fields
        }
        off = {name for name, ratio in ratios.items() if not np.allclose(ratio, 1)}
        if change.startswith("all"):
            assert off == {"mass", "length", "viscous_friction", "torque_limit"}
            assert all((abs(ratio - 1) <= 0.1 + 1e-12).all() for ratio in ratios.values())
            continue
        what, way = change.rsplit(" ", 1)
        (name,) = off
        assert name == {"friction": "viscous_friction"}.get(what, what.replace(" ", "_"))
        np.testing.assert_allclose(ratios[name], {"up": 1.1, "down": 0.9}[way])


def test_a_table_is_filled_once_and_a_learner_that_fails_leaves_no_row(tmp_path):
    """Keys are told apart by all their columns."""
    out, columns, learned = tmp_path / "log.csv", ("task", "settings", "seed", "speed"), []

    def learn(task, settings, seed):
        learned.append((task, settings, seed))
        yield task, settings, seed, "1.0"
        if settings == "bad":
            raise RuntimeError
        yield task, settings, seed, "2.0"

    yardstick.fill(out, columns, [("swim", "a", 0), ("swim", "a", 1)], learn)
    with pytest.raises(RuntimeError):
        yardstick.fill(out, columns, [("swim", "a", 1), ("swim", "bad", 1)], learn)
    yardstick.fill(out, columns, [("swim", "b", 1)], learn)
    assert learned == [("swim", "a", 0), ("swim", "a", 1), ("swim", "bad", 1), ("swim", "b", 1)]
    rows = ["swim,a,0,1.0", "swim,a,0,2.0", "swim,a,1,1.0", "swim,a,1,2.0", "swim,b,1,1.0", "swim,b,1,2.0"]
    assert out.read_text().split() == [",".join(columns), *rows]
