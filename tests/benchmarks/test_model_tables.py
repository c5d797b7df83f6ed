"""Tables of MuJoCo models."""

import model_tables


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
