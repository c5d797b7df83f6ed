"""Another reward for Gymnasium's Swimmer-v5, which any_model_variants.py learns by."""

from __future__ import annotations

import torch
from torch import Tensor

from swimmer_mj.learning.problems.mujoco.readings import Scene


def centre_of_mass_velocity(scene: Scene) -> Tensor:
    """Velocity along x of the centre of mass of three rods of equal mass and 1 m, m/s, in place of the first one's.

    The same in the long run: the two come equally far, but for where in the swimmer the centre is at the ends.
    """
    angle = torch.cumsum(scene.qpos[:, 2:5], dim=1)
    rate = torch.cumsum(scene.qvel[:, 2:5], dim=1)
    across = -torch.sin(angle) * rate  # d/dt of cos
    # Middles: +1 of the first link's axis; 0.5 back and half of the second; and so on (m)
    first = across[:, 0]
    second = 0.5 * across[:, 0] - 0.5 * across[:, 1]
    third = 0.5 * across[:, 0] - across[:, 1] - 0.5 * across[:, 2]
    return scene.qvel[:, 0] + (first + second + third) / 3
