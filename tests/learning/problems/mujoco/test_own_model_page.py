"""The MuJoCo example of docs/own-problem.md runs as printed and learns."""

import re
from pathlib import Path

import numpy as np

DOCUMENT = Path(__file__).parents[4] / "docs" / "own-problem.md"
_, CODE = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)


def test_example_learns(capsys):
    names = {}
    exec(compile(CODE, str(DOCUMENT), "exec"), names)
    arm, starts = names["arm"], names["starts"]
    still = np.mean(arm.reward(starts))
    assert float(capsys.readouterr().out) > 0.8 > 0.5 > still


def test_it_has_about_thirty_lines():
    own = [line for line in CODE.splitlines() if line and not line.startswith(("import", "from"))]
    assert len(own) < 36
