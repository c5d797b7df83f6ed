"""What a reward may read of a state, by name.

A reward is a torch function of a :class:`Scene`. Which names it asks for is found out by calling it once, so that
nothing has to be declared.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
import torch
from torch import Tensor

from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates
from swimmer_mj.learning.problems.mujoco.kernel import Readings

__all__ = ["Reading", "Scene", "addresses", "recorded", "scene_of"]


NOT_OF_THE_STATE = (int(mujoco.mjtSensor.mjSENS_CLOCK), int(mujoco.mjtSensor.mjSENS_E_KINETIC))
"""Time, and an energy that MuJoCo may have computed at the state before."""


class Reading(NamedTuple):
    """An unbroken piece of an array of mjData."""

    array: str
    start: int
    size: int


class Scene:
    """N states, as a reward sees them; all are float64 tensors with a leading axis of N.

    Lengths are in m, angles in rad, positions and frames in the world's frame. ``qpos`` and ``qvel`` are MuJoCo's,
    ``goal`` what the problem's draw gave as goals.
    """

    def __init__(
        self, model: Any, qpos: Tensor, qvel: Tensor, goal: Tensor, look_up: Callable[[Reading], Tensor]
    ) -> None:
        self._model, self._look_up = model, look_up
        self.qpos, self.qvel, self.goal = qpos, qvel, goal

    def _id(self, kind: int, what: str, name: str) -> int:
        number = mujoco.mj_name2id(self._model, kind, name)
        if number < 0:
            count = {"joint": "njnt", "site": "nsite", "body": "nbody", "geom": "ngeom", "sensor": "nsensor"}
            found = (
                mujoco.mj_id2name(self._model, kind, i) for i in range(getattr(self._model, count[what]))
            )
            raise ValueError(f"the model has no {what} {name!r}; it has {', '.join(filter(None, found))}")
        return number

    def joint(self, name: str) -> Tensor:
        """Position of a hinge (rad) or slide (m), shape (N,)."""
        return self.qpos[:, self._model.jnt_qposadr[self._scalar(name)]]

    def joint_velocity(self, name: str) -> Tensor:
        """Velocity of a hinge (rad/s) or slide (m/s), shape (N,)."""
        return self.qvel[:, self._model.jnt_dofadr[self._scalar(name)]]

    def _scalar(self, name: str) -> int:
        joint = self._id(mujoco.mjtObj.mjOBJ_JOINT, "joint", name)
        kind = mujoco.mjtJoint(int(self._model.jnt_type[joint]))
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ValueError(f"joint {name!r} is neither a hinge nor a slide; read qpos and qvel")
        return joint

    def _of(self, what: str, array: str, name: str, size: int) -> Tensor:
        kind = {"site": mujoco.mjtObj.mjOBJ_SITE, "geom": mujoco.mjtObj.mjOBJ_GEOM}
        number = self._id(kind.get(what, mujoco.mjtObj.mjOBJ_BODY), what, name)
        return self._look_up(Reading(array, size * number, size))

    def site(self, name: str) -> Tensor:
        """Position of a site, (N, 3)."""
        return self._of("site", "site_xpos", name, 3)

    def body(self, name: str) -> Tensor:
        """Position of a body's frame, (N, 3)."""
        return self._of("body", "xpos", name, 3)

    def geom(self, name: str) -> Tensor:
        """Position of a geom, (N, 3)."""
        return self._of("geom", "geom_xpos", name, 3)

    def site_frame(self, name: str) -> Tensor:
        """Orientation of a site, (N, 3, 3); columns are its axes."""
        return self._of("site", "site_xmat", name, 9).view(-1, 3, 3)

    def body_frame(self, name: str) -> Tensor:
        """Orientation of a body, (N, 3, 3)."""
        return self._of("body", "xmat", name, 9).view(-1, 3, 3)

    def geom_frame(self, name: str) -> Tensor:
        """Orientation of a geom, (N, 3, 3)."""
        return self._of("geom", "geom_xmat", name, 9).view(-1, 3, 3)

    def centre_of_mass(self, name: str) -> Tensor:
        """Centre of mass of a body and all that hangs on it, (N, 3)."""
        return self._of("body", "subtree_com", name, 3)

    def sensor(self, name: str) -> Tensor:
        """A sensor of positions or velocities, (N, its size)."""
        model = self._model
        number = self._id(mujoco.mjtObj.mjOBJ_SENSOR, "sensor", name)
        if model.sensor_needstage[number] == int(mujoco.mjtStage.mjSTAGE_ACC):
            raise ValueError(f"sensor {name!r} measures forces or accelerations, which depend on the control")
        if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_SENSOR):
            raise ValueError(f'sensor {name!r} reads nothing: the model has <flag sensor="disable"/>')
        if int(model.sensor_type[number]) in NOT_OF_THE_STATE:
            kind = mujoco.mjtSensor(int(model.sensor_type[number])).name
            raise ValueError(
                f"sensor {name!r} is of type {kind}, whose reading is not that of the state alone: read something else"
            )
        if model.sensor_delay[number] > 0 or np.any(model.sensor_history[number]):
            raise ValueError(
                f"sensor {name!r} has a delay or a history, which the state does not: leave them out"
            )
        return self._look_up(
            Reading("sensordata", int(model.sensor_adr[number]), int(model.sensor_dim[number]))
        )


