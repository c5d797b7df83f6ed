"""``page``: a policy to be steered in a browser."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from swimmer_mj.cli.output import make_console, print_json, print_line
from swimmer_mj.cli.runs import Which, first_policy_directory

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.forms import Policy
    from swimmer_mj.learning.runs.config import RunConfig

__all__ = ["page", "write_policy_page"]


def page(
    policy: Positional[Path],
    out: Path = Path("swim.html"),
    which: Which = "best",
    json: bool = False,
) -> None:
    """One HTML file in which one steers, pushes and races a swimmer, beside the pretrained ones; it needs no network.

    Args:
        policy: Run directory, or name of a pretrained policy such as swim5-value-gradient.
        out: The file.
        which: The weights that were fastest while training, or the last.
        json: Print one JSON object.
    """
    if out.is_dir() or not out.parent.is_dir():
        raise ValueError(f"--out must be a file in an existing directory, got {out}")

    from swimmer_mj.learning.runs.run import load_policy

    console = make_console(json)
    directory = first_policy_directory(policy, console)
    greedy, config, info = load_policy(directory, which)
    size, names = write_policy_page(out, directory, greedy, config, info)
    print_line(console, f"  {out}")
    if json:
        print_json({"run": str(directory), "page": str(out), "bytes": size, "policies": names})


def write_policy_page(
    out: Path, directory: Path, policy: Policy, config: RunConfig, known: Mapping[str, Any]
) -> tuple[int, list[str]]:
    """The page of a policy and of the pretrained ones: its size in bytes, and the names of all.

    ``known``: what is known of the policy, its speed by the equations (``speed``) and, where that was measured, by
    MuJoCo (``swimming_speed`` and ``ci95``).
    """
    from swimmer_mj.learning.pretrained import PRETRAINED, pretrained_directory, pretrained_names
    from swimmer_mj.learning.runs.run import load_policy
    from swimmer_mj.render.page.assemble import write_page
    from swimmer_mj.render.page.policies import describe

    described = []
    if directory.parent != PRETRAINED:
        speed = known["swimming_speed"] if "swimming_speed" in known else known["speed"]
        label = f"{_label(config)}, this run"
        described.append(describe(policy, str(directory), label, speed, known.get("ci95")))
    for name in pretrained_names():
        shipped, shipped_config, card = load_policy(pretrained_directory(name))
        label = f"the paper's {_label(shipped_config)}" if name.endswith("-paper") else _label(shipped_config)
        described.append(describe(shipped, name, label, card["swimming_speed"], card["ci95"]))
    chosen = directory.name if directory.parent == PRETRAINED else str(directory)
    size = write_page(out, described, chosen)
    return size, [one["name"] for one in described]


def _label(config: RunConfig) -> str:
    """What the page calls a policy by: the method it was learned with."""
    return getattr(config.method, "label", type(config.method).__name__)
