"""The swimmer as MuJoCo draws it: frames of a trajectory, and a video file of frames."""
# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from swimmer_mj.files import replacing
from swimmer_mj.mjcf import mjcf
from swimmer_mj.render.backend import use_backend
from swimmer_mj.trajectory import Trajectory

__all__ = ["Frame", "frames", "write_video"]

Frame = NDArray[np.uint8]
"""RGB, shape (height, width, 3)."""


def frames(
    trajectory: Trajectory,
    *,
    width: int = 640,
    height: int = 480,
    fps: int = 30,
    camera: str = "tracking",
    samples: int = 0,
    caption: bool = True,
) -> Iterator[Frame]:
    """Draw ``trajectory`` in real time, without a screen.

    Nothing is simulated: each frame shows the recorded state nearest to its time. A mark ahead of the swimmer
    shows the target direction.

    Parameters
    ----------
    trajectory : Trajectory
        What to draw.
    width, height : int
        Size of a frame, pixels.
    fps : int
        Frames per second; frame k is at the time k / fps after the first state.
    camera : {"tracking", "top"}
        Follow the centre of mass, or stay where the swimmer started.
    samples : int
        Multisampling, which smooths edges. On the CPU, 4 takes three times as long as 0.
    caption : bool
        Write the time and the speed along the target direction into the frame.

    Yields
    ------
    ndarray of uint8, shape (height, width, 3)
        As many frames as make up the trajectory's duration, at least one.

    Raises
    ------
    BackendError
        If no OpenGL backend can be used (see :mod:`swimmer_mj.render.backend`).
    """
    for name, value in {"width": width, "height": height, "fps": fps}.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value!r}")
    if camera not in ("tracking", "top"):
        raise ValueError(f"camera must be 'tracking' or 'top', got {camera!r}")
    use_backend()
    return _draw(trajectory, width, height, fps, camera, samples, caption)


def _draw(
    trajectory: Trajectory, width: int, height: int, fps: int, camera: str, samples: int, caption: bool
) -> Iterator[Frame]:
    # Bound to the backend only now; dynamics imports mujoco too.
    import mujoco

    from swimmer_mj.dynamics import to_qpos_qvel

    parameters, lengths = trajectory.parameters, trajectory.parameters.lengths
    model = mujoco.MjModel.from_xml_string(mjcf(parameters))
    model.vis.global_.offwidth = width
    model.vis.global_.offheight = height
    model.vis.quality.offsamples = samples
    data = mujoco.MjData(model)
    mark = model.body("target").mocapid[0]
    centers, speeds = trajectory.centers_of_mass(), trajectory.speeds()
    font = _font(max(12, height // 28)) if caption else None

    with mujoco.Renderer(model, height, width) as renderer:
        for k in range(max(1, round(trajectory.duration * fps))):
            i = trajectory.index_at(trajectory.times[0] + k / fps)
            direction = trajectory.target_directions[i]
            data.qpos[:] = to_qpos_qvel(trajectory.states[i], parameters.n_links).qpos
            ahead = (lengths.sum() / 2 + 1.0) * np.array([np.cos(direction), np.sin(direction)])
            data.mocap_pos[mark, :2] = centers[i] + ahead
            data.mocap_quat[mark] = np.cos(direction / 2), 0.0, 0.0, np.sin(direction / 2)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)  # the tracking camera follows it
            mujoco.mj_camlight(model, data)
            renderer.update_scene(data, camera)
            frame = renderer.render()
            if font is not None:
                # U+2212 is as wide as a plus sign.
                text = f"t = {trajectory.times[i]:.2f} s    speed along target {speeds[i]:+.2f} m/s"
                frame = _captioned(frame, text.replace("-", "\N{MINUS SIGN}"), font)
            yield frame


def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and whose figures are all of one width."""
    return ImageFont.truetype(os.path.join(matplotlib.get_data_path(), "fonts/ttf/DejaVuSans.ttf"), size)


def _captioned(frame: Frame, text: str, font: ImageFont.FreeTypeFont) -> Frame:
    """``frame`` with ``text`` at its lower left."""
    image = Image.fromarray(frame)
    position = (0.6 * font.size, image.height - 0.6 * font.size)
    ImageDraw.Draw(image).text(
        position, text, (26, 26, 26), font, anchor="ls", stroke_width=2, stroke_fill=(245, 248, 250)
    )
    return np.asarray(image)


def write_video(path: str | os.PathLike[str], frames: Iterable[Frame], fps: int = 30) -> int:
    """Encode ``frames`` as H.264 in the container of the suffix of ``path``, which any browser plays.

    The file appears under its name only when it is complete.

    Parameters
    ----------
    path : path-like
        Ends with .mp4, .mkv or .mov.
    frames : iterable of ndarray of uint8, shape (height, width, 3)
        All of one size, height and width even.
    fps : int
        Frames per second.

    Returns
    -------
    int
        Number of frames written.
    """
    import imageio.v2 as imageio

    if Path(path).suffix not in (".mp4", ".mkv", ".mov"):
        raise ValueError(f"a video's name must end with .mp4, .mkv or .mov, got {os.fspath(path)!r}")
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise ValueError("a video needs at least one frame")
    height, width, _ = first.shape
    if height % 2 or width % 2:
        raise ValueError(f"height and width of a video must be even, got {height} x {width}")
    with replacing(path) as partial:
        writer = imageio.get_writer(
            partial,
            format="FFMPEG",  # type: ignore[arg-type] - documented as a name
            mode="I",
            fps=fps,
            codec="libx264",
            pixelformat="yuv420p",
            quality=6,
            macro_block_size=2,
            output_params=["-preset", "veryfast", "-movflags", "+faststart"],
        )
        with contextlib.closing(writer):  # imageio's own context does not close after an exception
            count = 0
            for frame in itertools.chain([first], frames):
                if frame.shape != first.shape or frame.dtype != np.uint8:
                    raise ValueError(f"frame {count} is {frame.dtype} {frame.shape}, not uint8 {first.shape}")
                writer.append_data(frame)
                count += 1
        with imageio.get_reader(partial, format="FFMPEG") as reader:  # type: ignore[arg-type]
            if reader.count_frames() != count:  # a full disk, say
                raise OSError(f"ffmpeg did not write all {count} frames of {os.fspath(path)}")
    return count
