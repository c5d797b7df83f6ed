"""The page of errors says what the commands say."""

import csv
import sys

import pytest
import refusals

pytest.importorskip("dm_control")
OTHERS_WORDS = {  # a parser's, which depend on its version
    "swim", "train", "train --out new --links two", "evaluate CUT", "evaluate EMPTY",
}  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="asks for /proc")
def test_the_log_is_what_is_said():
    """If not: python benchmarks/refusals.py, then python benchmarks/trouble.py."""
    with open(refusals.OUT, newline="", encoding="utf-8") as file:
        logged = [
            refusals.Refusal(asked, int(status), said) for asked, status, said in list(csv.reader(file))[1:]
        ]
    found = list(refusals.refusals())
    assert [one.asked for one in found] == [one.asked for one in logged]
    own = {
        "swim",
        "train",
        "train --out new --links two",
    }  # in these the parser's words depend on its version
    assert [one for one in found if one.asked not in own] == [one for one in logged if one.asked not in own]
    assert {(one.status, one.said.count("\n")) for one in found} == {(2, 0)}
    assert all(one.said and "Errno" not in one.said and "Traceback" not in one.said for one in found)
