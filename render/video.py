"""The swimmer as MuJoCo draws it: frames of a trajectory, or of two in the same water."""
# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import atexit
import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.mjcf import mjcf
from swimmer_mj.render.backend import use_backend
from swimmer_mj.render.encoding import Frame, write_video
from swimmer_mj.render.figures import INK
from swimmer_mj.render.overlay import SERIES_COLORS, draw_arcs, draw_moment, make_panel, signed, write
from swimmer_mj.trajectory import Trajectory

__all__ = ["Frame", "frames", "write_video"]

Array = NDArray[np.float64]

PANEL_SHARE = 0.24
"""Of a frame's height, what the curves of an overlay take."""
SMALLEST = 160, 150
"""Width and height of a frame with an overlay, pixels: less has no room for the curves."""
LANES = 0.6
"""How far apart two swimmers start, in lengths of the longer one."""
RIVALS = (((0.10, 0.33, 0.50), (0.42, 0.67, 0.86)), ((0.72, 0.30, 0.05), (0.96, 0.62, 0.33)))
"""Where there are two, the colours of the odd and the even links of each."""


@dataclass(frozen=True)
class _Look:
    """How frames look."""

    width: int
    height: int
    camera: str
    samples: int
    caption: bool
    overlay: bool
    names: tuple[str, ...]


def frames(
    trajectory: Trajectory,
    *,
    width: int = 640,
    height: int = 480,
    fps: float = 30,
    camera: Literal["tracking", "top"] = "tracking",
    samples: int = 0,
    caption: bool = True,
    overlay: bool = False,
    slow: float = 1.0,
    against: Trajectory | None = None,
    names: Sequence[str] = (),
) -> Iterator[Frame]:
    """Draw ``trajectory`` without a screen.

    Nothing is simulated: each frame shows the state at its time, linearly between the two recorded states next to it.
    A mark ahead of the swimmer shows the target direction.

    Parameters
    ----------
    trajectory : Trajectory
        What to draw.
    width, height : int
        Size of a frame, pixels.
    fps : float
        Frames per second; frame k is at the time k / (fps slow) after the first state.
    camera : {"tracking", "top"}
        Follow the centre of mass, or stay where the swimmer started.
    samples : int
        Multisampling, which smooths edges. On the CPU, 4 takes three times as long as 0.
    caption : bool
        Write the time and the speed along the target direction into the frame.
    overlay : bool
        Torques as arcs at the joints; below the water torques (of two swimmers: speeds), V and H of the whole episode,
        with a mark at the time of the frame.
    slow : float
        How many times more slowly time goes than it did.
    against : Trajectory, optional
        Of another swimmer, in the same water beside the first one. The camera then keeps both in sight.
    names : sequence of str
        What captions call the swimmers.

    Yields
    ------
    ndarray of uint8, shape (height, width, 3)
        As many frames as make up the trajectory's duration (of two, the longer one's), at least one.

    Raises
    ------
    BackendError
        If no OpenGL backend can be used (see :mod:`swimmer_mj.render.backend`).
    """
    for name, value in {"width": width, "height": height, "fps": fps, "slow": slow}.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
    if camera not in ("tracking", "top"):
        raise ValueError(f"camera must be 'tracking' or 'top', got {camera!r}")
    if samples < 0:
        raise ValueError(f"samples must not be negative, got {samples!r}")
    if overlay and (width < SMALLEST[0] or height < SMALLEST[1]):
        raise ValueError(
            f"a frame with an overlay must be at least {SMALLEST[0]} x {SMALLEST[1]} pixels, got {width} x {height}"
        )
    shown = [trajectory] if against is None else [trajectory, against]
    if len(names) > len(shown):
        raise ValueError(f"names must be at most {len(shown)}, as there are swimmers; got {len(names)}")
    use_backend()
    look = _Look(width, height, camera, samples, caption, overlay, tuple(names))
    start = trajectory.times[0]
    count = max(1, round(max(one.duration for one in shown) * slow * fps))
    return _draw(shown, [start + k / (fps * slow) for k in range(count)], look)


@dataclass(frozen=True)
class _Pose:
    """A swimmer at a moment."""

    state: Array
    """(2n + 4,)."""
    center: Array
    """Of mass, m."""
    direction: float
    """To swim in, rad."""
    index: int
    """Of the state nearest to the moment."""
    step: int
    """Of the control in force."""


