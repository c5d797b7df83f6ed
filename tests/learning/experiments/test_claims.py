"""The numbers beside the paper's claims, from logs whose numbers are known."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import claims, figure_1, section_3_3
from swimmer_mj.learning.experiments.claims_of_section_3 import exponent, spread_of_noise
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.learning.runs.run import Metrics


def test_the_exponent_is_that_of_the_ratio(tmp_path):
    """Ratios 3 n^0.8, off by 2 % up and down; 15 neurons, which do not count, far off."""

    def row(n, seed, off):
        ratio = 100.0 if n == 15 else 3 * n**0.8 * (1 + 0.02 * off)
        return ("swim5", n, 1, seed, 20_000, ratio, 1.0, *[1.0] * (len(section_3_3.HEADER) - 7))

    rows = [row(n, seed, off) for n in (15, 30, 60, 120) for seed, off in enumerate((-1, 1, -1, 1))]
    write_table(tmp_path / section_3_3.LOG, section_3_3.HEADER, rows, digits=8)
    slope, half, p = exponent(tmp_path)
    assert slope == pytest.approx(0.8, abs=1e-3)
    assert 0.005 < half < 0.05
    assert p < 1e-6


def test_the_date_of_a_peak_moves_with_the_end_of_the_run(tmp_path):
    speeds = {0: [0.5, 0.7, 0.6, 0.9], 1: [0.5, 0.4, 0.3, 0.6], 2: [0.1, 0.5, 0.6, 0.7]}
    rows = [
        ("paper", seed, *Metrics(500_000 * (k + 1), 1.0, 0.1, 0.2, speed))
        for seed, of_seed in speeds.items()
        for k, speed in enumerate(of_seed)
    ]
    write_table(tmp_path / "swim5.csv", ("preset", "seed", *Metrics._fields), rows)
    assert claims.plateau(tmp_path, (1e6, 1.5e6, 2e6)).tolist() == [1e6, 1e6, 2e6]


def test_the_spread_of_noise_is_that_of_the_basic_algorithm_with_its_rate(tmp_path):
    """Two weights: noise 2 and 6 by the basic algorithm with 0.1, and more by vario-eta, which has other rates."""
    rows = [
        (method, trial, quantity, *values)
        for method, noise, rates in (("basic", (2, 6), (0.1, 0.1)), ("vario-eta", (1, 99), (0.003, 2.1)))
        for trial in (0, 100)
        for quantity, values in (("weight", (1, 1)), ("rate", rates), ("noise", noise))
    ]
    write_table(tmp_path / figure_1.WEIGHTS_LOG, ("method", "trial", "quantity", "w0", "w1"), rows)
    text = spread_of_noise(tmp_path)
    assert "η 0.1," in text
    assert text.endswith("is 3 times that of the quietest")


def test_every_claim_has_its_text():
    table = claims.claims()
    assert len(table.rows) == 16
    assert all(len(row) == len(table.header) for row in table.rows)
    assert not any("nan" in cell or "|" in cell for row in table.rows for cell in row)


def test_what_the_committed_logs_say_of_the_exponent_and_of_the_peak():
    slope, half, p = exponent(claims.LOGS)
    assert (round(slope, 2), round(half, 1), round(p, 2)) == (0.78, 0.2, 0.03)
    assert np.diff(claims.plateau(claims.LOGS)).min() > 0
