"""The pictures at the top of the README: a film strip and a short animation of one policy.

    python tools/readme_pictures.py swim5-value-gradient

Seen from above for 13 s; the target direction is reversed after 5 s, as in figure 3 of the paper.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import imageio.v3 as iio
from PIL import Image

from swimmer_mj.files import replacing
from swimmer_mj.learning.evaluation import evaluation_states, record_episode
from swimmer_mj.learning.pretrained import pretrained_directory
from swimmer_mj.learning.trainer import load_policy
from swimmer_mj.render.figures import save_figure
from swimmer_mj.render.strip import film_strip
from swimmer_mj.render.video import frames

IMAGES = Path(__file__).parents[1] / "docs" / "images"
FPS = 12
ANIMATED = 8.0  # s, of the episode
COLORS = 32


def main(name: str) -> None:
    """Draw the pretrained policy ``name``."""
    policy, config, _ = load_policy(pretrained_directory(name))
    trajectory = record_episode(
        policy,
        config.parameters,
        evaluation_states(config.parameters.n_links)[0],
        13.0,
        lambda now: 0.0 if now < 5.0 - 1e-9 else math.pi,
    )
    save_figure(film_strip(trajectory), IMAGES / "film-strip.png")
    pictures = [
        Image.fromarray(frame).quantize(COLORS, dither=Image.Dither.NONE).convert("RGB")
        for frame in frames(trajectory, width=480, height=270, fps=FPS)
    ][: round(ANIMATED * FPS)]
    with replacing(IMAGES / "swimmer.gif") as partial:
        iio.imwrite(partial, pictures, extension=".gif", duration=1000 / FPS, loop=0)


if __name__ == "__main__":
    main(*sys.argv[1:])
