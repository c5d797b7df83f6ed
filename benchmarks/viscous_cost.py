"""What does the viscous friction cost, and does it scale to all cores?

    python benchmarks/viscous_cost.py [--json FILE]

One step of the paper's swimmer (5 links) by ``mj_step`` in its own compiled loop: bare (no friction at all), with the
callback, and with the friction as actuators. Blocks of 100 steps of each take turns, and the same quantile of each is
compared, so that a busy machine slows all alike. Exit status 1 if a viscous Euler step costs more than 1.1 bare
ones. Then the same steps by ``mujoco.rollout`` and ``mujoco.batch`` on one thread and on two, where the ideal is 2.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np

from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.viscous import viscous_friction

LIMIT = 1.10
BLOCK = 100  # steps, some 0.3 ms: shorter than a scheduler's time slice
QUANTILE = 0.25
KINDS = ("bare", "callback", "actuators")


def step_times(integrator: str, blocks: int) -> dict[str, float]:
    """Microseconds a step of each kind."""
    models = {
        kind: mujoco.MjModel.from_xml_string(
            mjcf(PAPER, integrator=integrator, friction="actuators" if kind == "actuators" else "callback")
        )
        for kind in KINDS
    }
    data = {kind: mujoco.MjData(model) for kind, model in models.items()}
    times = {kind: np.empty(blocks) for kind in KINDS}
    for i in range(blocks):
        for kind, model in models.items():
            data[kind].qvel[:] = 0.1  # without friction, motions of the same size in every block
            scope: AbstractContextManager[None] = viscous_friction() if kind == "callback" else nullcontext()
            with scope:
                started = time.perf_counter()
                mujoco.mj_step(model, data[kind], BLOCK)
                times[kind][i] = time.perf_counter() - started
    return {kind: float(np.quantile(t, QUANTILE) / BLOCK * 1e6) for kind, t in times.items()}


def pool_rates(repeats: int) -> dict[str, dict[int, float]]:
    """Viscous Euler steps a second by MuJoCo's own thread pools, by number of threads: the best of ``repeats``."""
    model = mujoco.MjModel.from_xml_string(mjcf(PAPER, integrator="Euler"))
    n_simulations, n_steps = 64, 200
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    state = np.empty(size)
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    initial = np.tile(state, (n_simulations, 1))
    rates: dict[str, dict[int, float]] = {"rollout": {1: 0.0, 2: 0.0}, "batch": {1: 0.0, 2: 0.0}}
    pools = {n: mujoco.rollout.Rollout(nthread=n if n > 1 else 0) for n in (1, 2)}
    batches = {n: mujoco.batch.Batch(model, nsim=n_simulations, nthread=n) for n in (1, 2)}
    datas = [mujoco.MjData(model) for _ in range(2)]
    with viscous_friction():
        for _ in range(repeats):
            for n in (1, 2):
                started = time.perf_counter()
                pools[n].rollout(model, datas[:n], initial, nstep=n_steps)
                elapsed = time.perf_counter() - started
                rates["rollout"][n] = max(rates["rollout"][n], n_simulations * n_steps / elapsed)
                started = time.perf_counter()
                batches[n].step(nstep=n_steps)
                elapsed = time.perf_counter() - started
                rates["batch"][n] = max(rates["batch"][n], n_simulations * n_steps / elapsed)
    for pool in pools.values():
        pool.close()
    return rates


def main() -> int:
    """Print the tables; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="also write the numbers to this file")
    parser.add_argument("--blocks", type=int, default=3000, help="blocks of 100 steps of each kind")
    arguments = parser.parse_args()

    print(f"MuJoCo {mujoco.__version__}, {platform.machine()}, 5 links, microseconds a step")
    print(f"{'':12}" + "".join(f"{kind:>12}" for kind in KINDS) + "   callback / bare   actuators / bare")
    steps = {}
    for integrator in ("Euler", "RK4"):
        steps[integrator] = times = step_times(integrator, arguments.blocks)
        print(
            f"{integrator:12}"
            + "".join(f"{times[kind]:12.2f}" for kind in KINDS)
            + f"{times['callback'] / times['bare']:18.3f}{times['actuators'] / times['bare']:19.3f}"
        )
    pools = pool_rates(10)
    print("\nviscous steps a second   one thread   two threads   ratio")
    for name, rate in pools.items():
        print(f"mujoco.{name:17} {rate[1]:11,.0f} {rate[2]:13,.0f} {rate[2] / rate[1]:7.2f}")
    ratio = steps["Euler"]["callback"] / steps["Euler"]["bare"]
    verdict = "at most" if ratio <= LIMIT else "MORE than"
    print(f"\na viscous Euler step costs {ratio:.3f} bare ones: {verdict} {LIMIT}")
    if arguments.json is not None:
        result = {"microseconds": steps, "steps_per_second": pools, "ratio": ratio, "limit": LIMIT}
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0 if ratio <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
