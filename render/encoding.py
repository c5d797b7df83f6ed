"""Frames as a file: H.264, GIF or WebP, by its suffix."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from swimmer_mj.files import replacing

__all__ = ["VIDEO_SUFFIXES", "Frame", "require_video", "write_video"]

Frame = NDArray[np.uint8]
"""RGB, shape (height, width, 3)."""


@dataclass(frozen=True)
class _Encoder:
    """What ffmpeg is asked for."""

    codec: str
    pixels: str
    """Its name of the encoder's pixel format."""
    options: tuple[str, ...]
    even: bool = False
    """Whether height and width must be even."""
    fastest: float = 1000.0
    """Frames a second."""


# The fastest encoding takes 7 ms a frame beside 10 for drawing it; "veryfast" doubles the whole for a third of the size
# (1.0 and 0.36 MB for 8 s).
_H264 = _Encoder(
    "libx264",
    "yuv420p",
    (
        "-preset",
        "ultrafast",
        "-crf",
        "23",
        "-sws_flags",
        "fast_bilinear",
        "-movflags",
        "+faststart",
    ),
    even=True,
)
# The palette is made of the first seconds, so that memory does not grow with the film; the swimmer's colours do not
# change. No dithering: it would crawl, and what stands still between two frames need not be stored again.
_GIF = _Encoder(
    "gif",
    "pal8",
    (
        "-filter_complex",
        "[0:v]split[all][first];[first]trim=end_frame=60,palettegen[palette];"
        "[all][palette]paletteuse=dither=none:diff_mode=rectangle",
        "-loop",
        "0",
    ),
    fastest=50.0,  # browsers show those that ask for more at 10
)
_WEBP = _Encoder("libwebp_anim", "yuv420p", ("-quality", "75", "-compression_level", "2", "-loop", "0"))
_ENCODERS = {".mp4": _H264, ".mkv": _H264, ".mov": _H264, ".gif": _GIF, ".webp": _WEBP}

VIDEO_SUFFIXES = tuple(_ENCODERS)
"""Of the files that :func:`write_video` writes."""


def require_video(path: str | os.PathLike[str], fps: float) -> None:
    """Raise ValueError unless :func:`write_video` can write ``fps`` frames a second to a file of this name."""
    suffix = Path(path).suffix
    if suffix not in _ENCODERS:
        names = f"{', '.join(VIDEO_SUFFIXES[:-1])} or {VIDEO_SUFFIXES[-1]}"
        raise ValueError(f"a video's name must end with {names}, got {os.fspath(path)!r}")
    if not fps > 0:
        raise ValueError(f"fps must be positive, got {fps!r}")
    if fps > (fastest := _ENCODERS[suffix].fastest):
        raise ValueError(
            f"a {suffix} file can have up to {fastest:g} frames per second, got {fps:g}; take fewer, or .mp4"
        )


def write_video(path: str | os.PathLike[str], frames: Iterable[Frame], fps: float = 30) -> int:
    """Encode ``frames`` in the format of the suffix of ``path``; any browser plays it.

    .mp4, .mkv and .mov have H.264; .gif and .webp repeat for ever. The file appears under its name only when it is
    complete.

    Parameters
    ----------
    path : path-like
        Ends with one of :data:`VIDEO_SUFFIXES`.
    frames : iterable of ndarray of uint8, shape (height, width, 3)
        All of one size; for H.264, height and width are even.
    fps : float
        Frames per second; of a GIF at most 50.

    Returns
    -------
    int
        Number of frames written.
    """
    require_video(path, fps)
    encoder = _ENCODERS[Path(path).suffix]
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise ValueError("a video needs at least one frame")
    height, width, _ = first.shape
    if encoder.even and (height % 2 or width % 2):
        raise ValueError(f"height and width of a video must be even, got {height} x {width}")
    with replacing(path) as partial:
        count = _encode(partial, _alike(itertools.chain([first], frames), first.shape), fps, encoder)
        if count is None or not _complete(partial, count):
            raise OSError(f"ffmpeg did not write all frames of {os.fspath(path)}; is there room on the disk?")
    return count


def _alike(frames: Iterable[Frame], shape: tuple[int, ...]) -> Iterator[Frame]:
    """``frames``, as long as they are of one kind."""
    for k, frame in enumerate(frames):
        if frame.shape != shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {k} is {frame.dtype} {frame.shape}, not uint8 {shape}")
        yield frame


def _encode(path: Path, frames: Iterator[Frame], fps: float, encoder: _Encoder) -> int | None:
    """Pipe ``frames`` to ffmpeg; their number, or None if it ends before they do."""
    first = next(frames)
    height, width, _ = first.shape
    pipe = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        pix_fmt_out=encoder.pixels,
        fps=fps,  # pyright: ignore[reportArgumentType] - typed by its default, as is the next
        quality=None,  # pyright: ignore[reportArgumentType]
        codec=encoder.codec,
        macro_block_size=2 if encoder.even else 1,
        output_params=[*encoder.options],
        ffmpeg_log_level="fatal",
    )
    with contextlib.closing(pipe):
        pipe.send(None)
        count = 0
        for frame in itertools.chain([first], frames):
            try:
                pipe.send(np.ascontiguousarray(frame))
            except OSError:
                return None
            count += 1
    return count


def _complete(path: Path, count: int) -> bool:
    """Whether the file can be read and has ``count`` frames; of WebP, equal frames in a row are one."""
    if path.suffix == ".gif" and not path.read_bytes().endswith(b";"):
        return False  # its last frame may be there in part
    if path.suffix != ".webp":
        try:
            return imageio_ffmpeg.count_frames_and_secs(str(path))[0] == count
        except RuntimeError:
            return False
    try:
        with Image.open(path) as picture:
            return 1 <= getattr(picture, "n_frames", 1) <= count
    except (OSError, SyntaxError):
        return False
