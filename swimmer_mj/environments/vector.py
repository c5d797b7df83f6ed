"""Many swimmers as one Gymnasium vector environment, stepped together on all cores.

    envs = gymnasium.make_vec("swimmer_mj.gymnasium:swimmer_mj/Swim5-v0", num_envs=64)

``mujoco.batch`` steps the simulations from threads of its own, with the compiled friction; observations and
rewards are one set of NumPy operations for all of them. The numbers are those of
:class:`~swimmer_mj.environments.gymnasium.SwimmerEnv` to the last bit, whatever the number of threads.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from mujoco.batch import Batch
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.environments.gymnasium import Action, Array, SwimmerEnv, legacy_seed, whole_number
from swimmer_mj.environments.simulation import PhysicsError
from swimmer_mj.environments.swimming import wrap_angle
from swimmer_mj.libraries import load_triton_apart

__all__ = ["SwimmerVectorEnv"]

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # what a row of Batch.state holds

# The swimmer touches nothing and its joints have no limits: not to look for constraints changes no number
# and makes a step a sixth faster.
_NO_CONSTRAINTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


class SwimmerVectorEnv(VectorEnv[Array, Action, NDArray[Any]]):
    """``num_envs`` environments :class:`~swimmer_mj.environments.gymnasium.SwimmerEnv` in one.

    Observations have the shape (num_envs, 2n + 2), actions (num_envs, n - 1), rewards, terminations and
    truncations (num_envs,), all in what :class:`~gymnasium.vector.SyncVectorEnv` of the single environments
    gives, number for number.

    Parameters
    ----------
    task : str
        A task of :data:`swimmer_mj.environments.swimming.TASKS`, such as ``"swim5"``.
    num_envs : int
        How many environments.
    max_episode_steps : int, optional
        Truncate an episode after so many steps; -1 or None for never.
    autoreset_mode : AutoresetMode or str
        When an environment whose episode is over is reset: in the next step, which then ignores its action
        (Gymnasium's default), in the same step, or only by ``reset(options={"reset_mask": mask})``.
    nthread : int
        Number of threads; 0 for as many as there are CPUs.
    **kwargs
        For each single environment: ``params``, ``initial_states``, ``frame_skip``, ``render_mode``, ``width``,
        ``height``, ``camera_name``. ``initial_states`` is one callable for all of them.
    """

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        nthread: int = 0,
        **kwargs: Any,
    ) -> None:
        load_triton_apart()
        num_envs = whole_number("num_envs", num_envs)
        nthread = whole_number("nthread", nthread, least=0)
        if max_episode_steps is None or max_episode_steps == -1:
            self._max_episode_steps = math.inf
        else:
            name = "max_episode_steps, unless -1 for never,"
            self._max_episode_steps = whole_number(name, max_episode_steps)
        # The simulation in which episodes are started and frames drawn, one environment at a time.
        self._single = SwimmerEnv(task, **kwargs)
        self._physics = self._single.physics
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self._single.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = self._single.render_mode
        self.single_observation_space = self._single.observation_space
        self.single_action_space = self._single.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

        model = copy.copy(self._physics.model)
        model.opt.disableflags |= _NO_CONSTRAINTS
        self._batch = Batch(model, num_envs, nthread)
        # Live views.
        self._qpos, self._qvel, self._time = self._batch.qpos, self._batch.qvel, self._batch.time
        self._levers = st.center_of_mass_levers(self._physics.parameters)
        self._seeds: list[int | None] = [None] * num_envs
        self._random_states: list[Any] = [None] * num_envs  # of the task's source, None before the first seed
        self._steps = np.full(num_envs, -1)  # of the present episode; -1 before the first
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._direction = np.zeros(num_envs)  # of the target, rad
        self._toward = np.zeros((num_envs, 2))  # its unit vector
        self._center = np.zeros((num_envs, 2))  # of mass, m

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """What each environment was last seeded with; None before the first reset."""
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode in each environment.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Environment i is seeded with ``seed + i`` or with ``seed[i]``. Without one, its random
            numbers go on where they stand.
        options : dict, optional
            ``reset_mask``, a bool array of shape (num_envs,): which environments to reset; all by default.

        Returns
        -------
        observations : ndarray, shape (num_envs, 2n + 2)
        infos : dict
            Empty.
        """
        self._check_open()
        seeds = [None] * self.num_envs if seed is None else seed
        if isinstance(seeds, int | np.integer):
            seeds = [int(seeds) + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(
                f"seed must be one number or {self.num_envs}, one per environment; got {len(seeds)}"
            )
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"reset_mask must be a bool array of shape ({self.num_envs},) with a True in it, got {mask!r}"
            )
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None or self._seeds[i] is None:
                self._seed(i, seeds[i])
            self._start_episode(i)
        observations, self._center = self._observe()
        return observations, {}

    def step(
        self, actions: Action
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold the torques ``actions``, shape (num_envs, n - 1), for one step.

        Returns
        -------
        observations : ndarray, shape (num_envs, 2n + 2)
        rewards : ndarray, shape (num_envs,)
            m/s; 0 for an environment that this step reset.
        terminations, truncations : ndarray of bool, shape (num_envs,)
            Terminations are all False.
        infos : dict
            Empty, but ``final_obs`` and ``final_info`` with ``AutoresetMode.SAME_STEP``.
        """
        self._check_open()
        if np.shape(actions) != self.action_space.shape:
            raise ValueError(f"actions must have shape {self.action_space.shape}, got {np.shape(actions)}")
        if (self._steps < 0).any():
            raise ResetNeeded("call reset() before the first step()")
        if self.autoreset_mode == AutoresetMode.DISABLED and self._over.any():
            raise ResetNeeded(f"reset environments {np.flatnonzero(self._over)}: their episodes are over")

        self._physics.require_friction()
        resetting = self._over.copy()
        start_time = self._time.copy()
        self._batch.ctrl = actions
        if not resetting.all():
            stepping = np.flatnonzero(~resetting) if resetting.any() else None
            self._batch.step(stepping, nstep=self._single.frame_skip)
        if self._batch.warning.any():
            bad = np.flatnonzero(self._batch.warning.any(axis=(1, 2)))
            raise PhysicsError(f"the physics state of environments {bad} is invalid: MuJoCo raised warnings")
        elapsed = self._time - start_time
        elapsed[resetting] = 1.0  # s; any
        for i in np.flatnonzero(resetting).tolist():
            self._start_episode(i)

        observations, center = self._observe()
        velocity = (center - self._center) / elapsed[:, None]
        rewards = velocity[:, 0] * self._toward[:, 0] + velocity[:, 1] * self._toward[:, 1]
        rewards[resetting] = 0.0
        self._center = center
        self._steps += ~resetting
        truncations = self._steps >= self._max_episode_steps
        self._over = truncations.copy()

        infos: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and truncations.any():
            ended = np.flatnonzero(truncations).tolist()
            for i in ended:
                infos = self._add_info(infos, {"final_obs": observations[i].copy(), "final_info": {}}, i)
                self._start_episode(i)
            observations, self._center = self._observe()
        return observations, rewards, np.zeros(self.num_envs, dtype=np.bool_), truncations, infos

    def render(self) -> tuple[NDArray[np.uint8] | None, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The present frame of each environment; see :meth:`SwimmerEnv.render`."""
        self._check_open()
        physics = self._physics
        frames = []
        for row, center in zip(self._batch.state, self._center, strict=True):
            mujoco.mj_setState(physics.model, physics.data, row, _STATE)
            physics.move_target_mark(center)
            frames.append(self._single.render())
        return tuple(frames)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the simulations and their threads, and release the viscous friction; arguments are ignored."""
        for batch_or_view in ("_batch", "_qpos", "_qvel", "_time"):  # the last reference frees it
            vars(self).pop(batch_or_view, None)
        if (single := vars(self).get("_single")) is not None:  # not if an argument was refused
            single.close()

    def _check_open(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the vector environment is closed")

    def _seed(self, i: int, seed: int | None) -> None:
        """Seed environment ``i`` as the single environment does, with a drawn seed if it is None."""
        if seed is None:
            seed = int(np.random.SeedSequence().generate_state(1)[0])
        seed = whole_number("a seed", seed, least=0)
        random = self._single.task.random
        random.seed(legacy_seed(seed))
        self._seeds[i], self._random_states[i] = seed, random.get_state(legacy=False)

    def _start_episode(self, i: int) -> None:
        """Set environment ``i`` to the state the task starts from."""
        physics, task = self._physics, self._single.task
        task.random.set_state(self._random_states[i])
        physics.reset()
        task.initialize_episode(physics)
        physics.forward()
        self._random_states[i] = task.random.get_state(legacy=False)
        mujoco.mj_getState(physics.model, physics.data, self._batch.state[i], _STATE)
        self._batch.warning[i] = 0
        angle = physics.target_direction()
        self._direction[i] = angle
        self._toward[i] = math.cos(angle), math.sin(angle)
        self._steps[i] = 0
        self._over[i] = False

    def _observe(self) -> tuple[Array, Array]:
        """The observations and the centres of mass: what ``Simulation`` and ``Rules`` do, for all at once.

        The same operations in the same order, so that the numbers are the same to the last bit.
        """
        qpos, qvel, direction = self._qpos, self._qvel, self._direction
        angles, angular_velocities = qpos[:, 2:].cumsum(axis=1), qvel[:, 2:].cumsum(axis=1)
        center = qpos[:, :2] + self._levers @ st.link_directions(angles)
        rates = self._levers * angular_velocities
        velocity = qvel[:, :2] + (rates[:, None, :] @ st.link_normals(angles))[:, 0]
        observations = st.join_reduced(
            wrap_angle(angles - direction[:, None]), angular_velocities, st.rotate(velocity, -direction)
        )
        return observations, center
