"""``page``: a policy to be steered in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from swimmer_mj.cli.options import trust_modules
from swimmer_mj.cli.output import make_console, print_json, print_line, status
from swimmer_mj.cli.runs import Which, first_policy_directory

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.forms import Policy
    from swimmer_mj.learning.runs.config import RunConfig

__all__ = ["described_policies", "page", "write_policy_page"]

Speed = tuple[float, tuple[float, float] | None]


def page(
    policy: Positional[Path],
    out: Path = Path("swim.html"),
    which: Which = "best",
    trust: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """One HTML file in which one steers, pushes and races a swimmer, beside the pretrained ones; it needs no network.

    Args:
        policy: Run directory, or name of a pretrained policy such as swim5-value-gradient.
        out: The file.
        which: The weights that were fastest while training, or the last.
        trust: Modules of one's own that may run when the run names them (docs/extending.md).
        json: Print one JSON object.
    """
    if (out.exists() and not out.is_file()) or not out.parent.is_dir():
        raise ValueError(f"--out must be a file in an existing directory, got {out}")
    trust_modules(trust)

    from swimmer_mj.learning.runs.run import load_policy

    console = make_console(json)
    directory = first_policy_directory(policy, console)
    greedy, config, _ = load_policy(directory, which)
    with status(console, f"evaluating {directory}"):
        size, names = write_policy_page(out, directory, greedy, config)
    print_line(console, f"  {out}")
    if json:
        print_json({"run": str(directory), "page": str(out), "bytes": size, "policies": names})


def write_policy_page(
    out: Path,
    directory: Path,
    policy: Policy,
    config: RunConfig,
    speed: Speed | None = None,
) -> tuple[int, list[str]]:
    """The page of a policy and of the pretrained ones: its size in bytes, and the names of all.

    ``speed``: as of :func:`described_policies`.
    """
    from swimmer_mj.render.page.assemble import write_page

    described, chosen = described_policies(directory, policy, config, speed)
    return write_page(out, described, chosen), [one["name"] for one in described]


def described_policies(
    directory: Path, policy: Policy, config: RunConfig, speed: Speed | None = None
) -> tuple[list[dict[str, Any]], str]:
    """What a page is made of: a policy and the pretrained ones, and the name of the first.

    ``speed``: swimming speed of the policy and its interval, as ``evaluate`` gives them; by default they are measured.
    """
    import os

    from swimmer_mj.intervals import known_interval, mean_and_interval
    from swimmer_mj.learning.pretrained import PRETRAINED, pretrained_directory, pretrained_swimmers
    from swimmer_mj.learning.problems.forms import EnvironmentForm
    from swimmer_mj.learning.runs.run import load_policy
    from swimmer_mj.render.page.policies import describe, require_playable

    described = []
    require_playable(policy, str(directory))  # before the evaluation, which takes seconds
    if directory.parent != PRETRAINED:
        if speed is None:
            environment = policy.problem.form(EnvironmentForm)
            assert environment is not None  # a swimmer has one
            mean, interval = mean_and_interval(environment.evaluate(policy, 64, os.cpu_count() or 1))
            speed = mean, known_interval(interval)
        label = f"{_label(config)}, this run"
        described.append(describe(policy, str(directory), label, *speed))
    for name in pretrained_swimmers():
        shipped, shipped_config, card = load_policy(pretrained_directory(name))
        label = _shipped_label(name, _label(shipped_config))
        described.append(describe(shipped, name, label, card["swimming_speed"], card["ci95"]))
    return described, directory.name if directory.parent == PRETRAINED else str(directory)


def _shipped_label(name: str, method: str) -> str:
    """What the page calls a policy that comes with the package: by what is in its name besides the method."""
    _, _, kind = name.partition("-")
    return {"paper": f"the paper's {method}", "value-gradient": method}.get(kind, f"{method}, {kind}")


def _label(config: RunConfig) -> str:
    """What the page calls a policy by: the method it was learned with."""
    return getattr(config.method, "label", type(config.method).__name__)
