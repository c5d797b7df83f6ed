"""A model's simulations, one a thread, and the compiled loops over batches of states."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import copy
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj.learning.problems.mujoco.implicit import implicit
from swimmer_mj.learning.problems.mujoco.kernel import Readings, Simulation
from swimmer_mj.learning.problems.mujoco.library import Functions, functions
from swimmer_mj.learning.problems.mujoco.readings import Reading, addresses

__all__ = ["Simulations", "learners_model", "own_model"]

Array = NDArray[np.float64]


def own_model(model: Any) -> Any:
    """A copy in which nothing is remembered from one state to the next (the solver's warm start).

    And in which a state that is no longer finite stays so: MuJoCo would go on from qpos0, where a goal may be.
    """
    own, flags = copy.copy(model), mujoco.mjtDisableBit
    own.opt.disableflags |= int(flags.mjDSBL_WARMSTART) | int(flags.mjDSBL_AUTORESET)
    return own


def learners_model(model: Any) -> Any:
    """:func:`own_model`, to be stepped by Euler's method if it was by Runge and Kutta's, implicitly in a fluid.

    A fluid's drag is stiff on a light link: explicit steps are stable only if they are far shorter than a control's.
    """
    own, kinds = own_model(model), mujoco.mjtIntegrator
    explicit = own.opt.integrator in (int(kinds.mjINT_RK4), int(kinds.mjINT_EULER))
    if explicit:
        fluid = own.opt.density > 0 or own.opt.viscosity > 0
        own.opt.integrator = int(kinds.mjINT_IMPLICITFAST if fluid else kinds.mjINT_EULER)
    return own


class Simulations:
    """As many mjData of one model as there are threads, at most ``threads``; they and it are made when they are needed.

    Nobody else may use the model that ``make`` gives, whose time step :meth:`run` sets.
    """

    def __init__(
        self,
        make: Callable[[], Any],
        home: Array,
        readings: tuple[Reading, ...],
        threads: int | None = None,
    ) -> None:
        self._make, self._home, self._readings = make, home, readings
        self.n_readings = sum(reading.size for reading in readings)
        self._threads = threads or os.cpu_count() or 1

    @cached_property
    def model(self) -> Any:
        """What is stepped."""
        return self._make()

    @cached_property
    def functions(self) -> Functions:
        """What steps the model."""
        return functions(self.model)

    @cached_property
    def _team(self) -> list[tuple[Any, Simulation, Readings]]:
        team = []
        for _ in range(self._threads):
            data = mujoco.MjData(self.model)
            mujoco.mj_forward(self.model, data)
            team.append((data, self._simulation(data), addresses(data, self._readings)))
        return team

    def __getstate__(self) -> dict[str, Any]:
        """Without what cannot be copied, and is made again when it is needed."""
        made = ("model", "functions", "_team", "_workers")
        return {name: value for name, value in self.__dict__.items() if name not in made}

    @property
    def _pool(self) -> ThreadPoolExecutor:
        """Threads of this process: those of one that has forked are not in its child."""
        process, pool = self.__dict__.get("_workers", (0, None))
        if pool is None or process != os.getpid():
            pool = ThreadPoolExecutor(self._threads)
            self._workers = (os.getpid(), pool)
        return pool

    def _simulation(self, data: Any) -> Simulation:
        return Simulation(
            self.model._address,
            data._address,
            data.qpos,
            data.qvel,
            data.act,
            data.ctrl,
            data.qacc,
            data.act_dot,
            data.actuator_moment.ravel(),
            data.moment_rownnz,
            data.moment_rowadr,
            data.moment_colind.ravel(),
            data.actuator_length,
            data.actuator_velocity,
            self._home,
            implicit(self.model, data),
        )

    def run(
        self, work: Callable[[Simulation, Readings, int, int], None], count: int, dt: float | None = None
    ) -> None:
        """``work(simulation, readings, first, last)`` for pieces of range(count), side by side."""
        if count == 0:
            return
        if dt is not None and dt > 0:
            self.model.opt.timestep = dt
        parts = min(self._threads, count)
        if parts == 1:
            _, simulation, readings = self._team[0]
            work(simulation, readings, 0, count)
            return
        ends = [count * k // parts for k in range(parts + 1)]
        futures = [
            self._pool.submit(work, simulation, readings, first, last)
            for (_, simulation, readings), first, last in zip(
                self._team[:parts], ends[:-1], ends[1:], strict=True
            )
        ]
        for future in futures:
            future.result()
