"""Passive forces of one's own in MuJoCo, compiled.

    @law("lab.drag")
    def drag(site, c):
        vx, vy, vz = site.velocity
        return (-c * vx, -c * vy, -c * vz), (0.0, 0.0, 0.0)

    with drag.in_force():
        mujoco.mj_step(model, data)

Inside the scope, every model that declares the law, by a custom tuple of its name, feels it in each evaluation of its
forces: ``mj_step``, ``mj_forward``, ``mj_inverse``, ``mujoco.rollout``, ``mujoco.batch``, from any number of threads
and without the GIL. No other model feels anything. After the last scope, MuJoCo's callback is what it was before.
docs/physics.md says how to declare laws and how they fail.
"""

from swimmer_mj.passive.errors import LawError
from swimmer_mj.passive.laws import Law, law
from swimmer_mj.passive.site import Site, Vector

__all__ = ["Law", "LawError", "Site", "Vector", "law"]
