"""How good is a linear feedback on Gymnasium's tasks, found by the cross-entropy method, without a model or a gradient?

    python benchmarks/linear_policies.py [--tasks Swimmer-v5 ...] [--seeds 110 111 ...] [--seconds 100]

adds to benchmarks/results/linear-policies.csv, a row a look, as any_model.py does: ctrl = K (observation, 1), cut to
the action space. Each generation draws POPULATION gains from a normal law, plays an episode with each, and fits the law
to the ELITE of them (Rubinstein and Kroese 2004, doi:10.1007/978-1-4757-4321-0). Generations, not looks, are counted. A
seed that is there already is not searched again. Needs the extra ``gymnasium``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro
from any_model import COLUMNS, FRESH, LOOKED_AT, LOOKS
from numpy.typing import NDArray
from rich.console import Console
from yardstick import Row, fill, looks

OUT = Path(__file__).parent / "results" / "linear-policies.csv"
POPULATION, ELITE = 40, 8
LEAST_DEVIATION, SHRINKS_TO = 0.02, 0.97
"""Added to the law's deviation, so that it does not collapse at once; and its factor from generation to generation."""

Array = NDArray[np.float64]


def play(env: gymnasium.Env[Any, Any], K: Array, seed: int | None = None) -> tuple[float, int]:
    """Return of an episode under gains K (q, m + 1), and its steps."""
    space = env.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    seen, _ = env.reset(seed=seed)
    total, steps, over = 0.0, 0, False
    while not over:
        action = np.clip(K[:, :-1] @ seen + K[:, -1], space.low, space.high)
        seen, reward, fell, late, _ = env.step(action)
        total, steps, over = total + float(reward), steps + 1, fell or late
    return total, steps


def refit(gains: Array, returns: Array, least: float) -> tuple[Array, Array]:
    """Mean and deviation of the ELITE of gains (POPULATION, q, m + 1), ``least`` added to the deviation."""
    elite = gains[np.argsort(-returns)[:ELITE]]
    return elite.mean(axis=0), elite.std(axis=0) + least


def search(task: str, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at the law's mean."""
    env = gymnasium.make(task.removeprefix("gymnasium/"))
    assert env.observation_space.shape is not None
    assert env.action_space.shape is not None
    rng = np.random.default_rng(seed)
    mean = np.zeros((env.action_space.shape[0], env.observation_space.shape[0] + 1))
    deviation, least = np.ones_like(mean), LEAST_DEVIATION
    env.reset(seed=seed)
    rows: list[Row] = []
    best, best_return, best_time, steps = mean, -np.inf, 0.0, 0

    def row(kind: str, at: float, K: Array, seeds: Iterable[int]) -> float:
        returns = np.array([play(env, K, seed)[0] for seed in seeds])
        numbers = (f"{value:.4f}" for value in (returns.mean(), returns.min(), returns.max()))
        rows.append((task, seed, kind, f"{at:.1f}", steps, *numbers))
        console.print(*rows[-1])
        return float(returns.mean())

    def generation() -> None:
        nonlocal mean, deviation, least, steps
        gains = mean + deviation * rng.normal(size=(POPULATION, *mean.shape))
        played = [play(env, K) for K in gains]
        steps += sum(taken for _, taken in played)
        mean, deviation = refit(gains, np.array([total for total, _ in played]), least)
        least *= SHRINKS_TO

    for clock in looks(generation, LOOKS, seconds):
        at = clock.before[0]
        looked = row("of the law's mean", at, mean, LOOKED_AT)
        if looked > best_return:
            best, best_return, best_time = mean, looked, at
    row("best", best_time, best, FRESH)
    return rows


def main(
    tasks: tuple[str, ...] = ("Swimmer-v5",),
    seeds: Sequence[int] = tuple(range(110, 120)),
    seconds: float = 100.0,
    out: Path = OUT,
) -> None:
    """Search for each task with each seed.

    Args:
        tasks: Which, by Gymnasium's name.
        seeds: Of the searches.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    console = Console(highlight=False)
    keys = ((f"gymnasium/{name}", seed) for seed in seeds for name in tasks)
    fill(out, COLUMNS, keys, lambda task, seed: search(task, seed, seconds, console))


if __name__ == "__main__":
    tyro.cli(main)
