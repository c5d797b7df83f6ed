"""Several runs of which the faster go on: successive halving (Jamieson and Talwalkar 2016, arXiv:1502.07943).

What a seed comes to depends on the gait into which it falls, and shows early. So the time is better spent on several
seeds, of which the slower half is left where it stands after each stage, than on one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from swimmer_mj.learning.runs.run import TrainingRun

__all__ = ["train_halving"]


def train_halving(
    runs: Sequence[TrainingRun],
    seconds: float,
    train: Callable[[Sequence[TrainingRun], float], None],
) -> TrainingRun:
    """Train ``runs`` for ``seconds`` in all, in stages of one length; after each, the faster half goes on.

    Parameters
    ----------
    runs : sequence of TrainingRun
        What to advance.
    seconds : float
        Wall-clock time of all stages together.
    train : callable
        (runs, seconds): advance them side by side.

    Returns
    -------
    TrainingRun
        The one that had all stages.
    """
    going = list(runs)
    stages = 1 + math.ceil(math.log2(len(going)))
    for stage in range(stages):
        if stage > 0:
            fastest = sorted(going, key=lambda run: run.best_speed, reverse=True)
            going = fastest[: (len(going) + 1) // 2]
        train(going, seconds / stages)
    return going[0]