def _pose(trajectory: Trajectory, time: float, shift: Array) -> _Pose:
    """Linearly between two states; before the first and after the last, those."""
    times = trajectory.times
    i = int(np.clip(np.searchsorted(times, time + 1e-9, side="right") - 1, 0, max(trajectory.n_steps - 1, 0)))
    j = min(i + 1, trajectory.n_steps)
    share = 0.0 if i == j else float(np.clip((time - times[i]) / (times[j] - times[i]), 0.0, 1.0))
    state = (1 - share) * trajectory.states[i] + share * trajectory.states[j]
    state[:2] += shift
    center = st.center_of_mass(trajectory.parameters, state)
    nearest = trajectory.index_at(time)
    return _Pose(state, center, float(trajectory.target_directions[nearest]), nearest, i)


class _Actor:
    """A swimmer's model, to be put into a pose."""

    def __init__(
        self, trajectory: Trajectory, colors: Sequence[Sequence[float]] | None, shift: Array
    ) -> None:
        import mujoco

        self.trajectory, self.shift, self.speeds = trajectory, shift, trajectory.speeds()
        self.model = mujoco.MjModel.from_xml_string(mjcf(trajectory.parameters))
        # Fewer corners than MuJoCo's 28 and 16 cannot be told apart at a few pixels' radius, and save 1 ms a frame.
        self.model.vis.quality.numslices, self.model.vis.quality.numstacks = 16, 8
        self.data = mujoco.MjData(self.model)
        if colors is not None:
            for name, color in zip(("self", "effector"), colors, strict=True):
                self.model.material(name).rgba[:3] = color

    def pose(self, time: float) -> _Pose:
        """Take the pose of ``time`` (s)."""
        import mujoco

        from swimmer_mj.dynamics import to_qpos_qvel

        pose = _pose(self.trajectory, time, self.shift)
        model, data = self.model, self.data
        data.qpos[:] = to_qpos_qvel(pose.state, self.trajectory.parameters.n_links).qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)  # the tracking camera follows it
        mujoco.mj_camlight(model, data)
        return pose

    def mark(self, place: Array, direction: float) -> None:
        """Put the mark of the target direction somewhere."""
        import mujoco

        mark = self.model.body("target").mocapid[0]
        self.data.mocap_pos[mark, :2] = place
        self.data.mocap_quat[mark] = np.cos(direction / 2), 0.0, 0.0, np.sin(direction / 2)
        mujoco.mj_kinematics(self.model, self.data)


def _draw(shown: Sequence[Trajectory], times: Sequence[float], look: _Look) -> Iterator[Frame]:
    # Bound to the backend only now; dynamics imports mujoco too.
    import mujoco

    panel_height = 2 * round(PANEL_SHARE * look.height / 2) if look.overlay else 0
    water = look.height - panel_height
    panel = make_panel(shown, look.width, panel_height) if look.overlay else None
    length = max(float(one.parameters.lengths.sum()) for one in shown)
    if len(shown) == 1:
        actors = [_Actor(shown[0], None, np.zeros(2))]
    else:
        shifts = _shifts(shown, LANES * length)
        actors = [_Actor(*what) for what in zip(shown, RIVALS, shifts, strict=True)]
    model = actors[0].model
    model.vis.global_.offwidth = look.width
    model.vis.global_.offheight = water
    model.vis.quality.offsamples = look.samples
    with mujoco.Renderer(model, water, look.width) as renderer, contextlib.ExitStack() as stack:
        atexit.register(
            renderer.close
        )  # of a generator that is still there when Python ends: later, OpenGL is not
        stack.callback(atexit.unregister, renderer.close)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False  # the ground hides it
        for time in times:
            poses = [actor.pose(time) for actor in actors]
            if len(actors) == 1:
                _see_one(renderer, actors[0], poses[0], length, look.camera)
            else:
                _see_both(renderer, actors, poses, length, look.width / water)
            frame = np.empty((look.height, look.width, 3), np.uint8)
            renderer.render(out=frame[:water])
            if look.overlay:
                eye = np.mean([camera.pos for camera in renderer.scene.camera], axis=0)
                fovy = float(model.vis.global_.fovy)
                for actor, pose in zip(actors, poses, strict=True):
                    _draw_torques(frame[:water], actor.trajectory, pose, eye, fovy)
            if look.caption:
                _write_caption(frame[:water], look, actors, poses, time)
            if panel is not None:
                frame[water:] = panel.picture
                draw_moment(frame, panel, time, _numbers(actors, poses))
            yield frame


