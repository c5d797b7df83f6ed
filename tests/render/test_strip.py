import dataclasses

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.text import Annotation

from swimmer_mj import SwimmerParameters
from swimmer_mj.render.chain import POSE
from swimmer_mj.render.figures import save_figure
from swimmer_mj.render.strip import film_strip
from swimmer_mj.state import expand, joint_positions
from swimmer_mj.trajectory import Trajectory


def poses(figure):
    """The ends of the links as drawn, shape (poses, n + 1, 2), m."""
    chains = [chain for chain in figure.axes[0].collections if chain.get_gid() == POSE]
    outlines = [np.array(chain.get_segments())[1::3] for chain in chains]  # between clear space and filling
    return np.array([[*outline[:, 0], outline[-1, 1]] for outline in outlines])


def arrows(figure):
    """Directions of the arrows, rad."""
    annotations = [text for text in figure.axes[0].texts if isinstance(text, Annotation)]
    shafts = np.array([np.subtract(arrow.xy, arrow.xyann) for arrow in annotations])
    return np.arctan2(shafts[:, 1], shafts[:, 0])


def labels(figure):
    return [text.get_text() for text in figure.axes[0].texts if text.get_text().endswith(" s")]


@pytest.mark.parametrize(
    ("options", "count", "rows"),
    [
        ({}, 30, ["0.0 s", "1.0 s", "2.0 s"]),
        ({"interval": 0.25, "per_row": 5}, 12, ["0.0 s", "1.2 s", "2.5 s"]),
        ({"start": 0.5, "stop": 1.75}, 13, ["0.5 s", "1.5 s"]),
        ({"start": 1.0, "stop": 1.0}, 1, ["1.0 s"]),
    ],
)
def test_number_of_poses_and_times_of_rows(episode, options, count, rows):
    figure = film_strip(episode, **options)
    assert len(poses(figure)) == count
    assert labels(figure) == rows


def test_poses_of_a_row_stand_in_their_true_relative_place(episode):
    drawn = poses(film_strip(episode))
    true = joint_positions(episode.parameters, episode.states[:300:10])
    for row in range(3):
        there, here = drawn[10 * row : 10 * row + 10], true[10 * row : 10 * row + 10]
        offsets = there - here  # one for all joints of a pose; from pose to pose one cell to the right
        np.testing.assert_allclose(offsets, np.broadcast_to(offsets[:, :1], offsets.shape), atol=1e-12)
        cells = np.diff(offsets[:, 0], axis=0)
        np.testing.assert_allclose(cells, np.broadcast_to(cells[0], cells.shape), atol=1e-12)
        assert cells[0, 0] > 1.0
        assert cells[0, 1] == pytest.approx(0.0, abs=1e-12)


def test_cells_do_not_overlap(episode):
    drawn = poses(film_strip(episode)).reshape(3, 10, 6, 2)
    assert (drawn[:, 1:, :, 0].min(axis=-1) > drawn[:, :-1, :, 0].max(axis=-1)).all()
    assert (drawn[1:, ..., 1].max(axis=(1, 2)) < drawn[:-1, ..., 1].min(axis=(1, 2))).all()


def test_arrows_show_the_target_of_each_row_and_its_reversal(episode):
    in_rows_then_legend = [0.0, 0.0, np.pi, np.pi, 0.0]  # the second row turns at 1.5 s
    directions = arrows(film_strip(episode))
    np.testing.assert_allclose(np.cos(directions), np.cos(in_rows_then_legend))


def test_nothing_is_cut_off(episode):
    figure = film_strip(episode)
    axes = figure.axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    drawn = poses(figure)
    assert left < drawn[..., 0].min()
    assert drawn[..., 0].max() < right
    assert bottom < drawn[..., 1].min()
    assert drawn[..., 1].max() < top
    figure.draw_without_rendering()
    for text in axes.texts:
        box = text.get_window_extent().transformed(figure.transFigure.inverted())
        assert box.x0 > 0, text
        assert box.x1 < 1, text
        assert box.y0 > 0, text
        assert box.y1 < 1, text


def test_the_scale_is_true(episode):
    figure = film_strip(episode)
    figure.draw_without_rendering()
    width, height = figure.get_size_inches()
    axes = figure.axes[0]
    assert np.diff(axes.get_xlim())[0] / width == pytest.approx(np.diff(axes.get_ylim())[0] / height)
    links = np.linalg.norm(np.diff(poses(figure), axis=1), axis=-1)
    np.testing.assert_allclose(links, 1.0)
    bar = [line for line in axes.lines if line.get_gid() == "scale"]
    assert [np.ptp(line.get_xdata()) for line in bar] == [pytest.approx(1.0)]


def test_the_file_has_the_size_declared_and_a_white_edge(tmp_path, episode):
    figure = film_strip(episode)
    save_figure(figure, tmp_path / "strip.png", dpi=100)
    pixels = imread(tmp_path / "strip.png")[..., :3]
    width, height = figure.get_size_inches()
    assert pixels.shape == (int(100 * height), int(100 * width), 3)
    assert (pixels.min(axis=-1) < 0.3).mean() > 0.01
    edge = np.concatenate(
        [pixels[:3].reshape(-1, 3), pixels[-3:].reshape(-1, 3), pixels[:, :3].reshape(-1, 3)]
    )
    np.testing.assert_array_equal(edge, 1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["strip.png"]


def test_a_long_chain_is_not_cut_off(chain, check_whole):
    check_whole(film_strip(chain(16)))


def test_an_episode_that_begins_later_is_drawn_whole(episode):
    later = dataclasses.replace(episode, times=episode.times + 5.0)
    assert labels(film_strip(later)) == ["5.0 s", "6.0 s", "7.0 s"]


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_vectors_are_vectors(tmp_path, episode, suffix):
    save_figure(film_strip(episode, start=0.0, stop=0.5), path := tmp_path / f"strip.{suffix}")
    content = path.read_bytes()
    assert content.startswith({"svg": b"<?xml", "pdf": b"%PDF-"}[suffix])
    assert {"svg": b"<image", "pdf": b"/Subtype /Image"}[suffix] not in content
    if suffix == "svg":
        assert content.count(b'id="pose"') == 5
        assert b"stroke-linecap: round" in content


@pytest.mark.parametrize("n_links", [1, 8])
def test_any_number_of_links(n_links):
    parameters = SwimmerParameters(n_links, length=np.linspace(0.3, 2.0, n_links))
    x = expand(parameters, np.linspace(-1, 1, 2 * n_links + 2))
    trajectory = Trajectory(parameters, [0.0], [x], np.empty((0, n_links - 1)), [1.0], [0.0], [0.0])
    assert poses(film_strip(trajectory)).shape == (1, n_links + 1, 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"interval": 0.0}, "interval must be positive and finite, got 0.0"),
        ({"interval": np.inf}, "interval must be positive and finite, got inf"),
        ({"per_row": 0}, "per_row must be at least 1, got 0"),
        ({"start": -1.0}, "start and stop must lie in the trajectory's 0 to 3 s, got -1.0 and 3.0"),
        ({"stop": 3.5}, "start and stop must lie in the trajectory's 0 to 3 s, got 0.0 and 3.5"),
    ],
)
def test_refusals(episode, options, message):
    with pytest.raises(ValueError, match=message):
        film_strip(episode, **options)
