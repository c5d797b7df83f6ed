"""The sweep goes on from parts of its log, if they are its own."""

import pytest

from swimmer_mj.learning.experiments import what_decides
from swimmer_mj.learning.experiments.tables import read_table

TWO = [one for one in what_decides.VARIANTS if one.factor in ("baseline", "eta")][:2]


def learned(pack, duration):
    """What :func:`what_decides._learn` returns, without the learning."""
    return [
        (one.factor, one.setting, seed, k * duration / 5, 0.1, 0.2, 0.3)
        for k in range(1, 6)
        for one, seed in pack
    ]


def test_parts_are_used_if_they_are_of_these_learners(tmp_path, monkeypatch):
    def interrupted(part, columns, rows):
        write(part, columns, rows)
        raise KeyboardInterrupt

    write = what_decides.write_table
    monkeypatch.setattr(what_decides, "_learn", learned)
    monkeypatch.setattr(what_decides, "write_table", interrupted)
    with pytest.raises(KeyboardInterrupt):
        what_decides.run(tmp_path, lambda line: None, variants=TWO, duration=1000.0)
    monkeypatch.setattr(what_decides, "write_table", write)
    monkeypatch.setattr(what_decides, "_learn", lambda *arguments: pytest.fail("learned again"))
    (part,) = tmp_path.iterdir()
    before = part.read_text()
    others = [what_decides.VARIANTS[0], what_decides.VARIANTS[4]]
    for variants, duration, end in ((others, 1000.0, 1000), (TWO[:1], 1000.0, 1000), (TWO, 1501.0, 1500)):
        message = f"{part.name} is not of the learners that belong there, after {end} s: finish the run"
        with pytest.raises(ValueError, match=message):
            what_decides.run(tmp_path, lambda line: None, variants=variants, duration=duration)
        assert part.read_text() == before
    what_decides.run(tmp_path, lambda line: None, variants=TWO, duration=1000.0)
    assert [path.name for path in tmp_path.iterdir()] == [what_decides.LOG]
    assert len(read_table(tmp_path / what_decides.LOG)["seed"]) == 2 * 8 * 5


def test_the_log_is_in_the_order_of_the_variants(tmp_path):
    parts = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for part, one in zip(parts, reversed(TWO), strict=True):
        what_decides.write_table(part, what_decides.COLUMNS, learned([(one, 0)], 1000.0))
    what_decides.merge(parts, tmp_path / "log.csv", TWO)
    table = read_table(tmp_path / "log.csv")
    assert table["factor"].tolist() == ["baseline"] * 5 + ["eta"] * 5
    assert table["setting"].tolist() == ["as chosen"] * 5 + ["0.01"] * 5
