"""Importing this module registers the swimmer's Gymnasium environments.

    import gymnasium
    import swimmer_mj.gymnasium

    env = gymnasium.make("swimmer_mj/Swim5-v0")                     # one swimmer
    envs = gymnasium.make_vec("swimmer_mj/Swim5-v0", num_envs=64)   # many, stepped together on all cores

or, without the import, ``gymnasium.make("swimmer_mj.gymnasium:swimmer_mj/Swim5-v0")``. There are ``Swim3-v0``,
``Swim4-v0``, ``Swim5-v0`` (swim along the x axis) and ``Steer3-v0``, ``Steer4-v0``, ``Steer5-v0`` (along a
direction that is drawn anew for each episode), each truncated after 500 steps of 0.01 s.
:mod:`swimmer_mj.environments.gymnasium` and :mod:`swimmer_mj.environments.vector` have their code.
"""

from __future__ import annotations

import gymnasium

from swimmer_mj.environments.gymnasium import SwimmerEnv

__all__ = ["SwimmerEnv"]

_MAX_EPISODE_STEPS = 500
"""5 s, a trial of the paper."""


def _register() -> None:
    for name in ("Swim", "Steer"):
        for n_links in (3, 4, 5):
            gymnasium.register(
                id=f"swimmer_mj/{name}{n_links}-v0",
                entry_point="swimmer_mj.environments.gymnasium:SwimmerEnv",
                vector_entry_point="swimmer_mj.environments.vector:SwimmerVectorEnv",
                max_episode_steps=_MAX_EPISODE_STEPS,
                kwargs={"task": f"{name.lower()}{n_links}"},
            )


_register()