def _shifts(shown: Sequence[Trajectory], distance: float) -> list[Array]:
    """Where two swimmers start: the first one's centre of mass stays, the other's comes to stand on its right."""
    first, second = (one.centers_of_mass()[0] for one in shown)
    direction = shown[0].target_directions[0]
    right = np.array([np.sin(direction), -np.cos(direction)])
    return [np.zeros(2), first - second + distance * right]


def _see_one(renderer: Any, actor: _Actor, pose: _Pose, length: float, camera: str) -> None:
    ahead = (length / 2 + 1.0) * np.array([np.cos(pose.direction), np.sin(pose.direction)])
    actor.mark(pose.center + ahead, pose.direction)
    renderer.update_scene(actor.data, camera)


def _see_both(
    renderer: Any, actors: Sequence[_Actor], poses: Sequence[_Pose], length: float, aspect: float
) -> None:
    """From above the middle between two swimmers, high enough to see both and the mark."""
    import mujoco

    centers = np.array([pose.center for pose in poses])
    middle, half = centers.mean(axis=0), np.ptp(centers, axis=0) / 2
    direction = poses[0].direction
    forward = np.array([np.cos(direction), np.sin(direction)])
    actors[0].mark(middle + (half @ np.abs(forward) + length / 2 + 1.0) * forward, direction)
    margin = length / 2 + 0.2 + 1.5 * np.abs(forward)
    needed = max((half[0] + margin[0]) / aspect, half[1] + margin[1])
    view = mujoco.MjvCamera()
    view.type, view.azimuth, view.elevation = mujoco.mjtCamera.mjCAMERA_FREE, 90.0, -90.0
    view.lookat[:] = *middle, 0.0
    view.distance = needed / math.tan(math.radians(actors[0].model.vis.global_.fovy) / 2)
    renderer.update_scene(actors[0].data, view)
    alone = mujoco.MjvOption()
    alone.geomgroup[1] = 0  # not the second one's ground and mark
    other, everything = actors[1], mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_addGeoms(other.model, other.data, alone, mujoco.MjvPerturb(), everything.value, renderer.scene)


# Captions and overlays --------------------------------------------------------------------------------------------


def _draw_torques(water: Frame, trajectory: Trajectory, pose: _Pose, eye: Array, fovy: float) -> None:
    """``eye``: where the camera is, m; it looks down, and y points upwards."""
    parameters = trajectory.parameters
    if not (parameters.torque_limits.size and trajectory.n_steps):
        return
    height, width, _ = water.shape
    scale = height / 2 / (eye[2] * math.tan(math.radians(fovy) / 2))  # pixels to a metre
    joints = st.joint_positions(parameters, pose.state)[1:-1]
    pixels = np.array([width, height]) / 2 - 0.5 + scale * (joints - eye[:2]) * (1, -1)
    angles = st.split(pose.state, parameters.n_links).angles[1:]
    levels = trajectory.controls[pose.step] / parameters.torque_limits
    draw_arcs(water, pixels, angles, levels, max(9.0, 0.3 * scale * float(parameters.lengths.mean())))


def _numbers(actors: Sequence[_Actor], poses: Sequence[_Pose]) -> list[list[float]]:
    """Of each graph of the panel, the values now."""
    both = [(actor, actor.trajectory, pose.index) for actor, pose in zip(actors, poses, strict=True)]
    return [
        [float(actor.speeds[i]) for actor, _, i in both] if len(actors) > 1 else [],
        [float(one.values[i]) for _, one, i in both],
        [float(one.hamiltonians[i]) for _, one, i in both],
    ]


def _write_caption(
    water: Frame, look: _Look, actors: Sequence[_Actor], poses: Sequence[_Pose], time: float
) -> None:
    """At the lower left: the time, and a line a swimmer where there are two."""
    size = max(12, look.height // 28)
    speeds = [float(actor.speeds[pose.index]) for actor, pose in zip(actors, poses, strict=True)]
    if len(actors) == 1:
        name = f"{look.names[0]}    " if look.names else ""
        lines = [(f"{name}t = {time:.2f} s    speed along target {signed(speeds[0])} m/s", INK)]
    else:
        names = [*look.names, *("first", "second")[len(look.names) :]]
        lines = [(f"t = {time:.2f} s    speed along target", INK)]
        lines += [
            (f"{signed(speed)} m/s  {name}", color)
            for name, speed, color in zip(names, speeds, SERIES_COLORS, strict=True)
        ]
    for k, (text, color) in enumerate(reversed(lines)):
        position = (0.6 * size, len(water) - (0.6 + 1.35 * k) * size)
        write(water, position, text, color, size, halo=2)
