"""Passive forces of one's own in MuJoCo, compiled.

@law("lab.drag")
def drag(site, c):
    vx, vy, vz = site.velocity
    return (-c * vx, -c * vy, -c * vz), (0.0, 0.0, 0.0)

with drag.in_force():
    mujoco.mj_step(model, data)
"""

from swimmer_mj.passive.errors import LawError
from swimmer_mj.passive.laws import Law, law
from swimmer_mj.passive.site import Site, Vector

__all__ = ["Law", "LawError", "Site", "Vector", "law"]
