"""The pictures of the documentation: figures of the committed logs; of a policy that is named, strip and animation.

    python tools/docs_pictures.py
    MUJOCO_GL=osmesa python tools/docs_pictures.py swim5-paper  # without a screen
    MUJOCO_GL=osmesa python tools/docs_pictures.py pictures     # those of docs/pictures.md
    python tools/docs_pictures.py gaits                         # that of docs/gaits.md, which pictures draws too

Policies are seen from above for 13 s; the target direction is reversed after 5 s, as in figure 3 of the paper.
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments import LOGS
from swimmer_mj.learning.experiments.gaits.gait import BEST, load_gaits
from swimmer_mj.learning.pretrained import pretrained_directory
from swimmer_mj.learning.problems.forms import Policy, SwimmerForm
from swimmer_mj.learning.runs.run import load_policy
from swimmer_mj.render.figures import save_figure
from swimmer_mj.render.gait import gait_diagram
from swimmer_mj.render.gaits import draw_gaits
from swimmer_mj.render.links import speed_by_links
from swimmer_mj.render.phase_portraits import phase_portraits
from swimmer_mj.render.reproduction import FIGURES
from swimmer_mj.render.strip import film_strip
from swimmer_mj.render.value_map import value_map
from swimmer_mj.render.video import frames
from swimmer_mj.trajectory import Trajectory

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


def swim(name: str) -> tuple[Policy, Trajectory]:
    """The pretrained policy ``name`` and its episode."""
    policy, config, _ = load_policy(pretrained_directory(name))
    swimmer = config.problem.form(SwimmerForm)
    assert swimmer is not None
    return policy, swimmer.record(policy, 13.0)


def draw_policy(name: str) -> None:
    """Film strip and animation of the pretrained policy ``name``."""
    _, trajectory = swim(name)
    save_small(film_strip(trajectory), IMAGES / "film-strip.png")
    shown = list(frames(trajectory, width=400, height=225, fps=FPS))[: round(ANIMATED * FPS)]
    with replacing(IMAGES / "swimmer.gif") as partial:
        pictures = [few_colors(Image.fromarray(frame), ANIMATION_COLORS).convert("RGB") for frame in shown]
        iio.imwrite(partial, pictures, extension=".gif", duration=1000 / FPS, loop=0)


def draw_pictures() -> None:
    """Those of docs/pictures.md."""
    fast, episode = swim("swim5-value-gradient")
    _, paper = swim("swim5-paper")
    names = ("value gradients", "TD(λ), the paper's")
    looks = {"width": 560, "height": 420, "fps": 1, "samples": 4, "overlay": True}
    shown = [list(frames(paper, **looks))[3], list(frames(episode, against=paper, names=names, **looks))[3]]
    with replacing(IMAGES / "video.png") as partial:
        edge = np.full((420, 8, 3), 255, np.uint8)
        both = Image.fromarray(np.concatenate([shown[0], edge, shown[1]], axis=1))
        few_colors(both, COLORS).save(partial, format="PNG", optimize=True)
    save_small(gait_diagram(paper), IMAGES / "gait.png")
    save_small(phase_portraits(paper), IMAGES / "phase-portraits.png")
    save_small(value_map(fast, episode, ("theta2", "theta3")), IMAGES / "value-map.png")
    save_small(speed_by_links(), IMAGES / "speed-by-links.png")
    draw_best_gaits()


def draw_best_gaits() -> None:
    """That of docs/gaits.md, which is quick."""
    gaits = {int(path.stem.removeprefix("swim")): load_gaits(path) for path in BEST.glob("swim*.npz")}
    save_small(draw_gaits(gaits), IMAGES / "gaits.png")


if __name__ == "__main__":
    if sys.argv[1:] == ["pictures"]:
        draw_pictures()
    elif sys.argv[1:] == ["gaits"]:
        draw_best_gaits()
    elif len(sys.argv) > 1:
        draw_policy(sys.argv[1])
    else:
        draw_figures()
