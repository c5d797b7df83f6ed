"""A recorded episode: what evaluation writes and rendering reads."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.files import replacing
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["Trajectory"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """T control steps of a swimmer of n links, and the states they lead through.

    The arrays are stored as read-only float64 copies.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer.
    times : array_like, shape (T + 1,)
        s, strictly increasing.
    states : array_like, shape (T + 1, 2n + 4)
        Full states (see :mod:`swimmer_mj.state`).
    controls : array_like, shape (T, n - 1)
        N·m; ``controls[k]`` is held from ``times[k]`` to ``times[k + 1]``.
    target_directions : array_like, shape (T + 1,)
        Angle of the direction to swim in, rad, from the x axis. It may change in time.
    values : array_like, shape (T + 1,)
        V(x), m; NaN where unknown.
    hamiltonians : array_like, shape (T + 1,)
        H(x), m/s; NaN where unknown.
    """

    parameters: SwimmerParameters
    times: Array
    states: Array
    controls: Array
    target_directions: Array
    values: Array
    hamiltonians: Array

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.times.ndim != 1 or self.times.size == 0:
            raise ValueError(f"times must have shape (T + 1,) with T >= 0, got {self.times.shape}")
        n, steps = self.parameters.n_links, self.n_steps
        for name, shape in {
            "states": (steps + 1, st.full_size(n)),
            "controls": (steps, n - 1),
            "target_directions": (steps + 1,),
            "values": (steps + 1,),
            "hamiltonians": (steps + 1,),
        }.items():
            if (got := getattr(self, name).shape) != shape:
                raise ValueError(
                    f"{name} must have shape {shape} for {steps + 1} times and {n} links, got {got}"
                )
        for name in ("times", "states", "controls", "target_directions"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} must be finite")
        if not (np.diff(self.times) > 0).all():
            raise ValueError("times must increase strictly")

    @property
    def n_steps(self) -> int:
        """T, the number of control steps."""
        return self.times.size - 1

    @property
    def duration(self) -> float:
        """From the first to the last state, s."""
        return float(self.times[-1] - self.times[0])

    def index_at(self, time: float) -> int:
        """Index of the state nearest to ``time`` (s)."""
        after = int(np.clip(np.searchsorted(self.times, time), 1, max(self.n_steps, 1)))
        if self.n_steps == 0:
            return 0
        return after - int(time - self.times[after - 1] <= self.times[after] - time)

    def centers_of_mass(self) -> Array:
        """G at every time, shape (T + 1, 2), m."""
        return st.center_of_mass(self.parameters, self.states)

    def speeds(self) -> Array:
        """Velocity of the centre of mass along the target direction at every time, shape (T + 1,), m/s.

        Signed: it is the paper's reward, negative while the swimmer drifts the wrong way.
        """
        velocity = st.split_reduced(st.reduce(self.parameters, self.states), self.parameters.n_links).velocity
        return (velocity * st.link_directions(self.target_directions)).sum(axis=-1)

    def speed(self, after: float = 0.0) -> float:
        """Mean velocity of the centre of mass along the target direction, m/s.

        Displacement along the target over elapsed time, from the first state at or after the time ``after``
        (s) to the last one. Over a control step, the target is the one at its start.
        """
        first = int(np.searchsorted(self.times, after - 1e-9))
        if first >= self.n_steps:
            raise ValueError(f"after must be less than the last time {self.times[-1]:g} s, got {after!r}")
        steps = np.diff(self.centers_of_mass()[first:], axis=0)
        along = (steps * st.link_directions(self.target_directions[first:-1])).sum()
        return float(along / (self.times[-1] - self.times[first]))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write to ``path``, an .npz without pickles whose ``parameters`` is JSON."""
        parameters = np.array(json.dumps(dataclasses.asdict(self.parameters)))
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        with replacing(path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, parameters=parameters, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Read what :meth:`save` wrote."""
        content = Path(path).read_bytes()
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                parameters = SwimmerParameters(**json.loads(file["parameters"].item()))
                return cls(parameters, *(file[name] for name in _ARRAYS))
        except _UNREADABLE as error:
            raise ValueError(f"{os.fspath(path)} is not a saved trajectory: {error}") from error


# What NumPy, zipfile and JSON raise at a file that is damaged or another
_UNREADABLE = (
    AttributeError, KeyError, TypeError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
_ARRAYS = tuple(field.name for field in dataclasses.fields(Trajectory) if field.name != "parameters")
