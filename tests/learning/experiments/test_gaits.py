"""The best known gaits as they are stored; CasADi is not needed."""

from dataclasses import replace

import numpy as np
import pytest

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer, friction_forces, friction_moments
from swimmer_mj.learning.experiments.gaits import starts
from swimmer_mj.learning.experiments.gaits.gait import (
    BEST,
    SAMPLES,
    Gait,
    crossing_shares,
    load_gaits,
    mean_power,
    save_gaits,
)
from swimmer_mj.learning.experiments.gaits.replay import periodic_feedback, replay
from swimmer_mj.parameters import SwimmerParameters

FILES = sorted(BEST.glob("swim*.npz"))
GAITS = [
    pytest.param(speed, gait, id=f"{path.stem} {speed:g}")
    for path in FILES
    for speed, gait in load_gaits(path).items()
]


def test_gaits_of_several_swimmers_are_there():
    assert {"swim3", "swim5"} <= {path.stem for path in FILES}
    assert sum(path.stat().st_size for path in FILES) < 400 * 1024


@pytest.mark.parametrize("speed", [0.1, 3.0, 100.0])
def test_a_straight_chain_glides_at_any_speed(speed):
    """So that there is no fastest gait without a pull."""
    p = SwimmerParameters(n_links=5)
    z = st.join_reduced(np.zeros(5), np.zeros(5), [speed, 0.0])
    x = st.expand(p, z)
    np.testing.assert_allclose(
        st.reduce_derivative(p, x, AnalyticSwimmer(p).drift(x)), np.zeros(12), atol=1e-12
    )


@pytest.mark.parametrize(("speed", "gait"), GAITS)
def test_a_stored_gait_obeys_limits_and_equations_and_closes(speed, gait):
    """By DOP853 on A.3 from every node, the last of which is the first after whole turns."""
    assert (np.abs(gait.controls) <= gait.parameters.torque_limits).all()
    np.testing.assert_array_equal(gait.turns, gait.turns.round())
    assert np.abs(gait.fine[1]).max() < 1e-5
    assert gait.speed == pytest.approx(speed, abs=1e-5)
    assert gait.pull > 0


@pytest.mark.parametrize(("speed", "gait"), GAITS[:2])
def test_power_goes_into_friction_and_against_the_pull(speed, gait):
    p, x = gait.parameters, gait.fine[0]
    state = st.split(x, p.n_links)
    normals = st.link_normals(state.angles)
    swung = (p.lengths * state.angular_velocities)[..., None] * normals
    centers = state.velocity[..., None, :] + np.cumsum(swung, axis=-2) - swung / 2
    forces = friction_forces(p.viscous_friction, p.lengths, centers, normals)
    moments = friction_moments(p.viscous_friction, p.lengths, state.angular_velocities)
    friction = (forces * centers).sum(axis=(-1, -2)) + (moments * state.angular_velocities).sum(axis=-1)
    lost = -np.trapezoid(friction, axis=1).mean() / SAMPLES
    power, positive = mean_power(gait)
    assert power == pytest.approx(lost + p.masses.sum() * gait.pull * speed, rel=0.02)
    assert positive >= power


@pytest.mark.parametrize("links", [3, 5])
def test_a_gait_holds_on_mujoco_with_feedback_only(links):
    gait = load_gaits(BEST / f"swim{links}.npz")[2.0]
    feedback = periodic_feedback(gait)
    disturbance = np.random.default_rng(1).normal(0.0, 1e-3, gait.states.shape[1])
    held = replay(gait, feedback, 16, disturbance)
    np.testing.assert_allclose(held.speeds[-8:], 2.0, rtol=0.005)
    assert held.distances[-1] < 0.1
    free = replay(gait, replace(feedback, gains=np.zeros_like(feedback.gains)), 16, disturbance)
    assert free.distances[-1] > 10 * held.distances[-1]


def test_links_that_cross():
    """Folded into a triangle and beyond, the last of three links crosses the first; straight, none does."""
    p = SwimmerParameters(n_links=3)

    def still(angles):
        z = np.tile(st.join_reduced(angles, np.zeros(3), [0.0, 0.0]), (2, 1))
        return Gait(p, 1e-3, z, np.zeros((2, 2)), np.zeros(3))

    assert crossing_shares(still([0.0, np.radians(130), np.radians(260)])) == {(1, 3): 1.0}
    assert crossing_shares(still([0.0, np.radians(100), np.radians(200)])) == {}
    assert crossing_shares(still([0.0, 0.1, 0.2])) == {}


def test_files_keep_gaits(tmp_path):
    gait = starts.wave(SwimmerParameters(n_links=4), 1.5, 1.0, 12)
    save_gaits({1.5: gait, 0.5: replace(gait, pull=0.25)}, tmp_path / "gaits.npz")
    found = load_gaits(tmp_path / "gaits.npz")
    assert list(found) == [0.5, 1.5]
    assert (found[0.5].pull, found[1.5].duration) == (0.25, 1.5)
    np.testing.assert_array_equal(found[1.5].states, gait.states)
    assert load_gaits(tmp_path / "none.npz") == {}


def test_the_shortest_recurrence_of_a_stroke():
    t = starts.DT * np.arange(1000)
    angles = np.stack([np.sin(2 * np.pi * t / 0.8), np.cos(2 * np.pi * t / 0.8)], axis=1)
    states = np.concatenate(
        [angles, np.gradient(angles, axis=0), np.sin(4 * np.pi * t / 0.8)[:, None]], axis=1
    )
    assert starts.shortest_recurrence(states, 2) == 80


def test_a_link_more_and_another_speed():
    gait = starts.wave(SwimmerParameters(n_links=3), 1.0, 1.5, 10)
    more = starts.at_speed(starts.with_a_link_more(gait), 1.25)
    assert more.states.shape == (10, 10)
    assert more.states[:, -2].mean() == pytest.approx(1.25)
    np.testing.assert_array_equal(more.states[:, 3], more.states[:, 2])


def test_resampling_keeps_the_stroke():
    gait = starts.wave(SwimmerParameters(n_links=3), 1.0, 1.5, 40)
    twice = gait.resampled(80)
    np.testing.assert_allclose(twice.states[::2], gait.states)
    assert twice.duration == gait.duration