def scene_of(
    model: Any, co: Coordinates, home: Any, x: Tensor, readings: tuple[Reading, ...], values: Tensor
) -> Scene:
    """The states x (N, p), differentiable, with ``values`` (N, r) of the readings."""
    qpos = torch.as_tensor(home, dtype=x.dtype).expand(len(x), -1).clone()
    qvel = x.new_zeros(len(x), model.nv)
    qpos[:, co.scalar_qpos] = x[:, co.scalar_row]
    for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
        qpos[:, start : start + 4] = x[:, row : row + 4]
    qvel[:, co.velocity_dof] = x[:, co.velocity_row]
    ends = np.cumsum([reading.size for reading in readings])

    def look_up(reading: Reading) -> Tensor:
        if reading not in readings:
            raise ValueError(
                f"{reading.array} was not read when the reward was first called: read the same each time"
            )
        k = readings.index(reading)
        return values[:, ends[k] - reading.size : ends[k]]

    return Scene(model, qpos, qvel, x[:, co.goal_row], look_up)


def recorded(
    model: Any, functions: Mapping[str, Callable[[Scene], Tensor]], goal_size: int
) -> tuple[Reading, ...]:
    """What ``functions``, by what they are, read, found by calling them at the model's own state."""
    found: list[Reading] = []
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def look_up(reading: Reading) -> Tensor:
        if reading not in found:
            found.append(reading)
        piece = getattr(data, reading.array).ravel()[reading.start : reading.start + reading.size]
        return torch.tensor(piece).expand(2, -1)

    qpos, qvel = torch.tensor(data.qpos).expand(2, -1), torch.tensor(data.qvel).expand(2, -1)
    for name, function in functions.items():
        scene = Scene(model, qpos, qvel, torch.zeros(2, goal_size, dtype=torch.float64), look_up)
        try:
            function(scene)
        except Exception as error:
            raise ValueError(_complaint(name, function, error)) from error
    return tuple(found)


def _complaint(name: str, function: Any, error: Exception) -> str:
    """One line of what went wrong in a function of a scene."""
    said = " ".join(str(error).split())
    if isinstance(error, ValueError):
        return said
    called = getattr(function, "__name__", repr(function))
    return f"{name} {called} fails at the model's own state: {type(error).__name__}: {said}"


def addresses(data: Any, readings: tuple[Reading, ...]) -> Readings:
    """Where compiled code finds them in ``data``."""
    place = [
        getattr(data, reading.array).ctypes.data + 8 * (reading.start + k)
        for reading in readings
        for k in range(reading.size)
    ]
    sensors = any(reading.array == "sensordata" for reading in readings)
    return Readings(np.array(place, dtype=np.int64), 0 if sensors else 1)
