"""Means and their intervals, for people and for JSON."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

__all__ = ["known_interval", "mean_and_interval", "mean_and_interval_text"]

Array = NDArray[np.float64]


def mean_and_interval(values: Array) -> tuple[float, tuple[float, float]]:
    """Mean and its bootstrap 95 % interval (BCa, 10,000 resamples of fixed seed), which is nan for a single value."""
    mean = float(values.mean())
    if len(values) == 1:
        return mean, (math.nan, math.nan)
    if np.ptp(values) == 0:
        return mean, (mean, mean)
    interval = scipy.stats.bootstrap((values,), np.mean, n_resamples=9999, rng=np.random.default_rng(0))
    return mean, (float(interval.confidence_interval.low), float(interval.confidence_interval.high))


def known_interval(interval: tuple[float, float]) -> tuple[float, float] | None:
    """``interval``, or None (null in JSON) where it is unknown."""
    return None if math.isnan(interval[0]) else interval


def mean_and_interval_text(values: Array, spec: str = "z.2f") -> str:
    """Such as "1.20 [1.10, 1.31]"; of a single value, the value alone."""
    mean, interval = mean_and_interval(values)
    if known_interval(interval) is None:
        return f"{mean:{spec}}"
    low, high = interval
    return f"{mean:{spec}} [{low:{spec}}, {high:{spec}}]"
