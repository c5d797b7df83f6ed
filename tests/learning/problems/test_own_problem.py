"""The first example of docs/own-problem.md runs as printed and learns."""

import re
from pathlib import Path

DOCUMENT = Path(__file__).parents[3] / "docs" / "own-problem.md"


def test_example_learns(capsys):
    code, _ = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    exec(compile(code, str(DOCUMENT), "exec"), {})
    assert (
        float(capsys.readouterr().out) > 0.8
    )  # before learning 0.07; of 12 seeds one gets to 0.97, all others to 0.998
