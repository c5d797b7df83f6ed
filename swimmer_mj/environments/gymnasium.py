"""The tasks of :mod:`swimmer_mj.environments.suite` as Gymnasium environments, to the last bit, without dm_control.

:mod:`swimmer_mj.gymnasium` registers them. Importing this module imports no MuJoCo; making an environment does.
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from swimmer_mj.libraries import load_triton_apart

if TYPE_CHECKING:
    from swimmer_mj.environments.simulation import Simulation
    from swimmer_mj.environments.swimming import InitialStates, Rules
    from swimmer_mj.parameters import SwimmerParameters

__all__ = ["SwimmerEnv"]

_LARGEST_FRAME = 1280, 720  # the model's offscreen buffer
_CAMERAS = "tracking", "top"

Array = NDArray[np.float64]
Action = NDArray[np.float32]


def legacy_seed(seed: int) -> int | list[int]:
    """``seed`` as ``RandomState`` takes it: itself where it can, else its words of 32 bits, lowest first."""
    if seed < 2**32:
        return seed
    return [seed >> shift & 0xFFFFFFFF for shift in range(0, seed.bit_length(), 32)]


def whole_number(name: str, value: Any, largest: float = float("inf"), *, least: int = 1) -> int:
    """``value``, an integer from ``least`` to ``largest``, as an int."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if not least <= number <= largest:
        bounds = f"of at least {least}" if largest == float("inf") else f"from {least} to {largest}"
        raise ValueError(f"{name} must be an integer {bounds}, got {value!r}")
    return number


class SwimmerEnv(gymnasium.Env[Array, Action]):
    """A task of :mod:`swimmer_mj.environments.suite` as a Gymnasium environment.

    **Observation**, ``Box(-inf, inf, (2n + 2,), float64)``: the task's observations one after the other, in
    the frame whose x axis is the target direction.

    ============  ==================================  =====
    Index         Quantity                            Unit
    ============  ==================================  =====
    0 .. n-1      angles of the links, in [-pi, pi]   rad
    n .. 2n-1     their angular velocities            rad/s
    2n, 2n+1      velocity of the centre of mass      m/s
    ============  ==================================  =====

    **Action**, ``Box(-1, 1, (n - 1,), float32)``: the torques of the joints in units of their limits, head
    first. Torques beyond the limits are clipped.

    **Reward**: the mean velocity of the centre of mass along the target direction during the step, m/s.

    **Episode**: starts from a random state and never terminates. ``gymnasium.make`` truncates it after 500
    steps, or as many as its ``max_episode_steps`` says; the bare class never does.

    ``reset(seed=s)`` starts the episodes of ``swimmer_mj.load(task, task_kwargs={"random": s})``: they are drawn
    from a ``RandomState``, ``task.random``. ``np_random``, Gymnasium's, gets the same seed and is left
    to wrappers. A pickled or copied environment goes on where the original stands.

    Parameters
    ----------
    task : str
        A task of :data:`swimmer_mj.environments.swimming.TASKS`, such as ``"swim5"``.
    params : SwimmerParameters, optional
        Another swimmer with the task's number of links.
    initial_states : callable, optional
        Where episodes start, see :class:`swimmer_mj.environments.swimming.Rules`.
    frame_skip : int
        How many steps of 0.01 s the action is held for in one step of the environment.
    render_mode : {None, "rgb_array"}
        Whether :meth:`render` gives frames.
    width, height : int
        Size of a frame, at most 1280 and 720.
    camera_name : {"tracking", "top"}
        Whether the camera follows the swimmer or looks at the place where episodes start.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012, as Gymnasium declares it

    def __init__(
        self,
        task: str,
        *,
        params: SwimmerParameters | None = None,
        initial_states: InitialStates | None = None,
        frame_skip: int = 1,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera_name: str = "tracking",
    ) -> None:
        from swimmer_mj.environments import swimming

        load_triton_apart()
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(
                f"render_mode must be None or one of {self.metadata['render_modes']}, got {render_mode!r}"
            )
        frame_skip = whole_number("frame_skip", frame_skip)
        width = whole_number("width", width, _LARGEST_FRAME[0])
        height = whole_number("height", height, _LARGEST_FRAME[1])
        if camera_name not in _CAMERAS:
            raise ValueError(f"camera_name must be one of {', '.join(_CAMERAS)}; got {camera_name!r}")
        if task not in swimming.TASKS:
            raise ValueError(f"there is no task {task!r}; the tasks are {', '.join(swimming.TASKS)}")
        n_links, random_direction = swimming.TASKS[task]
        self._env = swimming.Environment(
            swimming.task_parameters(n_links, params),
            n_sub_steps=frame_skip,
            random_direction=random_direction,
            initial_states=initial_states,
            random=np.random.RandomState(legacy_seed(self.np_random_seed)),
        )
        n = self.physics.parameters.n_links
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 * n + 2,), np.float64)
        self.action_space = spaces.Box(-1, 1, (n - 1,), np.float32)
        self.frame_skip = frame_skip
        self._in_episode = False
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self._env.control_timestep())}
        self._frame = {"width": width, "height": height, "camera": camera_name}

    @property
    def physics(self) -> Simulation:
        """The simulation, with the swimmer's state and parameters."""
        return self._env.physics

    @property
    def task(self) -> Rules:
        """The task, which starts episodes and gives rewards."""
        return self._env.task

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed : int, optional
            Not negative. Without one, random numbers go on where they stand.
        options : dict, optional
            Ignored.

        Returns
        -------
        observation : ndarray, shape (2n + 2,)
        info : dict
            Empty.
        """
        super().reset(seed=seed)
        if seed is not None:
            self.task.random.seed(legacy_seed(seed))
        self._in_episode = True
        return np.concatenate(list(self._env.reset().values())), {}

    def step(self, action: Action) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold the torques ``action``, shape (n - 1,), for one step.

        Returns
        -------
        observation : ndarray, shape (2n + 2,)
        reward : float
            m/s.
        terminated, truncated : bool
            Always False.
        info : dict
            Empty.

        Raises
        ------
        gymnasium.error.ResetNeeded
            There was no :meth:`reset` yet.
        swimmer_mj.environments.simulation.PhysicsError
            The swimmer moves as MuJoCo cannot compute it.
        """
        if not self._in_episode:
            raise ResetNeeded("call reset() before the first step()")
        if np.shape(action) != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {np.shape(action)}")
        observation, reward = self._env.step(action)
        return np.concatenate(list(observation.values())), reward, False, False, {}

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The present frame, shape (height, width, 3), or None without a ``render_mode``."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() gives no frame without render_mode='rgb_array' at construction")
            return None
        return self.physics.render(**self._frame)

    def close(self) -> None:
        """Free the rendering contexts and release the viscous friction; the environment cannot be used any more."""
        self.physics.free()
