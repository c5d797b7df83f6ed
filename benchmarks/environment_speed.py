"""How many control steps a second do the environments do: dm_control's, Gymnasium's single one and the vector one?

    python benchmarks/environment_speed.py [--json FILE]

All step the paper's swimmer under random actions with RK4. They take turns, and the median of the ratios of
neighbours in time is compared, so that a busy machine slows all alike. Exit status 1 if the vector environment of 64
does less than 8 times the steps of the single one (on two cores).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import gymnasium
import numpy as np

import swimmer_mj
import swimmer_mj.gymnasium

LIMIT = 8.0
N_ENVIRONMENTS = 64


def main() -> int:
    """Print the table; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="also write the numbers to this file")
    parser.add_argument("--rounds", type=int, default=20, help="how often each has its turn")
    parser.add_argument("--steps", type=int, default=400, help="control steps of each in a turn")
    arguments = parser.parse_args()
    n_steps = arguments.steps

    control = swimmer_mj.load("swim5", task_kwargs={"random": 0})
    single = gymnasium.make("swimmer_mj/Swim5-v0")
    vector = gymnasium.make_vec("swimmer_mj/Swim5-v0", num_envs=N_ENVIRONMENTS)
    actions = np.random.default_rng(0).uniform(-1, 1, (n_steps, N_ENVIRONMENTS, 4)).astype(np.float32)

    def rate_of_control() -> float:
        control.reset()
        started = time.perf_counter()
        for action in actions[:, 0]:
            control.step(action)
        return n_steps / (time.perf_counter() - started)

    def rate_of_single() -> float:
        single.reset(seed=0)
        started = time.perf_counter()
        for action in actions[:, 0]:
            single.step(action)
        return n_steps / (time.perf_counter() - started)

    def rate_of_vector() -> float:
        vector.reset(seed=0)
        started = time.perf_counter()
        for action in actions:
            vector.step(action)
        return n_steps * N_ENVIRONMENTS / (time.perf_counter() - started)

    turns = {"dm_control": rate_of_control, "single": rate_of_single, "vector": rate_of_vector}
    rates = {name: [] for name in turns}
    for round_ in range(arguments.rounds + 1):
        for name, turn in turns.items():
            rate = turn()
            if round_ > 0:  # the first warms up
                rates[name].append(rate)
    control.physics.free()
    single.close()
    vector.close()

    median = {name: float(np.median(values)) for name, values in rates.items()}
    low, ratio, high = np.quantile(np.divide(rates["vector"], rates["single"]), [0.0, 0.5, 1.0])
    print("control steps a second, 5 links, RK4 at 0.01 s")
    print(f"dm_control environment          {median['dm_control']:10,.0f}")
    print(f"Gymnasium environment           {median['single']:10,.0f}")
    print(f"vector environment of {N_ENVIRONMENTS}        {median['vector']:10,.0f}")
    verdict = "at least" if ratio >= LIMIT else "LESS than"
    print(
        f"\nvector / single: median {ratio:.1f} (from {low:.1f} to {high:.1f} over {arguments.rounds} rounds) "
        f"on {os.cpu_count()} cores: {verdict} {LIMIT:g}"
    )
    if arguments.json is not None:
        result = {"steps_per_second": median, "ratio": ratio, "ratios": [low, high], "limit": LIMIT}
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0 if ratio >= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
