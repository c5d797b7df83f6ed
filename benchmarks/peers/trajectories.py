"""Trajectories that go on from window to window and start anew after a while, out of step with each other."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from swimmer_mj.learning.problems.swim import Swimming


class Trajectories:
    """States (p, N) of N swimmers, as the learner of value gradients keeps them."""

    def __init__(self, problem: Swimming, count: int, windows: int, seed: int) -> None:
        self.problem, self.windows = problem, max(1, windows)
        self.rng = np.random.default_rng(seed)
        self.states = torch.from_numpy(problem.initial_states(self.rng, count).T.copy())
        self.age = self.rng.integers(0, self.windows, count)

    def begin_window(self) -> Tensor:
        """Where the next window starts: those that are old start anew."""
        old = self.age >= self.windows
        if old.any():
            fresh = self.problem.initial_states(self.rng, int(old.sum()))
            self.states[:, torch.from_numpy(old)] = torch.from_numpy(fresh.T.copy())
            self.age[old] = 0
        self.age += 1
        return self.states

    def end_window(self, states: Tensor) -> None:
        """Where it ended."""
        self.states = states.detach().clone()
