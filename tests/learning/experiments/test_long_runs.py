"""The study behind figure 2, made small."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import long_runs
from swimmer_mj.learning.experiments.long_runs import Swimmer
from swimmer_mj.learning.experiments.tables import read_table


def run_small(monkeypatch, directory, trials):
    monkeypatch.setattr(long_runs, "SEEDS", range(2))
    monkeypatch.setattr(long_runs, "EVALUATE_EVERY", 2)
    monkeypatch.setattr(long_runs, "SWIMMERS", {"swim3": Swimmer(3, 6, trials, 1.0)})
    news = []
    long_runs.run("swim3", directory, news.append)
    return read_table(directory / "swim3.csv"), news


def without_times(table):
    return {name: column.tolist() for name, column in table.items() if name != "seconds"}


def test_each_preset_has_its_trials_and_an_interruption_changes_nothing(tmp_path, monkeypatch):
    whole, news = run_small(monkeypatch, tmp_path / "whole", {"paper": 4, "tuned": 2})
    rows = list(zip(whole["preset"].tolist(), whole["seed"].tolist(), whole["trial"].tolist(), strict=True))
    assert rows == [
        ("paper", 0, 2),
        ("paper", 0, 4),
        ("paper", 1, 2),
        ("paper", 1, 4),
        ("tuned", 0, 2),
        ("tuned", 1, 2),
    ]
    assert len(news) == 6
    assert "swim3-paper/seed-1: trial 4" in news[-1]
    assert np.isfinite(whole["speed"]).all()

    begun, _ = run_small(monkeypatch, tmp_path / "pieces", {"paper": 2, "tuned": 2})
    assert len(begun["seed"]) == 4
    pieces, news = run_small(monkeypatch, tmp_path / "pieces", {"paper": 4, "tuned": 2})
    assert len(news) == 2
    assert without_times(pieces) == without_times(whole)


def test_runs_with_other_settings_are_not_gone_on_with(tmp_path, monkeypatch):
    """They would stand in the log as what they are not."""
    before, _ = run_small(monkeypatch, tmp_path, {"paper": 2, "tuned": 2})
    monkeypatch.setitem(long_runs.ETAS, "tuned", 0.5)
    with pytest.raises(ValueError, match=r"swim3-tuned.seed-0 holds a run with other settings; choose"):
        run_small(monkeypatch, tmp_path, {"paper": 4, "tuned": 4})
    assert without_times(read_table(tmp_path / "swim3.csv")) == without_times(before)
