"""The noise v_i of each weight (section 3.2), measured from outside the compiled learner, one trial at a time."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.td import vario_eta
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.vario_eta import VarioEta

__all__ = ["NoiseMeter"]

Array = NDArray[np.float64]


class NoiseMeter:
    """Trains a learner and follows v_i and the mean of (w_i(k+1) - w_i(k)) / eta_i(k), its gradient per trial.

    Parameters
    ----------
    learner : FusedTD
        Must have ``settings.vario`` None: its rates are fixed, or set here.
    beta : float
        Decay of variance and mean per trial.
    adapt : VarioEta, optional
        Set the rates by vario-eta after each trial, with this v_i(0), epsilon and (in place of ``beta``) beta. The
        learner must have been made with ``rate_each``.
        Without it, rates stay as they are and v_i(0) is 0.
    """

    def __init__(self, learner: FusedTD, beta: float = 0.01, adapt: VarioEta | None = None) -> None:
        if learner.settings.vario is not None:
            raise ValueError("the learner's own vario-eta must be off: settings.vario must be None")
        if adapt is not None and not learner.rate_each:
            raise ValueError("to adapt its rates, the learner must be made with rate_each=True")
        self.learner = learner
        self.adapt = adapt
        self.beta = adapt.beta if adapt else beta
        self.connected = learner.network.connected
        self.variance = torch.full_like(learner.rate, adapt.initial_variance if adapt else 0.0)
        self.mean = torch.zeros_like(learner.rate)
        if adapt:
            self._set_rates(adapt)

    def _set_rates(self, vario: VarioEta) -> None:
        eta = self.learner.settings.eta
        rate: Tensor = vario_eta.learning_rate(self.variance, eta, vario.epsilon)
        self.learner.rate[:] = self.learner.base_rate * rate

    def train(self, initial_states: Array) -> None:
        """One trial from each of ``initial_states`` (trials, p)."""
        learner, c = self.learner, self.connected
        weight = learner.network.weight.data
        for x in initial_states:
            before = weight.clone()
            learner.train(x[None])
            change = (weight - before)[c]
            self.variance[c] = vario_eta.variance(self.variance[c], change, learner.rate[c], self.beta)
            self.mean[c] = (1 - self.beta) * self.mean[c] + self.beta * change / learner.rate[c]
            if self.adapt:
                self._set_rates(self.adapt)
