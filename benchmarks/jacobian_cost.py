"""What does a state with its Jacobian cost, in steps of MuJoCo?

    python benchmarks/jacobian_cost.py

Chains of hinges in a fluid, 2 to 30 degrees of freedom. ``mj_step`` is a loop in compiled code, by Euler's method and,
as a learner steps a model in a fluid, by ``implicitfast``; a pull-back is what a
learner of value gradients needs of a state: the costate before a step from that after it, by forward differences of
MuJoCo's step. Prints a table and writes benchmarks/results/jacobian-cost.json. All rates of a chain take turns in one
process, and the highest of several repetitions counts.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.mujoco import MujocoProblem

OUT = Path(__file__).parent / "results" / "jacobian-cost.json"
DEGREES = (2, 3, 5, 8, 12, 20, 30)
TRAJECTORIES, STEPS, REPEATS, DT = 64, 5, 3, 0.005


def chain(n: int) -> str:
    """``n`` rods on hinges, a motor on each, in water."""
    body = ""
    for k in reversed(range(n)):
        body = (
            f'<body pos="{0.0 if k == 0 else 0.2} 0 0"><joint name="j{k}" axis="0 0 1" damping="0.05"/>'
            f'<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" contype="0" conaffinity="0"/>{body}</body>'
        )
    motors = "".join(f'<motor joint="j{k}" ctrlrange="-1 1" gear="0.1"/>' for k in range(n))
    return (
        f'<mujoco><option timestep="{DT}" density="1000" viscosity="0.001"/><worldbody>{body}</worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )


def rates(n: int) -> dict[str, float]:
    """Per second: steps, and states that are pulled back on one thread and on two."""
    rng = np.random.default_rng(0)
    work: dict[str, tuple[int, Callable[[], None]]] = {}
    model = mujoco.MjModel.from_xml_string(chain(n))
    data = mujoco.MjData(model)
    data.qvel[:] = rng.uniform(-1, 1, n)
    work["mj_step"] = 2000, lambda: mujoco.mj_step(model, data, 2000)
    implicit = mujoco.MjModel.from_xml_string(chain(n))
    implicit.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    its_data = mujoco.MjData(implicit)
    its_data.qvel[:] = data.qvel
    work["implicit_step"] = 2000, lambda: mujoco.mj_step(implicit, its_data, 2000)
    for threads in (1, 2):
        problem = MujocoProblem(
            chain(n), lambda scene: scene.qvel[:, 0], control_cost=[0.1] * n, threads=threads, without=()
        )
        batch = problem.batch()
        x = np.stack([problem.initial_states(rng, TRAJECTORIES).T] * (STEPS + 1))
        u = rng.uniform(-1, 1, (STEPS, n, TRAJECTORIES))
        V, slope = rng.normal(size=x[:, 0].shape), rng.normal(size=x.shape)
        out = np.empty((STEPS, problem.state_size + 1, TRAJECTORIES))

        def pull_back(batch=batch, x=x, u=u, V=V, slope=slope, out=out) -> None:
            batch.targets(x, u, V, slope, DT, 1.0, 1.0, out)

        work[f"pull_back_{threads}"] = TRAJECTORIES * STEPS, pull_back
    best = dict.fromkeys(work, 0.0)
    for _, run in work.values():
        run()
    for _ in range(REPEATS):
        for name, (count, run) in work.items():
            started = time.perf_counter()
            run()
            best[name] = max(best[name], count / (time.perf_counter() - started))
    return best


def main() -> None:
    """Print the table and write the log."""
    console, rows = Console(), []
    table = Table(
        "degrees of freedom", "mj_step /s", "implicit /s", "states /s, 1 thread", "2 threads", "steps a state"
    )
    for n in DEGREES:
        found = rates(n)
        rows.append({"degrees": n, **found})
        one, two = found["pull_back_1"], found["pull_back_2"]
        step, implicit = found["mj_step"], found["implicit_step"]
        table.add_row(
            str(n), *(f"{rate:,.0f}" for rate in (step, implicit, one, two)), f"{implicit / one:.1f}"
        )
    console.print(table)
    OUT.parent.mkdir(exist_ok=True)
    with replacing(OUT) as partial:
        partial.write_text(json.dumps({"mujoco": mujoco.__version__, "rows": rows}, indent=1) + "\n")
    note_made(OUT)


if __name__ == "__main__":
    main()
