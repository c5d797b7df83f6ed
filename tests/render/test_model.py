import math

import mujoco
import numpy as np
import pytest

from swimmer_mj.render.model import model_frames

SIZE = {"width": 96, "height": 72}
STEP = 0.1
"""s."""


def slide(steps):
    """A white ball over the dark that moves to the right by 0.2 m a step, seen from above."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><light pos='0 0 5'/><camera pos='0 0 4'/>"
        "<body><joint name='x' type='slide' axis='1 0 0'/><geom size='0.3' rgba='1 1 1 1'/></body>"
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    for k in range(steps):
        data.qpos[0] = 0.2 * k - 1
        mujoco.mj_forward(model, data)
        yield model, data, STEP


def columns(frames):
    """Where the ball is."""
    return [np.argwhere(frame.min(axis=-1) > 60)[:, 1].mean() for frame in frames]


@pytest.mark.parametrize("fps", [5, 10, 20])
def test_frames_go_by_in_real_time(fps):
    """A frame between two states shows the later one."""
    each = columns(model_frames(slide(10), fps=10, **SIZE))
    assert (np.diff(each) > 3).all()
    later = [math.ceil(k / fps / STEP - 1e-9) for k in range(1 + math.floor(9 * STEP * fps + 1e-9))]
    found = columns(model_frames(slide(10), fps=fps, **SIZE))
    assert found == pytest.approx([each[k] for k in later])
    assert len(found) == len(later)


def test_samples_smooth_edges():
    plain, smooth = (
        len(np.unique(next(model_frames(slide(1), samples=samples, **SIZE)).reshape(-1, 3), axis=0))
        for samples in (0, 4)
    )
    assert smooth > 1.1 * plain


@pytest.mark.parametrize(
    ("name", "value"), [("width", 0), ("height", -1), ("fps", 0.0), ("fps", math.inf), ("fps", math.nan)]
)
def test_what_is_not_positive_and_finite_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value}"):
        model_frames(slide(1), **{name: value})
