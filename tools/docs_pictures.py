"""The pictures of the documentation: figures of the committed logs; of a policy that is named, strip and animation.

    python tools/docs_pictures.py
    MUJOCO_GL=osmesa python tools/docs_pictures.py swim5-paper  # without a screen

The policy is seen from above for 13 s; the target direction is reversed after 5 s, as in figure 3 of the paper.
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v3 as iio
from matplotlib.figure import Figure
from PIL import Image

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments import LOGS
from swimmer_mj.learning.pretrained import pretrained_directory
from swimmer_mj.learning.problems.forms import SwimmerForm
from swimmer_mj.learning.runs.run import load_policy
from swimmer_mj.render.figures import save_figure
from swimmer_mj.render.reproduction import FIGURES
from swimmer_mj.render.strip import film_strip
from swimmer_mj.render.video import frames

IMAGES = Path(__file__).parents[1] / "docs" / "images"
COLORS = 256
"""Of a figure: enough for lines and bands, and half the size."""
ANIMATION_COLORS = 48
FPS = 10
ANIMATED = 8.0
"""How much of the episode is in the animation, s."""


def few_colors(image: Image.Image, count: int) -> Image.Image:
    """The picture with a palette."""
    return image.convert("RGB").quantize(count, dither=Image.Dither.NONE)


def draw_figures() -> None:
    """Every figure that ``swimmer-mj figures`` draws."""
    for name, draw in FIGURES.items():
        save_small(draw(LOGS), IMAGES / f"{name}.png")


def save_small(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG with a palette."""
    save_figure(figure, path, dpi=110)
    with replacing(path) as partial:
        few_colors(Image.open(path), COLORS).save(partial, format="PNG", optimize=True)


def draw_policy(name: str) -> None:
    """Film strip and animation of the pretrained policy ``name``."""
    policy, config, _ = load_policy(pretrained_directory(name))
    swimmer = config.problem.form(SwimmerForm)
    assert swimmer is not None
    trajectory = swimmer.record(policy, 13.0)
    save_small(film_strip(trajectory), IMAGES / "film-strip.png")
    shown = list(frames(trajectory, width=400, height=225, fps=FPS))[: round(ANIMATED * FPS)]
    with replacing(IMAGES / "swimmer.gif") as partial:
        pictures = [few_colors(Image.fromarray(frame), ANIMATION_COLORS).convert("RGB") for frame in shown]
        iio.imwrite(partial, pictures, extension=".gif", duration=1000 / FPS, loop=0)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        draw_policy(sys.argv[1])
    else:
        draw_figures()
