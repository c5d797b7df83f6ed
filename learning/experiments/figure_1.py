"""Figure 1: weights of a 66-weight network over 4,000 trials of a simple task, and the same with vario-eta.

The paper names neither the task nor the network's shape. Chosen: the pendulum swing-up, whose state makes 3 inputs,
and one hidden layer of 13 tanh units with a linear output, which has 13 (3 + 1) + 13 + 1 = 66 weights.

- basic: equation 2 with one global rate, eta = 0.1, no scaling of the output unit;
- vario-eta: section 3.2, eta = 0.003, beta = 1/100, v_i(0) = 1 and epsilon = 0.001 (both chosen for this task,
  where sqrt(v) was seen to be 0.001 to 0.4).

Both: s_gamma and s_lambda 1 1/s, trials of 5 s, dt = 0.01 s, float64, the same initial weights and the same initial
states. Rates were chosen after a look at seeds 100 and 101 with 0.01, 0.04, 0.1, 0.3 (basic) and 0.001, 0.003,
0.01, 0.03 (vario-eta, there with v_i(0) = 100 and epsilon = 0.01).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

import numpy as np
import torch

from swimmer_mj.learning.experiments.noise import NoiseMeter
from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.layered import Layered
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.vario_eta import VarioEta

__all__ = ["METHODS", "REWARD_LOG", "WEIGHTS_LOG", "make_meter", "run"]

WEIGHTS_LOG = "figure-1.csv"
REWARD_LOG = "figure-1-reward.csv"

N_HIDDEN = 13
METHODS = ("basic", "vario-eta")
ETA = {"basic": 0.1, "vario-eta": 0.003}
VARIO = VarioEta(beta=0.01, epsilon=0.001, initial_variance=1.0)
QUANTITIES = ("weight", "rate", "noise")
"""w_i, eta_i and sqrt(v_i)."""


def make_meter(method: str, seed: int, n_hidden: int = N_HIDDEN) -> NoiseMeter:
    """A learner of the pendulum, with v_i measured (basic) or in command of the rates (vario-eta)."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    problem = Pendulum()
    generator = torch.Generator().manual_seed(seed)
    network = Layered(problem.n_inputs, n_hidden, generator=generator, dtype=torch.float64)
    learner = FusedTD(problem, network, TDSettings(eta=ETA[method], output_scaling=False), rate_each=True)
    return NoiseMeter(learner, adapt=VARIO if method == "vario-eta" else None)


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    seeds: Sequence[int] = range(8),
    trials: int = 4000,
    every: int = 100,
    evaluate_every: int = 200,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Learn, and write the weights of the first seed and the mean reward of all. Some minutes on one core."""
    weight_rows: list[tuple[str | float, ...]] = []
    reward_rows: list[tuple[str | float, ...]] = []
    for seed in seeds:
        for method in METHODS:
            meter = make_meter(method, seed)
            learner, connected = meter.learner, meter.connected
            problem = learner.problem
            rng = np.random.default_rng(seed)
            starts = problem.initial_states(np.random.default_rng(100), 32)
            for trial in range(0, trials + 1, every):
                if trial:
                    meter.train(problem.initial_states(rng, every))
                if seed == seeds[0]:
                    tensors = learner.network.weight.data, learner.rate, meter.variance.sqrt()
                    for quantity, tensor in zip(QUANTITIES, tensors, strict=True):
                        weight_rows.append((method, trial, quantity, *tensor[connected].tolist()))
                if trial % evaluate_every == 0:
                    reward = learner.rollout(starts, 20.0, skip=10.0).reward
                    reward_rows.append((method, seed, trial, float(reward.mean())))
            report(f"{method}, seed {seed}: mean reward {reward_rows[-1][-1]:.2f}")
    n_weights = len(weight_rows[0]) - 3
    names = [f"w{i}" for i in range(n_weights)]
    write_table(Path(directory) / WEIGHTS_LOG, ("method", "trial", "quantity", *names), weight_rows, digits=4)
    header = ("method", "seed", "trial", "reward")
    write_table(Path(directory) / REWARD_LOG, header, reward_rows, digits=4)
