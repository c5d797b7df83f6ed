"""Does the friction's callback keep its hands to itself when many threads step many models at once?

    python benchmarks/callback_stress.py [--repeats 50]

Eight threads step swimmers of different n, parameters, integrators and statements of the friction, each in scopes of
its own that open and close all the time, while four threads step models that are no swimmers. Every state of every
trajectory is compared, bit for bit, with that of the same trajectory alone in one thread. Exit status 1 if any differs.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from contextlib import nullcontext

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.mjcf import mjcf
from swimmer_mj.validation import random_parameters
from swimmer_mj.viscous import viscous_friction

SCOPES, STEPS = 20, 25  # scopes a trajectory, steps a scope

FLUID = """
<mujoco>
  <option density="1000" viscosity="0.1" timestep="0.002"/>
  <worldbody>
    <body><joint name="a" damping="0.1" stiffness="0.3" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".05"/><site name="a" type="capsule" size=".05 .25"/>
      <body pos=".5 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".05"/></body>
    </body>
  </worldbody>
  <custom><tuple name="somebody_elses"><element objtype="site" objname="a" prm="7"/></tuple></custom>
</mujoco>
"""

CONTACT = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .3"><freejoint/><geom size=".1"/></body>
    <body pos=".05 0 .6"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  </worldbody>
</mujoco>
"""


def models() -> list[tuple[mujoco.MjModel, bool]]:
    """Eight swimmers and four other models, each with whether it needs the callback."""
    rng = np.random.default_rng(0)
    found = []
    for n in range(1, 9):
        friction = "actuators" if n == 4 else "callback"
        xml = mjcf(random_parameters(rng, n), friction=friction, integrator="Euler" if n % 2 else "RK4")
        found.append((mujoco.MjModel.from_xml_string(xml), friction == "callback"))
    return found + [(mujoco.MjModel.from_xml_string(xml), False) for xml in (FLUID, CONTACT) * 2]


def trajectory(model: mujoco.MjModel, viscous: bool) -> NDArray[np.float64]:
    """States of one model, its own scopes opening and closing."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(model.nv)
    data.qvel[:] = rng.uniform(-0.5, 0.5, model.nv)
    states = []
    for _ in range(SCOPES):
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        with viscous_friction() if viscous else nullcontext():
            mujoco.mj_step(model, data, STEPS)
        states.append(np.concatenate([data.qpos, data.qvel, data.qfrc_passive]))
    return np.array(states)


def differences(repeats: int) -> int:
    """In how many repeats the threads' trajectories differed from those alone."""
    work = models()
    alone = [trajectory(*one) for one in work]
    assert all(np.isfinite(states).all() for states in alone)
    different = 0
    for _ in range(repeats):
        found: list[NDArray[np.float64] | None] = [None] * len(work)
        start = threading.Barrier(len(work))

        def run(
            i: int, found: list[NDArray[np.float64] | None] = found, start: threading.Barrier = start
        ) -> None:
            start.wait()
            found[i] = trajectory(*work[i])

        threads = [threading.Thread(target=run, args=(i,)) for i in range(len(work))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        same = [f is not None and np.array_equal(f, a) for f, a in zip(found, alone, strict=True)]
        different += not all(same) or mujoco.get_mjcb_passive() is not None
    return different


def main() -> int:
    """Print the count; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=50)
    repeats = parser.parse_args().repeats
    started = time.perf_counter()
    different = differences(repeats)
    print(
        f"8 swimmers and 4 other models in 12 threads, {SCOPES * STEPS} steps each, {repeats} times: "
        f"{different} differences ({time.perf_counter() - started:.0f} s)"
    )
    return 0 if different == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
