import matplotlib.text
import numpy as np

from swimmer_mj.learning.experiments.gaits.gait import BEST, load_gaits
from swimmer_mj.render.chain import POSE
from swimmer_mj.render.gaits import POSES, SHOWN, draw_gaits


def test_pulls_and_strokes(check_whole):
    gaits = {n: load_gaits(BEST / f"swim{n}.npz") for n in (3, 5)}
    figure = draw_gaits(gaits)
    pull, *strokes = figure.axes
    for line, n in zip(pull.lines, (3, 5), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), list(gaits[n]))
        np.testing.assert_array_equal(line.get_ydata(), [gait.pull for gait in gaits[n].values()])
    assert len(strokes) == min(SHOWN, len(gaits[5]))
    for axes in strokes:
        assert sum(artist.get_gid() == POSE for artist in axes.collections) == POSES
        assert len(axes.findobj(matplotlib.text.Text)) >= POSES
    check_whole(figure)
