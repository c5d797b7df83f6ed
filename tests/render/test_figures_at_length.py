"""Tables and figures of the longer studies, from logs made here."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import (
    linear_swimmer,
    noise_at_length,
    rates_at_length,
    summaries_at_length,
)
from swimmer_mj.learning.experiments.section_3_4 import CURVE_HEADER, METHODS
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.learning.runs.run import Metrics
from swimmer_mj.render import at_length


def runs(path, speeds):
    """A log of long runs: by preset, the speeds of each seed at the trials 100k, 200k, .."""
    rows = [
        (preset, seed, *Metrics(100_000 * (k + 1), 1.0, 0.1 + k, 0.2, speed))
        for preset, of in speeds.items()
        for seed, run in enumerate(of)
        for k, speed in enumerate(run)
    ]
    write_table(path, ("preset", "seed", *Metrics._fields), rows)


def curves(figure_axes):
    return {
        line.get_label(): line.get_ydata()
        for line in figure_axes.lines
        if not line.get_label().startswith("_")
    }


def test_angles_are_compared_as_far_as_they_come_and_diverged_seeds_are_counted(tmp_path, check_whole):
    runs(tmp_path / "swim5.csv", {"paper": [[0.1, 0.2, 0.5, 2.0]] * 8, "tuned": [[9.0] * 4] * 8})
    runs(tmp_path / "swim5-angle.csv", {"paper": [[0.3, 0.1, 0.2], [0.5]], "quarter": [[0.2, 0.2, 0.2]] * 8})
    runs(tmp_path / "swim5-unwrapped.csv", {"paper": [[0.1] * 3] * 8, "quarter": [[0.1] * 3] * 7})
    table = summaries_at_length.raw_angles(tmp_path)
    assert table.header[3:5] == ("100k trials, m/s", "300k trials, m/s")
    named = {row[:2]: row[2:] for row in table.rows}
    assert len(named) == 5
    assert named["17: cosines and sines", "0.01"] == (
        "0 of 8",
        "0.10 [0.10, 0.10]",
        "0.50 [0.50, 0.50]",
        "0.50",
    )
    lost, first, *_, best = named["12: angles within a turn", "0.01"]
    assert (lost, first[:4], best) == ("7 of 8", "0.40", "0.50")
    assert named["12: angles, turns counted", "0.0025"][0] == "1 of 8"

    figure = at_length.draw_raw_angles(tmp_path)
    known, wrapped, _ = figure.axes[:3]
    assert curves(known)[at_length.PRESETS["paper"][1]] == pytest.approx([0.1, 0.2, 0.5])
    assert curves(wrapped)[at_length.PRESETS["paper"][1]] == pytest.approx([0.4, 0.1, 0.2])
    check_whole(figure)


def test_rates_tell_when_each_method_swims(tmp_path, check_whole):
    speeds = {method: [[0.0, 0.5 * k, 0.8 * k], [0.0, 0.5 * k, 0.4 * k]] for k, method in enumerate(METHODS)}
    rows = [
        ("swim5", method, 0.1, 0.0 if k < 2 else 0.01, seed, trial, speed, 0.1, float(k == 3 and seed == 1))
        for k, (method, of) in enumerate(speeds.items())
        for seed, run in enumerate(of)
        for trial, speed in zip((0, 30_000, 200_000), run, strict=True)
    ]
    write_table(tmp_path / rates_at_length.LEARNING_LOG, CURVE_HEADER, rows)
    table = summaries_at_length.rates(tmp_path)
    plain, scaled, vario, bent = table.rows
    assert plain == (
        "plain",
        "0.1",
        "0 of 2",
        "-",
        "0.00 [0.00, 0.00]",
        "-",
        "0.00 [0.00, 0.00]",
        "not; 0 of 2",
    )
    assert scaled[-1] == "not; 0 of 2"
    assert vario[1:4] == ("0.1, 0.01", "0 of 2", "-")
    assert vario[-1] == "30k; 2 of 2"
    assert bent[2] == "1 of 2"

    figure = at_length.draw_rates_at_length(tmp_path)
    curve, at_end = figure.axes
    assert curves(curve)[r"vario-$\eta$"] == pytest.approx([0.0, 1.0, 1.2])
    means = [line.get_ydata()[0] for line in at_end.lines if line.get_marker() == "o"]
    assert means == pytest.approx([0.0, 0.6, 1.2, 1.8])
    check_whole(figure)


def test_noise_has_its_exponent(tmp_path, check_whole):
    rng = np.random.default_rng(0)
    rows = []
    for eta, power in ((0.01, 1.0), (0.04, 0.5)):
        for n in (15, 30, 60):
            for seed in range(4):
                for trial in (20_000, 1_000_000):
                    ratio = 2.0 * n**power * np.exp(0.01 * rng.normal())
                    rows.append(("swim5", n, eta, seed, trial, ratio, 1.0, *[1.0] * 8, 0.5))
    write_table(tmp_path / noise_at_length.LOG, noise_at_length.HEADER, rows)
    table = summaries_at_length.noise(tmp_path)
    assert [row[:2] for row in table.rows] == [
        ("0.01", "20k"),
        ("0.01", "1M"),
        ("0.04", "20k"),
        ("0.04", "1M"),
    ]
    assert float(table.rows[1][2].split(" ")[0]) == pytest.approx(2.0, rel=0.02)
    assert float(table.rows[1][5].split(" ")[0]) == pytest.approx(1.0, abs=0.02)
    assert float(table.rows[3][6].split(" ")[0]) == pytest.approx(0.5, abs=0.03)

    figure = at_length.draw_noise_at_length(tmp_path)
    assert curves(figure.axes[0])["n = 15"] == pytest.approx([2.0, 2.0], rel=0.02)
    assert any("n^{1.00" in label or "n^{0.99" in label for label in curves(figure.axes[-1]))
    check_whole(figure)


def test_tile_coding_beside_the_cascade(tmp_path, check_whole):
    rows = [
        (
            stage,
            name,
            3.0,
            8,
            4,
            1.0,
            1.0,
            weights,
            seed,
            trial,
            seconds * trial,
            0.1,
            0.2,
            share * speed * trial,
            0.25,
        )
        for stage, share in (("first", 0.5), ("final", 1.0))
        for name, weights, seconds, speed in (
            ("cascade", 795, 1e-4, 1e-5),
            ("tile coding", 7_776_000, 1e-2, 2e-6),
        )
        for seed in range(3)
        for trial in (6_000, 60_000)
    ]
    write_table(tmp_path / linear_swimmer.LOG, linear_swimmer.HEADER, rows)
    table = summaries_at_length.linear(tmp_path)
    assert table.rows[0] == ("cascade", "795", "25 %", "6", "0.06 [0.06, 0.06]", "-", "0.60 [0.60, 0.60]")
    assert table.rows[1][1:4] == ("7,776,000", "25 %", "600")
    figure = at_length.draw_linear_swimmer(tmp_path)
    assert curves(figure.axes[0])["tile coding, 7,776,000 weights"] == pytest.approx([0.012, 0.12])
    check_whole(figure)
