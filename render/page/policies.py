"""What the page has to know of a policy: its swimmer as MJCF, its network, the encoding of states, its speed."""

from __future__ import annotations

import base64
import dataclasses
from typing import Any

import numpy as np
import torch

from swimmer_mj.learning.networks.networks import Cascade, Multilayer
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.forms import BatchForm, HoldForm, Policy, SwimmerForm
from swimmer_mj.mjcf import mjcf

__all__ = ["describe", "require_playable"]


def describe(
    policy: Policy, name: str, label: str, speed: float, ci95: tuple[float, float] | None
) -> dict[str, Any]:
    """A policy as JSON values.

    Parameters
    ----------
    policy : Policy
        The greedy policy of a swimmer's value network.
    name : str
        By which the page's ``window.swimmer.choose`` finds it.
    label : str
        What the page shows.
    speed, ci95 : float, (float, float)
        Swimming speed as ``swimmer-mj evaluate`` measures it, and its interval if one is known, m/s.

    Raises
    ------
    ValueError
        As :func:`require_playable`.
    """
    swimmer, batch, network = require_playable(policy, name)
    problem = policy.problem
    return {
        "name": name,
        "label": label,
        "links": swimmer.parameters.n_links,
        "parameters": dataclasses.asdict(swimmer.parameters),
        "mjcf": mjcf(swimmer.parameters, friction="actuators"),
        "s_gamma": problem.s_gamma,
        "coordinates": "state" if batch.coordinates is None else "joints",
        "held": problem.form(HoldForm) is not None,
        "inputs": problem.n_inputs,
        "encoding": {key: values.tolist() for key, values in batch.encoding._asdict().items()},
        "network": _network(network),
        "speed": speed,
        "ci95": ci95,
    }


def require_playable(policy: Policy, name: str) -> tuple[SwimmerForm, BatchForm, Cascade | Multilayer]:
    """What the page is made of.

    Raises
    ------
    ValueError
        In one line: the page cannot play the policy.
    """
    problem = policy.problem
    swimmer, batch = problem.form(SwimmerForm), problem.form(BatchForm)
    if swimmer is None:
        raise ValueError(f"{name} learned {problem.name!r}; the page shows swimmers only")
    if batch is None:
        raise ValueError(
            f"{name}: the page knows networks that hear cosines and sines of angles; learn with encoding "
            "'circle' and integrator 'euler'"
        )
    network = getattr(policy, "network", None)
    if not (isinstance(policy, GreedyPolicy) and isinstance(network, Cascade | Multilayer)):
        raise ValueError(
            f"{name}: the page plays greedy policies of cascades and layers, got {type(policy).__name__} of "
            f"{type(network).__name__}"
        )
    return swimmer, batch, network


def _network(network: Cascade | Multilayer) -> dict[str, Any]:
    """Kind, shape and weights."""
    weights = torch.nn.utils.parameters_to_vector(network.parameters()).detach().cpu().numpy()
    shared = {"dtype": str(weights.dtype), "weights": _base64(weights)}
    if isinstance(network, Cascade):
        return {
            "kind": "cascade",
            "inputs": network.n_inputs,
            "neurons": network.n_neurons,
            "sigmoid": network.sigmoid,
            **shared,
        }
    linear = [layer for layer in network.layers if isinstance(layer, torch.nn.Linear)]
    return {
        "kind": "layers",
        "widths": [network.n_inputs, *(layer.out_features for layer in linear)],
        **shared,
    }


def _base64(values: np.ndarray[Any, Any]) -> str:
    """Little-endian, as JavaScript reads numbers on every machine in use."""
    return base64.b64encode(values.astype(values.dtype.newbyteorder("<")).tobytes()).decode()
