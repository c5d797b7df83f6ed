"""Other models of the process, on which nothing of ours may act."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.validation.cases import EPS
from swimmer_mj.validation.records import Check, Section
from swimmer_mj.viscous import viscous_friction

__all__ = ["other_models"]

Array = NDArray[np.float64]

_FOREIGN_MODEL = """
<mujoco model="pendulum in MuJoCo's own fluid">
  <option density="1000" viscosity="0.1"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.1" stiffness="0.3"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      <site name="upper" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      <body name="lower" pos="0.5 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      </body>
    </body>
  </worldbody>
  <custom>
    <numeric name="swimmer_mj.viscous_friction" data="7"/>
    <tuple name="friction"><element objtype="site" objname="upper" prm="7"/></tuple>
    <tuple name="swimmer_mj.viscous_friction2"><element objtype="site" objname="upper" prm="7"/></tuple>
  </custom>
</mujoco>
"""
"""What is nearly a declaration of the friction, and is none."""


def other_models() -> Section:
    """Check that another model moves as it does without us, to the last bit, while a swimmer feels its friction."""

    def final_state() -> Array:
        model = mujoco.MjModel.from_xml_string(_FOREIGN_MODEL)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        return np.concatenate([data.qpos, data.qvel])

    alone = final_state()
    swimmer = mujoco.MjModel.from_xml_string(mjcf(PAPER))
    swimmer_data = mujoco.MjData(swimmer)
    swimmer_data.qvel[1] = 1.0  # m/s, across its links, which lie along x
    drag = -PAPER.viscous_friction * PAPER.lengths.sum()  # N, all of it along y
    with viscous_friction():
        mujoco.mj_forward(swimmer, swimmer_data)
        friction = float(swimmer_data.qfrc_passive[1])
        mujoco.mj_step(swimmer, swimmer_data, 10)
        beside = final_state()
    return Section(
        "Other models in the process",
        [
            Check(
                "another model beside a swimmer: change of its state",
                float(np.abs(beside - alone).max()),
                0.0,
                "nothing may act on it",
            ),
            Check(
                "the swimmer beside it, drifting sideways: its friction, from -k l v of all links",
                abs(friction - drag) / abs(drag),
                (PAPER.n_links + 4) * EPS,
                "a rounding for each link, and 4 in the force of one",
            ),
        ],
    )
