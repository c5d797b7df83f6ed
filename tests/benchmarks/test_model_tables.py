"""Tables of MuJoCo models."""

import time

import model_tables
import numpy as np
import round_cost


def test_who_ends_below_its_best_is_counted():
    """Returns may be negative; the return of the best weights in other episodes is no look."""
    returns = {("a", "0"): (5.0, 10.0, 8.9), ("a", "1"): (5.0, 10.0, 9.1), ("b", "0"): (-9.0, -4.0, -4.5)}
    rows = [
        {"task": task, "seed": seed, "look": "of the learner", "return_mean": str(value)}
        for (task, seed), values in returns.items()
        for value in values
    ]
    rows += [{"task": "a", "seed": "1", "look": "best", "return_mean": "1.0"}]
    assert model_tables.fell_back(rows) == {"a": 1, "b": 1}


def test_a_models_distance_stands_beside_its_share(monkeypatch, tmp_path):
    monkeypatch.setattr(model_tables, "RESULTS", tmp_path)
    (tmp_path / "own-models.csv").write_text(
        "model,seed,cpu_seconds,at_the_goal_share,distance_mean,distance_max\n"
        "arm,0,5.0,0.0,0.4,1.0\narm,0,9.0,1.0,0.02,0.1\n"
        "arm,1,5.1,0.5,0.6,1.0\narm,1,9.1,0.75,0.04,0.1\n"
    )
    table = model_tables.own_models()
    assert len(table.header) == len(table.rows[0])
    assert [(row[1], row[2], row[4]) for row in table.rows] == [("2", "5", "0"), ("2", "9", "75")]
    assert [row[5].split()[0] for row in table.rows] == ["0.50", "0.03"]


def test_a_few_seeds_are_each_said():
    assert model_tables.mean_words(np.array([310.0, 290.0]), ".0f") == "310, 290"
    assert model_tables.mean_words(np.full(5, 300.0), ".0f") == "300 [300, 300]"


def test_of_each_learner_the_best_published_return_counts(tmp_path, monkeypatch):
    rows = ["task,learner,return", "a,PPO,3", "a,SAC,7", "a,PPO,9", "b,PPO,-2", "b,PPO,-1"]
    (tmp_path / "published-returns.csv").write_text("\n".join(rows))
    monkeypatch.setattr(model_tables, "RESULTS", tmp_path)
    assert model_tables.published() == {"a": [("PPO", 9.0), ("SAC", 7.0)], "b": [("PPO", -1.0)]}


def test_teams_beside_the_best_gaits(tmp_path, monkeypatch):
    lines = [
        "links,seconds,cores,steady_speed,against_2,against_3,folded",
        "5,120,2,2.5,1.0,2.4,0.9",
        "5,120,2,3.1,1.8,2.7,0.0",
    ]
    (tmp_path / "several-seeds.csv").write_text("\n".join(lines))
    monkeypatch.setattr(model_tables, "RESULTS", tmp_path)
    (five,) = model_tables.several_seeds().rows
    assert five[:2] == ("5", "2")
    assert [cell.split("; ")[1] for cell in five[-3:-1]] == ["50", "80"]
    assert five[-3].startswith("70 [")
    assert five[-1] == "1"


def test_what_is_called_inside_of_a_part_is_not_counted_there():
    """The times add up to those of the whole."""
    watch = round_cost.Stopwatch()

    class Work:
        def inner(self):
            time.sleep(0.02)
            return 3

        def outer(self, times=1):
            time.sleep(0.01)
            return sum(self.inner() for _ in range(times))

    work = Work()
    watch.time(work, "inner", "in")
    watch.time(work, "outer", "out")
    started = time.perf_counter()
    assert work.outer(times=2) == 6
    assert 0.05 <= sum(watch.spent.values()) <= time.perf_counter() - started
    assert watch.spent["in"] >= 0.04
    assert 0.01 <= watch.spent["out"] < watch.spent["in"]


def test_a_round_is_taken_apart():
    found = round_cost.parts("dm_control/pendulum/swingup", 1)
    assert found.pop("states") == 256 * 25
    assert all(part > 0 for part in found.values())
