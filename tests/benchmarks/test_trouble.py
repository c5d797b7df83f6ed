"""The tables of the page of errors are what the logs say."""

import csv

import trouble


def test_the_page_has_what_the_logs_say():
    """If not: python benchmarks/trouble.py."""
    text = trouble.PAGE.read_text(encoding="utf-8")
    assert trouble.with_tables(text) == text
    assert {mark[1] for mark in trouble.MARKED.findall(text)} == trouble.TABLES.keys()
    assert trouble.with_tables("<!-- log: kills -->\n| td | 1 |\n<!-- end -->").count("\n") > 5


def test_nothing_was_lost_and_nothing_wrong_was_taken():
    kills = trouble.read("kills")
    assert {row["result"] for row in kills} == {"same bits"}
    for target in {row["target"] for row in kills}:
        at_random = [row for row in kills if row["target"] == target and "while" in row["kind"]]
        assert len(at_random) >= 100
        written = {row["where"] for row in kills if row["target"] == target}
        assert written >= {
            f"writing {name}" for name in ("config.json", "checkpoint.safetensors", "metrics.csv")
        }
    assert sum(int(row["inputs"]) for row in trouble.read("fuzzed-inputs")) >= 100_000
    assert {row["wrong"] for row in trouble.read("fuzzed-inputs")} == {"0"}


def test_watching_and_saving_cost_little():
    percent = {row["part"]: float(row["percent"]) for row in trouble.read("watching-cost")}
    assert percent["watching"] + percent["TensorBoard"] < 2
    assert percent["saving"] < 1


def test_a_log_of_a_kill_has_its_columns():
    from kill_and_resume import Kill

    with open(trouble.RESULTS / "kills.csv", newline="") as file:
        assert tuple(next(csv.reader(file))) == Kill._fields
