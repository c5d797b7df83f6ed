"""How a report says that it can be made again."""

import html
import re
from dataclasses import dataclass

from swimmer_mj.cli.reporting import _reproduction
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.td.method import TemporalDifferences


@dataclass(frozen=True)
class OwnPendulum(Pendulum):
    """A problem that does not come with the package."""


def said(config, which, episodes):
    """The script and the commands."""
    part = _reproduction("my run", config, {"trials": 40}, which, episodes)
    return [
        html.unescape(text)
        for text in re.findall(r"<pre><code>(.*?)</code></pre>", "".join(part.content), re.DOTALL)
    ]


def test_the_script_and_the_commands_of_a_report_know_modules_of_ones_own():
    config = RunConfig(OwnPendulum(), TemporalDifferences(), seed=3)
    script, commands = said(config, "last", 8)
    assert f"import {__name__}\n" in script
    made = {}
    exec(script.partition("train_together([")[0], made)
    assert made["config"] == config
    assert [line.partition("    #")[0] for line in commands.splitlines()] == [
        f"swimmer-mj report 'my run' --which last --episodes 8 --trust {__name__}",
        f"swimmer-mj evaluate 'my run' --which last --episodes 8 --trust {__name__}",
        f"swimmer-mj report again --trust {__name__}",
    ]


def test_others_need_none():
    script, commands = said(RunConfig(Pendulum(), TemporalDifferences()), "best", 64)
    assert script.startswith("import json\nfrom swimmer_mj.")
    assert commands.startswith("swimmer-mj report 'my run'    # this page\n")
