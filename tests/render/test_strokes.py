import numpy as np
import pytest

from swimmer_mj.render.strokes import NoStrokeError, last_stroke, steady_part


@pytest.mark.parametrize("period", [0.5, 0.83, 1.4])
def test_a_stroke_lasts_a_period(swimming, waves, period):
    stroke = last_stroke(swimming(waves(period)))
    assert stroke.duration == pytest.approx(period, abs=0.011)
    assert (stroke.last, stroke.last - stroke.first) == (600, round(stroke.duration / 0.01))
    assert stroke.mismatch < 0.05


def test_links_that_go_round_stroke_too(swimming):
    times = np.arange(0, 6, 0.01)
    turning = np.column_stack([2 * np.pi * times / 0.9, np.sin(2 * np.pi * times / 0.9)])
    assert last_stroke(swimming(turning)).duration == pytest.approx(0.9, abs=0.011)


def test_the_steady_part_is_of_the_longest_swim_in_one_direction(swimming, waves):
    directions = np.where(np.arange(601) < 400, 0.0, np.pi)
    trajectory = swimming(waves(0.7), directions)
    part = steady_part(trajectory)
    assert (part.start, part.stop) == (133, 400)
    assert last_stroke(trajectory).last == 399


@pytest.mark.parametrize(
    "angles",
    [
        lambda _: np.cumsum(np.random.default_rng(0).normal(size=(600, 2)), axis=0),
        lambda _: np.full((600, 2), 0.4),
        lambda waves: waves(5.0),
        lambda waves: waves(0.5)[:3],
    ],
    ids=["random", "still", "too slow to repeat", "too short"],
)
def test_what_does_not_repeat_is_refused(swimming, waves, angles):
    with pytest.raises(NoStrokeError, match=r"no stroke .* draw a longer"):
        last_stroke(swimming(angles(waves)))
