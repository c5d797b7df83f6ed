"""Do compiled passive forces keep their hands to themselves when many threads step many models at once?

    python benchmarks/callback_stress.py [--repeats 50]

Eight threads step swimmers of different n, parameters, integrators and statements of the friction, four step models
with one or two laws besides, each in scopes of its own that open and close all the time, while four threads step
models that declare none. Every state of every trajectory is compared, bit for bit, with that of the same trajectory
alone in one thread. Exit status 1 if any differs.
"""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from contextlib import ExitStack

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.mjcf import mjcf
from swimmer_mj.passive import Law, law
from swimmer_mj.validation import random_parameters
from swimmer_mj.viscous import friction

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


BUOYS = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body pos="0 0 1"><freejoint/><geom size=".1"/><site name="a" pos=".1 0 0"/></body>
    <body pos="1 0 1"><freejoint/><geom size=".1"/><site name="b" pos="0 .1 0"/></body>
  </worldbody>
</mujoco>
"""


@law("stress.drag")
def drag(site, c):
    """Quadratic drag."""
    x, y, z = site.velocity
    k = -c * math.sqrt(x * x + y * y + z * z)
    return (k * x, k * y, k * z), (0.0, 0.0, 0.0)


@law("stress.spring")
def spring(site, stiffness, reach, rate):
    """A spring whose far end swings."""
    x, y, z = site.position
    far = reach * math.cos(rate * site.time)
    return (stiffness * (far - x), -stiffness * y, stiffness * (1 - z)), (0.0, 0.0, 0.0)


def buoys(dragged: float, sprung: float) -> tuple[mujoco.MjModel, list[Law]]:
    """Two bodies with drag, a spring or both (0 for none)."""
    spec, laws = mujoco.MjSpec.from_string(BUOYS), []
    if dragged:
        drag.declare(spec, "a", c=dragged)
        drag.declare(spec, "b", c=2 * dragged)
        laws.append(drag)
    if sprung:
        spring.declare(spec, "a", stiffness=sprung, reach=0.3, rate=5)
        laws.append(spring)
    return spec.compile(), laws


def models() -> list[tuple[mujoco.MjModel, list[Law]]]:
    """Eight swimmers, four models with other laws and four with none, each with the laws that it needs."""
    rng = np.random.default_rng(0)
    found = []
    for n in range(1, 9):
        statement = "actuators" if n == 4 else "callback"
        xml = mjcf(random_parameters(rng, n), friction=statement, integrator="Euler" if n % 2 else "RK4")
        found.append((mujoco.MjModel.from_xml_string(xml), [] if n == 4 else [friction]))
    found += [buoys(2.0, 0.0), buoys(0.0, 50.0), buoys(1.0, 30.0), buoys(3.0, 20.0)]
    found[-1][1].reverse()  # of the last two, each has its laws put in force in another order
    return found + [(mujoco.MjModel.from_xml_string(xml), []) for xml in (FLUID, CONTACT) * 2]


def trajectory(model: mujoco.MjModel, laws: list[Law]) -> NDArray[np.float64]:
    """States of one model, its own scopes opening and closing."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(model.nv)
    data.qvel[:] = rng.uniform(-0.5, 0.5, model.nv)
    states = []
    for _ in range(SCOPES):
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        with ExitStack() as scopes:
            for one in laws:
                scopes.enter_context(one.in_force())
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
        "8 swimmers, 4 models with other laws and 4 with none in 16 threads, "
        f"{SCOPES * STEPS} steps each, {repeats} times: "
        f"{different} differences ({time.perf_counter() - started:.0f} s)"
    )
    return 0 if different == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
