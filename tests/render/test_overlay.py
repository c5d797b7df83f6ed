import math

import numpy as np
import pytest

from swimmer_mj import PAPER
from swimmer_mj.render.overlay import draw_arcs, draw_moment, make_panel, write
from swimmer_mj.render.video import frames
from swimmer_mj.state import expand, joint_positions
from swimmer_mj.trajectory import Trajectory


def violet(frame):
    """Rows and columns of the arcs' colour, shape (pixels, 2)."""
    rgb = frame.astype(int)
    return np.argwhere((rgb[..., 2] - rgb[..., 1] > 60) & (rgb[..., 0] - rgb[..., 1] > 25))


def arcs(angle, level, radius=30.0):
    frame = np.full((201, 201, 3), 255, np.uint8)
    draw_arcs(frame, np.array([[100.0, 100.0]]), np.array([angle]), np.array([level]), radius)
    return violet(frame) - 100


def test_an_arc_opens_towards_its_link_and_its_head_is_where_the_torque_turns_it_to():
    for angle in (0.0, 2.0):
        rows, columns = arcs(angle, 1.0).T
        along = columns * math.cos(angle) - rows * math.sin(angle)
        left = -columns * math.sin(angle) - rows * math.cos(angle)
        assert along.mean() > 10
        assert (left > 0).sum() > 1.2 * (left < 0).sum(), "anticlockwise: the head is on the left of the link"
        rows, columns = arcs(angle, -1.0).T
        left = -columns * math.sin(angle) - rows * math.cos(angle)
        assert (left < 0).sum() > 1.2 * (left > 0).sum()


def test_an_arc_is_as_long_as_its_torque_is_strong():
    whole, half, none = (len(arcs(0.0, level)) for level in (1.0, 0.5, 0.0))
    assert whole > 1.25 * half > 0
    assert none == 0


def test_the_torques_of_a_frame_are_at_their_joints():
    z = np.zeros(12)
    z[:5] = [0.3, -0.5, 0.8, 0.0, -0.9]
    x = expand(PAPER, z)
    controls = np.array([[0.0, 5.0, 0.0, 0.0]])
    still = Trajectory(PAPER, [0.0, 0.1], [x, x], controls, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    size = {"width": 320, "height": 240, "fps": 10, "caption": False}
    (frame,), (plain,) = (list(frames(still, overlay=on, **size)) for on in (True, False))
    found = violet(frame)
    assert len(found) > 20 > len(violet(plain))
    water = 240 - 58
    scale = water / 2 / (1.6 * 5 * math.tan(math.radians(45) / 2))  # pixels to a metre, from 8 m above
    x, y = joint_positions(PAPER, x)[2]
    column, row = 160 + scale * x, water / 2 - scale * y  # the camera looks at the centre of mass, the origin
    distances = np.hypot(found[:, 0] - row, found[:, 1] - column) / scale
    assert 0.1 < distances.min()
    assert distances.max() < 0.6


@pytest.fixture(scope="module")
def panels(episode):
    return {count: make_panel([episode] * count, 640, 116) for count in (1, 2)}


def moment(panel, time, numbers):
    frame = np.full((200, 640, 3), 255, np.uint8)
    frame[200 - len(panel.picture) :] = panel.picture
    draw_moment(frame, panel, time, numbers)
    return frame.astype(int)


NOTHING = [[], [math.nan], [math.nan]]


def test_the_mark_goes_from_the_left_to_the_right_of_each_graph(panels):
    panel = panels[1]
    for time, share in ((0.0, 0.0), (1.5, 0.5), (3.0, 1.0), (9.0, 1.0)):
        changed = np.abs(moment(panel, time, NOTHING) - moment(panel, 0.75, NOTHING)).max(axis=(0, 2)) > 60
        for left, _, right, _ in panel.boxes:
            at = round(left + share * (right - left))
            assert changed[at - 1 : at + 2].any(), (time, left)
            assert not changed[int(left) + 60 : int(left) + 90].all()


def test_the_numbers_stand_above_their_graphs(panels):
    panel = panels[2]
    plain = moment(panel, 1.0, NOTHING)
    both = moment(panel, 1.0, [[1.0, 2.0], [math.nan], [math.nan]])
    changed = np.argwhere(np.abs(both - plain).max(axis=-1) > 60)
    left, top, right, _ = panel.boxes[0]
    assert len(changed) > 40
    assert changed[:, 0].max() < 84 + top
    assert left < changed[:, 1].min() < changed[:, 1].max() <= right
    blue, orange = (
        (both - plain)[..., 2] - (both - plain)[..., 0],
        (both - plain)[..., 0] - (both - plain)[..., 2],
    )
    assert np.argwhere(blue > 60)[:, 1].mean() < np.argwhere(orange > 60)[:, 1].mean(), "the first one first"


def test_graphs_show_what_the_episode_has(panels, episode):
    V, H = (
        panels[1].picture.astype(int)[:, int(left) : int(right)] for left, _, right, _ in panels[1].boxes[1:]
    )
    rows = [np.argwhere(graph[..., 2] - graph[..., 0] > 100).T for graph in (V, H)]
    for (row, column), series in zip(rows, (episode.values, episode.hamiltonians), strict=True):
        share = column / max(1, column.max())
        expected = np.interp(share, np.linspace(0, 1, len(series)), series)
        assert np.corrcoef(-row, expected)[0, 1] > 0.97


def test_text_is_where_it_is_put():
    frame = np.full((60, 200, 3), (120, 180, 200), np.uint8)
    write(frame, (20, 40), "t = 1.00 s", "#000000", 20, halo=2)
    dark = np.argwhere(frame.max(axis=-1) < 60)
    light = np.argwhere(frame.min(axis=-1) > 235)
    assert 18 < dark[:, 1].min() < 26
    assert 24 < dark[:, 0].min() < dark[:, 0].max() <= 40
    assert len(light) > 100
    assert light[:, 1].min() < dark[:, 1].min()


@pytest.mark.parametrize("place", [(-8, 12), (40, 70), (190, 4), (300, 30), (20, -40)])
def test_text_that_does_not_fit_is_cut_off_and_the_rest_is_untouched(place):
    """As the same text in a larger frame."""
    frame, larger = (np.full((h, w, 3), (120, 180, 200), np.uint8) for h, w in ((60, 200), (260, 600)))
    write(frame, place, "12.34 m", "#1a55a0", 20, halo=2)
    write(larger, (place[0] + 200, place[1] + 100), "12.34 m", "#1a55a0", 20, halo=2)
    np.testing.assert_array_equal(frame, larger[100:160, 200:400])
