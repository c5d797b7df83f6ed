"""The tables of the experiments, from logs whose numbers are known."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import section_3_3, summaries, value_gradients, what_decides
from swimmer_mj.learning.experiments.tables import read_table, write_table
from swimmer_mj.learning.runs.run import Metrics

LONG_RUNS = ("preset", "seed", *Metrics._fields)


def write_long_runs(directory, name, speeds):
    """Runs (preset, seed) with these speeds at 20,000, 40,000, ... trials."""
    rows = [
        (preset, seed, *Metrics(20_000 * (k + 1), 1.0, 0.1, 0.2, speed))
        for (preset, seed), of_run in speeds.items()
        for k, speed in enumerate(of_run)
    ]
    write_table(directory / f"{name}.csv", LONG_RUNS, rows)


RUNS = {
    ("paper", 0): [0.1, 0.5, 1.0, 0.4, 0.9],
    ("paper", 1): [0.8, 0.9, 0.96, 1.2, 1.3],
    ("tuned", 0): [2.0, 1.0],
}


def test_peaks_and_what_became_of_them(tmp_path):
    write_long_runs(tmp_path, "swim5", RUNS)
    table = read_table(tmp_path / "swim5.csv")
    assert summaries.peaks(table, "paper") == [
        summaries.Peak(0, 1.0, 60_000, 0.4, 1.0, 0.4, 0.9, 100_000),
        summaries.Peak(1, 1.3, 100_000, 1.3, 0.8, 0.8, 1.3, 100_000),
    ]
    assert summaries.peaks(table, "tuned") == [summaries.Peak(0, 2.0, 20_000, 1.0, 2.0, 1.0, 1.0, 40_000)]


def test_a_fall_before_the_peak_is_a_fall(tmp_path):
    write_long_runs(tmp_path, "swim5", {("paper", 0): [0.05, 0.9, 0.1, 0.8, 1.2, 1.0]})
    (peak,) = summaries.peaks(read_table(tmp_path / "swim5.csv"), "paper")
    assert (peak.peak, peak.lowest_after) == (1.2, 1.0)
    assert (peak.fell_from, peak.fell_to) == (0.9, 0.1)


@pytest.mark.parametrize(
    ("share", "trials"),
    [(0.5, [40_000, 20_000]), (0.8, [60_000, 80_000]), (0.05, [20_000, 20_000]), (1.0, [60_000, 100_000])],
)
def test_trials_to_a_share_of_the_top_speed(tmp_path, share, trials):
    write_long_runs(tmp_path, "swim5", RUNS)
    found = summaries.trials_to(read_table(tmp_path / "swim5.csv"), "paper", share)
    assert found.tolist() == trials


def test_learning_times(tmp_path):
    write_long_runs(tmp_path, "swim5", RUNS)
    rows = summaries.learning_times("swim5", tmp_path).rows
    paper = [row for row in rows if row[0] == "0.01, 2 seeds"]
    assert [row[1] for row in paper] == ["50%", "80%", "95%", "100%", "last: 95%"]
    assert paper[3][2].startswith("1.15 [")
    # 80,000 trials of 500 steps at 438,000 steps/s
    assert paper[3][3:] == ("80k [70k, 90k]", "0.03")
    assert paper[4][3] == "100k"
    tuned = [row for row in rows if row[0] == "0.16, 1 seed"]
    assert tuned[3][1:4] == ("100%", "2.00", "20k [20k, 20k]")
    assert tuned[4][1:4] == ("last: 50%", "1.00", "40k")
    assert rows[-2][3:] == ("2.50M", "168")


def test_learning_times_of_other_swimmers_have_no_row_of_the_paper(tmp_path):
    write_long_runs(tmp_path, "swim3", {("tuned", 0): [0.5]})
    summary = summaries.learning_times("swim3", tmp_path)
    assert summary.title.startswith("3 links, 30 neurons")
    assert len(summary.rows) == 5


def test_noise_ratios_are_divided_by_n(tmp_path):
    def row(n, scaled, seed, output, internal):
        return ("pendulum", n, scaled, seed, 500, output, internal, *[1.0] * (len(section_3_3.HEADER) - 7))

    rows = [row(8, 1, 0, 32.0, 2.0), row(8, 1, 1, 24.0, 3.0), row(8, 0, 0, 99.0, 1.0)]
    write_table(tmp_path / section_3_3.LOG, section_3_3.HEADER, rows)
    (found,) = summaries.noise_ratios(tmp_path).rows
    assert found[:4] == ("pendulum", "500", "8", "2")
    assert found[4].startswith("1.50 [")


def test_speeds_by_setting_are_those_of_the_end(tmp_path):
    rows = [
        (factor, setting, seed, seconds, 0.1, 0.25, speed + (seconds == 2000))
        for factor, setting, speed in (("baseline", "as chosen", 0.1), ("eta", "0.16", 0.2))
        for seed in range(3)
        for seconds in (1000, 2000)
    ]
    write_table(tmp_path / what_decides.LOG, what_decides.COLUMNS, rows)
    first, second = summaries.speeds_by_setting(tmp_path).rows
    assert first == ("baseline", "as chosen", "3", "1.10 [1.10, 1.10]", "1.10", "0.25")
    assert second[:2] == ("eta", "0.16")
    assert second[4] == "1.20"


def write_study(path, learners):
    """Learners (factor, setting, seed) with these speeds after 1, 2, ... million steps and 10, 20, ... s."""
    rows = [
        (*learner, 5377, 1_000_000 * (k + 1), 10.0 * (k + 1), speed, speed - 0.1)
        for learner, speeds in learners.items()
        for k, speed in enumerate(speeds)
    ]
    write_table(path, value_gradients.COLUMNS, rows)


def test_ablation(tmp_path):
    nan = float("nan")
    learners = {
        ("as chosen", "", 0): [1.6, 1.7, 2.0],
        ("as chosen", "", 1): [1.4, 1.5, 1.9],
        ("as chosen", "", 2): [1.2, 1.4, 1.5],
        ("batch", "2 passes", 0): [1.0, 1.4, 1.2],
        ("batch", "2 passes", 1): [1.6, nan, nan],
        ("batch", "2 passes", 2): [0.1, 0.2, 0.3],
    }
    write_study(tmp_path / value_gradients.ABLATION_LOG, learners)
    summary = summaries.ablation(tmp_path)
    assert "3 million steps" in summary.title
    chosen, batch = summary.rows
    assert chosen[:4] == ("as chosen", "-", "5,377", "3")
    assert chosen[4].startswith("1.80 [")
    assert chosen[5:] == ("-", "20.0", "3")
    assert batch[3] == "3, 1 of them diverged"
    assert batch[4].startswith("0.50 [")
    assert batch[5].startswith("-1.30 [")  # -0.8, -1.9, -1.2
    assert batch[6:] == ("> 30.0", "1")


def test_a_learner_that_diverged_lies_still_for_as_long_as_the_other_learns(tmp_path):
    nan = float("nan")
    log = tmp_path / value_gradients.ABLATION_LOG
    settings = ("as chosen", ""), ("batch", "wild")
    rows = [(*settings[0], 0, 5377, k, 10.0 * k, speed, speed) for k, speed in enumerate((0.0, 1.0, 2.0), 1)]
    rows += [(*settings[1], 0, 5377, k, 12.0, speed, speed) for k, speed in enumerate((0.5, nan, nan), 1)]
    write_table(log, value_gradients.COLUMNS, rows)
    _, wild = summaries.ablation(tmp_path).rows
    assert wild[3:] == ("1, 1 of them diverged", "0.00", "-2.00", "never", "0")


def test_gain_at_equal_time():
    def run(seed, times, speeds):
        times, speeds, seeds = np.array(times), np.array(speeds), np.full(2, float(seed))
        return {"seed": seeds, "cpu_seconds": times, "speed": speeds, "diverged": np.isnan(speeds)}

    slow = [run(0, [10.0, 40.0], [0.5, 1.1]), run(1, [1.0, 2.0], [0.0, 0.25])]
    quick = [run(1, [1.0, 3.0], [0.5, 1.5]), run(0, [10.0, 20.0], [1.0, 2.0]), run(2, [1.0, 2.0], [9.0, 9.0])]
    # seed 0 after 20 s: 0.7 against 2.0; seed 1 after 2 s: 0.25 against 1.0
    assert summaries.gain_at_equal_time(slow, quick) == pytest.approx([-1.3, -0.75])
    assert summaries.gain_at_equal_time(quick, slow) == pytest.approx([0.75, 1.3])


def test_speeds_by_links(tmp_path):
    learners = {
        ("links", "3", 0): [0.5, 0.9, 0.8],
        ("links", "3", 1): [0.7, 0.6, 0.6],
        ("links", "10", 0): [1.0, 2.0, 3.0],
    }
    write_study(tmp_path / value_gradients.LINKS_LOG, learners)
    three, ten = summaries.speeds_by_links(tmp_path).rows
    assert three[:2] == ("3", "2")
    assert (three[2][:5], three[3][:5], three[4:]) == ("0.70 ", "0.80 ", ("0.90", "30"))
    assert ten == ("10", "1", "3.00", "3.00", "3.00", "30")


def test_lasting_tells_when_each_seed_had_learned_and_how_far_it_fell_since(tmp_path):
    learners = {
        ("as chosen", "", 0): [1.0, 0.5, 1.95, 2.0, 1.8, 1.95],
        ("as chosen", "", 1): [1.0, 1.1, 1.2, 1.1, 1.25, 1.3],
        ("learning rate", "1e-4 at least", 0): [1.0, 0.5, 1.95, 2.0, 1.8, 1.5],
    }
    write_study(tmp_path / value_gradients.LASTING_LOG, learners)
    assert summaries.lasting(tmp_path).rows == [
        ("0", "3", "2.000", "4", "90.0%", "1.950", "1.70", "75.0%"),
        ("1", "5", "1.300", "6", "100.0%", "1.300", "1.15", "-"),
    ]


def test_markdown():
    summary = summaries.Summary("t", ("a", "b"), [("1", "2"), ("3", "4")])
    assert summary.markdown() == "| a | b |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n"


@pytest.mark.parametrize("name", summaries.TABLES)
def test_each_table_of_the_committed_logs_is_filled(name):
    summary = summaries.TABLES[name](summaries.LOGS)
    assert summary.rows
    assert all(len(row) == len(summary.header) for row in summary.rows)
    assert not any("nan" in cell for row in summary.rows for cell in row)
    assert np.all([cell for row in summary.rows for cell in row])
