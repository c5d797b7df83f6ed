"""What a picture of an episode is to be: how long, how large, where to swim; said before anything is drawn."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

__all__ = [
    "PICTURES",
    "STILLS",
    "VIDEOS",
    "Picture",
    "Shot",
    "Size",
    "Steering",
    "parse_steering",
    "place_of",
    "places_in",
]

Size = Literal["640x480", "1280x720", "1920x1080"]
Picture = Literal["video", "film-strip", "learning-curve", "episode", "phase-portraits", "gait", "value-map"]

PICTURES: dict[Picture, str] = {
    "video": "swimmer.mp4",
    "film-strip": "film-strip.png",
    "learning-curve": "learning-curve.png",
    "episode": "episode.png",
    "phase-portraits": "phase-portraits.png",
    "gait": "gait.png",
    "value-map": "value-map.png",
}
"""And what their files are called."""
STILLS = (".png", ".svg", ".pdf")
VIDEOS = (".mp4", ".mkv", ".mov", ".gif", ".webp")
EPISODE = 13.0
"""s, as in figure 3."""
LONGEST, FASTEST = 3600.0, 240
"""s of an episode, frames a second; more are taken for a slip."""
SLOW = 4.0
"""How many times more slowly time goes in slow motion."""


@dataclass(frozen=True)
class Steering:
    """Directions to swim in, one after the other; the last one stays."""

    directions: tuple[float, ...]
    """rad, from the x axis."""
    hold: float
    """For how long each, s."""

    def __call__(self, time: float) -> float:
        """The direction at ``time`` (s)."""
        return self.directions[min(int((time + 1e-9) / self.hold), len(self.directions) - 1)]

    @property
    def duration(self) -> float:
        """Of all of them, s."""
        return self.hold * len(self.directions)


def parse_steering(text: str) -> Steering:
    """What ``--steer`` asks for: degrees with commas between them, then @ and seconds, as in "0,90,180@2s"."""
    number = r"[+-]?(?:\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"\s*({number}(?:\s*,\s*{number})*)\s*@\s*({number})\s*s?\s*", text)
    if found is None:
        raise ValueError(
            f"--steer must be directions in degrees and how long each is held, such as 0,90,180@2s, got {text!r}"
        )
    hold = float(found[2])
    if not 0.01 <= hold <= LONGEST:
        raise ValueError(f"--steer must hold each direction for 0.01 to {LONGEST:.0f} s, got {hold:g} s")
    return Steering(tuple(math.radians(float(degrees)) for degrees in found[1].split(",")), hold)


@dataclass(frozen=True)
class Shot:
    """An episode, and how its pictures look."""

    duration: float = EPISODE
    """s."""
    fps: int = 30
    """Frames a second."""
    size: Size = "640x480"
    overlay: bool = False
    slow: bool = False
    steering: Steering | None = None
    """Where to swim; without it the direction is reversed after 5/13 of the episode."""
    over: tuple[str, str] | None = None
    """The coordinates of the map of V."""
    at: float | None = None
    """Of which moment the map of V is, s; the last one by default."""

    def __post_init__(self) -> None:
        if not 1 <= self.duration < math.inf:
            raise ValueError(f"--duration must be finite and at least 1 s, got {self.duration}")
        if self.fps < 1:
            raise ValueError(f"--fps must be at least 1, got {self.fps}")
        if self.duration > LONGEST or self.fps > FASTEST:
            raise ValueError(
                f"--duration must be at most {LONGEST:.0f} s and --fps at most {FASTEST}, got {self.duration} and "
                f"{self.fps}"
            )
        if self.steering is not None and self.steering.duration > self.duration + 1e-9:
            raise ValueError(
                f"--steer takes {self.steering.duration:g} s, --duration is {self.duration:g} s: leave --duration out"
            )
        if self.at is not None and not 0 <= self.at <= self.duration:
            raise ValueError(f"--at must be between 0 and {self.duration:g} s, the episode, got {self.at}")

    @property
    def width(self) -> int:
        """Pixels."""
        return int(self.size.split("x")[0])

    @property
    def height(self) -> int:
        """Pixels."""
        return int(self.size.split("x")[1])

    @property
    def samples(self) -> int:
        """Multisampling: small videos are drawn quickly, large ones smoothly."""
        return 0 if self.size == "640x480" else 4

    @property
    def slowness(self) -> float:
        """How many times more slowly time goes than it did."""
        return SLOW if self.slow else 1.0


def places_in(directory: Path, picture: Picture | None = None) -> dict[Picture, Path]:
    """Where in ``directory`` the picture goes, or all of them."""
    return {name: directory / file for name, file in PICTURES.items() if picture in (None, name)}


def place_of(out: Path, picture: Picture | None, fps: int) -> dict[Picture, Path] | None:
    """What is to be drawn if ``out`` is the name of a picture's file; None if it is a directory's.

    By its suffix: a video, or a still picture, the film strip if none is named. Another one of several letters is taken
    for a slip, unless the directory is there.
    """
    if out.is_dir() or sum(map(str.isalpha, out.suffix)) < 2:
        return None
    if out.suffix.lower() not in (*STILLS, *VIDEOS):
        raise ValueError(
            f"--out: a picture is written as {', '.join((*VIDEOS, *STILLS))}, got {out}; if that is to be a directory, "
            "make it before"
        )
    if out.suffix not in (*STILLS, *VIDEOS):
        raise ValueError(f"--out: the suffix of a picture is written {out.suffix.lower()}, got {out}")
    chosen: Picture = picture or ("video" if out.suffix in VIDEOS else "film-strip")
    possible = VIDEOS if chosen == "video" else STILLS
    if out.suffix not in possible:
        raise ValueError(f"--out: a {chosen} is written as {', '.join(possible)}, got {out}")
    if out.suffix == ".gif" and fps > 50:
        raise ValueError(
            f"--fps must be at most 50 for a GIF, which browsers show slowly otherwise, got {fps}"
        )
    return {chosen: out}
