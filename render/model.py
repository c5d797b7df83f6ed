"""Any MuJoCo model in motion, as MuJoCo draws it."""
# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from swimmer_mj.render.backend import use_backend
from swimmer_mj.render.video import Frame

__all__ = ["model_frames"]


def model_frames(
    motion: Iterable[tuple[Any, Any, float]],
    *,
    width: int = 640,
    height: int = 480,
    fps: float = 30,
    samples: int = 0,
) -> Iterator[Frame]:
    """Draw a moving model in real time, without a screen, from its first camera or, if it has none, from aside.

    Parameters
    ----------
    motion : iterable of (MjModel, MjData, float)
        The model, its data before each step, and how long the step is, s; the data may change in between. The model's
        settings of the off-screen buffer become those of the frames.
    width, height : int
        Size of a frame, pixels.
    fps : float
        Frames per second.
    samples : int
        Multisampling, which smooths edges.

    Yields
    ------
    ndarray of uint8, shape (height, width, 3)
    """
    for name, value in {"width": width, "height": height, "fps": fps}.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
    use_backend()
    return _draw(motion, width, height, fps, samples)


def _draw(
    motion: Iterable[tuple[Any, Any, float]], width: int, height: int, fps: float, samples: int
) -> Iterator[Frame]:
    import mujoco  # bound to the backend only now

    renderer, time, drawn = None, 0.0, 0
    for model, data, step in motion:
        if renderer is None:
            model.vis.global_.offwidth, model.vis.global_.offheight = width, height
            model.vis.quality.offsamples = samples
            renderer = mujoco.Renderer(model, height, width)
        while drawn <= time * fps + 1e-9:
            renderer.update_scene(data, 0 if model.ncam else -1)
            yield renderer.render()
            drawn += 1
        time += step
    if renderer is not None:
        renderer.close()
