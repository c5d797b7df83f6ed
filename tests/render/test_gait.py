import itertools

import numpy as np
import pytest

from swimmer_mj.render.chain import POSE
from swimmer_mj.render.gait import POSES, gait_diagram
from swimmer_mj.render.phase_portraits import phase_portraits
from swimmer_mj.render.strokes import NoStrokeError

PERIOD = 0.8


@pytest.fixture(scope="module")
def swim(swimming, waves):
    """Joints turn as their torques; to the left, which is the target direction."""
    angles = waves(PERIOD)
    signs = np.sign(np.gradient(angles, axis=0))[:-1]
    return swimming(angles, np.full(601, np.pi), velocity=(-0.7, 0.0), controls=5.0 * signs)


def test_the_diagram_has_one_stroke(swim, waves, check_whole):
    figure = gait_diagram(swim)
    poses, torque, angle, speed = figure.axes
    assert "one stroke, 0.80 s" in poses.get_title(loc="left")
    for line in angle.lines:
        assert line.get_xdata()[[0, -1]] == pytest.approx([0, PERIOD])
    for line, series in zip(angle.lines, np.degrees(waves(PERIOD)[-81:]).T, strict=True):
        np.testing.assert_allclose(line.get_ydata(), series, atol=1e-9)
    assert speed.get_legend().get_texts()[0].get_text() == "mean 0.70 m/s"
    assert [label.get_text() for label in torque.get_yticklabels()] == ["$u_{1}$", "$u_{2}$"]
    positive = [
        patch for patch in torque.patches if patch.get_data().values.max() > patch.get_data().baseline
    ]
    shares = [(p.get_data().values > p.get_data().baseline + 0.1).mean() for p in positive]
    assert shares == pytest.approx([0.5, 0.5], abs=0.05)
    check_whole(figure)


def test_poses_have_one_scale_and_swim_to_the_right(swim):
    poses = gait_diagram(swim).axes[0]
    chains = [np.array(chain.get_segments())[1::3] for chain in poses.collections if chain.get_gid() == POSE]
    assert len(chains) == POSES
    np.testing.assert_allclose(np.linalg.norm(np.diff(chains, axis=2), axis=-1), 1.0, atol=1e-9)
    first = np.degrees(np.arctan2(*(chains[0][0, 1] - chains[0][0, 0])[::-1]))
    drawn = 180 - 180 / np.pi * 0.3 * np.sin(5.2)  # turned by half a turn, since the target is on the left
    assert (first - -drawn) % 360 == pytest.approx(0, abs=1e-6)
    spans = [(chain[..., 0].min(), chain[..., 0].max()) for chain in chains]
    assert all(before[1] < after[0] for before, after in itertools.pairwise(spans))


def test_heads_are_drawn_whole_however_flat_the_poses(swimming, waves):
    figure = gait_diagram(swimming(0.1 * waves(PERIOD)))
    figure.canvas.draw()
    poses = figure.axes[0]
    inside = poses.get_window_extent()
    heads = [line for line in poses.lines if line.get_marker() == "o"]
    assert len(heads) == POSES
    for head in heads:
        radius = head.get_markersize() / 2 * figure.dpi / 72
        x, y = poses.transData.transform(head.get_xydata()[0])
        assert inside.x0 <= x - radius < x + radius <= inside.x1
        assert inside.y0 <= y - radius < y + radius <= inside.y1


def test_no_diagram_without_a_stroke(swimming):
    with pytest.raises(NoStrokeError):
        gait_diagram(swimming(np.zeros((300, 2))))


def test_portraits_are_coloured_by_their_torques(swim, check_whole):
    figure = phase_portraits(swim)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in panels] == ["joint 1: links 1 and 2", "joint 2: links 2 and 3"]
    for axes in panels:
        thin, thick = axes.collections
        assert len(thick.get_segments()) == 80
        for lines in (thin, thick):
            rates = np.array(lines.get_segments())[..., 1].mean(axis=1)
            blue = lines.get_colors()[:, 2] > lines.get_colors()[:, 0]
            clear = np.abs(rates) > 0.3
            np.testing.assert_array_equal(blue[clear], (rates > 0)[clear])
        x, y = np.array(thick.get_segments())[:, 0].T  # an ellipse
        np.testing.assert_allclose(
            (x / np.degrees(0.8)) ** 2 + (y / (0.8 * 2 * np.pi / PERIOD)) ** 2, 1, atol=0.02
        )
    check_whole(figure)


@pytest.mark.parametrize("n_links", [2, 16])
def test_portraits_of_few_and_of_many_joints_are_whole(chain, check_whole, n_links):
    check_whole(phase_portraits(chain(n_links)))


def test_a_joint_that_goes_round_is_not_drawn_across(swimming, check_whole):
    times = np.arange(0, 6, 0.01)
    figure = phase_portraits(swimming(np.column_stack([4.0 * times, 0.5 * np.sin(4.0 * times)])))
    x = np.array(figure.axes[0].collections[0].get_segments())[..., 0]
    assert np.abs(x).max() <= 180
    assert np.abs(np.diff(x, axis=1)).max() < 10
    check_whole(figure)
