"""What decides how fast value gradients swim: in which coordinates V is learned, and how the control is chosen.

    python benchmarks/swimmer_coordinates.py [--names "joints, held" ...] [--seeds 120 121 ...] [--seconds 20]

adds to benchmarks/results/swimmer-coordinates.csv, a row a look: value gradients on the compiled equations of the
5-link swimmer, with V of the built-in problem's state (absolute angles, centre of mass) or of MuJoCo's coordinates
(angles between links, the head's velocity), and with controls for the instant (bang-bang) or for the 10 ms for which
they are held. Judged on MuJoCo. One learner on one core; compilation and looks are not counted. A seed that is there
already is not learned again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor
from yardstick import CONTROL_TIMESTEP, Row, append, finished, looks, row, swimming_speed

from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.problems.forms import BatchForm, Encoding
from swimmer_mj.learning.problems.held import Slope, held_control
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.batched import step, workspace
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER

OUT = Path(__file__).parent / "results" / "swimmer-coordinates.csv"
S_GAMMA = 0.5
LOOKS = (5.0, 10.0, 20.0, 40.0)

Array = NDArray[np.float64]
N = PAPER.n_links
VELOCITY_SCALES = {False: 1.0, True: 1.7}
"""Of the velocity of the centre of mass, and of the head, in the network's inputs, s/m: the built-in problem's, and
what MujocoProblem finds."""
DIFFERENCES = np.eye(N) - np.eye(N, k=-1)
SUMS = np.linalg.inv(DIFFERENCES)
OUTBOARD = np.cumsum(PAPER.masses[::-1])[::-1]
HEAD_ARMS = PAPER.lengths * (OUTBOARD - PAPER.masses / 2) / PAPER.masses.sum()
"""From the head to the centre of mass, along each link, m."""


class Variant(NamedTuple):
    """What is compared."""

    joints: bool
    """V is learned in MuJoCo's coordinates."""
    held: bool
    """Controls are chosen for the time for which they are held."""
    scale: float
    """Of rates, in the network's inputs, s: of links, or of joints."""


VARIANTS = {
    "absolute, bang-bang": Variant(False, False, 0.2),
    "absolute, held": Variant(False, True, 0.2),
    "joints, bang-bang": Variant(True, False, 0.7),
    "joints, held, rates x 0.2": Variant(True, True, 0.2),
    "joints, held": Variant(True, True, 0.7),
}


def head_to_centre(x: Array) -> Array:
    """Velocity of the centre of mass against the head's, (..., 2, count), at absolute states (..., p, count)."""
    theta, omega = x[..., :N, :], x[..., N : 2 * N, :]
    swing = HEAD_ARMS[:, None] * omega
    return np.stack([-(swing * np.sin(theta)).sum(axis=-2), (swing * np.cos(theta)).sum(axis=-2)], axis=-2)


def to_absolute(y: Array) -> Array:
    """The built-in problem's state (..., p, count) of MuJoCo's coordinates (..., p, count)."""
    x = np.concatenate([SUMS @ y[..., :N, :], SUMS @ y[..., N : 2 * N, :], y[..., 2 * N :, :]], axis=-2)
    x[..., 2 * N :, :] += head_to_centre(x)
    return x


def to_joints(x: Array) -> Array:
    """The inverse of :func:`to_absolute`."""
    return np.concatenate(
        [
            DIFFERENCES @ x[..., :N, :],
            DIFFERENCES @ x[..., N : 2 * N, :],
            x[..., 2 * N :, :] - head_to_centre(x),
        ],
        axis=-2,
    )


def _through_head(x: Array, slope: Array, sign: float) -> Array:
    """``slope`` (..., p, count) with what angles and rates do to the centre's velocity added (1) or removed (-1)."""
    theta, omega, arm = x[..., :N, :], x[..., N : 2 * N, :], sign * HEAD_ARMS[:, None]
    gx, gy = slope[..., 2 * N : 2 * N + 1, :], slope[..., 2 * N + 1 :, :]
    out = slope.copy()
    out[..., :N, :] -= arm * omega * (np.cos(theta) * gx + np.sin(theta) * gy)
    out[..., N : 2 * N, :] += arm * (np.cos(theta) * gy - np.sin(theta) * gx)
    return out


def slope_in_absolute(x: Array, slope: Array) -> Array:
    """The slope in the built-in state of a function whose slope in MuJoCo's coordinates is given; x is absolute."""
    turned = (
        DIFFERENCES.T @ slope[..., :N, :],
        DIFFERENCES.T @ slope[..., N : 2 * N, :],
        slope[..., 2 * N :, :],
    )
    return _through_head(x, np.concatenate(turned, axis=-2), -1.0)


def slope_in_joints(x: Array, slope: Array) -> Array:
    """The inverse of :func:`slope_in_absolute`."""
    slope = _through_head(x, slope, 1.0)
    turned = (SUMS.T @ slope[..., :N, :], SUMS.T @ slope[..., N : 2 * N, :], slope[..., 2 * N :, :])
    return np.concatenate(turned, axis=-2)


class ComparedSwimming:
    """The swimmer's equations, with V in either coordinates and either control."""

    name = "swimming"
    s_gamma = S_GAMMA

    def __init__(self, variant: Variant) -> None:
        self.variant, self.swimming = variant, Swimming(s_gamma=S_GAMMA)
        self.control_limits, self.state_size = self.swimming.control_limits, self.swimming.state_size
        k, linear = np.arange(N), np.arange(N, 2 * N + 2)
        scale = np.array([variant.scale] * N + [VELOCITY_SCALES[variant.joints]] * 2)
        self.encoding = Encoding(k, k, N + k, linear, N + linear, scale)
        self.n_inputs = 3 * N + 2
        self._workspace, self._constants = workspace(N), reduced_constants(PAPER)

    def seen(self, x: Array) -> Array:
        """Absolute states (count, p) in the coordinates of V."""
        return to_joints(x.T).T.copy() if self.variant.joints else x

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """Those of the built-in problem."""
        return self.seen(self.swimming.initial_states(rng, count))

    def inputs(self, x: Tensor) -> Tensor:
        """The network's inputs."""
        e = self.encoding
        linear = x[..., e.linear] * torch.as_tensor(e.scale).to(x)
        return torch.cat([x[..., e.angle].cos(), x[..., e.angle].sin(), linear], dim=-1)

    def choose(self, slope_at: Slope, x: Array) -> Array:
        """The held control at absolute states, by Euler steps, which are affine in it."""

        def after(u: Array) -> Array:
            y = np.empty_like(x)
            step(self._workspace, self._constants, x, u, CONTROL_TIMESTEP, y)
            return y

        q = len(self.control_limits)
        coast = after(np.zeros((q, x.shape[1])))
        gain = np.stack([after(np.tile(unit[:, None], x.shape[1])) - coast for unit in np.eye(q)])
        return held_control(slope_at, coast, gain, self.control_limits, np.zeros((q, x.shape[1])))

    def form(self, kind: type[Any]) -> Any:
        """Batches of states."""
        if kind is not BatchForm:
            return None
        form, joints = self.swimming.form(BatchForm), self.variant.joints
        assert form is not None

        def greedy_step(
            slope_at: Slope, x: Array, dVdx: Array, flips: Array, dt: float, u: Array, y: Array
        ) -> None:
            at = np.ascontiguousarray(to_absolute(x)) if joints else x

            def slope(z: Array) -> Array:
                return (
                    slope_in_absolute(z, slope_at(np.ascontiguousarray(to_joints(z))))
                    if joints
                    else slope_at(z)
                )

            later = np.empty_like(at)
            if self.variant.held:
                u[:] = flips * self.choose(slope, at)
                step(self._workspace, self._constants, at, u, dt, later)
            else:
                here = np.ascontiguousarray(slope_in_absolute(at, dVdx)) if joints else dVdx
                form.greedy_step(slope, at, here, flips, dt, u, later)
            if dt > 0:
                y[:] = to_joints(later) if joints else later

        def targets(
            x: Array, u: Array, V: Array, dVdx: Array, dt: float, s_gamma: float, s_lambda: float, out: Any
        ) -> None:
            if not joints:
                form.targets(x, u, V, dVdx, dt, s_gamma, s_lambda, out)
                return
            at = np.ascontiguousarray(to_absolute(x))
            slopes = np.ascontiguousarray(slope_in_absolute(at, dVdx))
            form.targets(at, u, V, slopes, dt, s_gamma, s_lambda, out)
            p = self.state_size
            out[:, :p] = slope_in_joints(at[:-1], out[:, :p].astype(np.float64))

        def reward(x: Array, u: Array) -> Array:
            return form.reward(to_absolute(x) if joints else x, u)

        # Episodes are MuJoCo's: nothing here asks for steps of another integrator.
        return BatchForm(self.encoding, greedy_step, greedy_step, targets, reward)


def actions(problem: ComparedSwimming, learner: Any) -> Callable[[Array], Array]:
    """Of absolute states (count, p), in [-1, 1]."""
    return lambda x: learner.control(problem.seen(x)) / problem.control_limits


def learn(name: str, seed: int, seconds: float, console: Console) -> list[Row]:
    """A row for each look at one learner."""
    problem: Any = ComparedSwimming(VARIANTS[name])
    network = Multilayer(problem.n_inputs, (64, 64), generator=torch.Generator().manual_seed(seed))
    learner = ValueGradientLearner(
        problem, network, ValueGradientSettings(trajectories=256, minibatch=256), seed=seed
    )
    learner.step()  # compiles
    rows: list[Row] = []
    for clock in looks(learner.step, LOOKS, seconds):
        speed = swimming_speed(actions(problem, learner))
        rows.append(row(name, seed, clock, learner.simulation_steps, speed))
        console.print(*rows[-1])
    return rows


def main(
    names: tuple[str, ...] = tuple(VARIANTS),
    seeds: Sequence[int] = tuple(range(120, 130)),
    seconds: float = 20.0,
    out: Path = OUT,
) -> None:
    """Learn each variant with each seed.

    Args:
        names: Which.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    torch.set_num_threads(1)
    console = Console(highlight=False)
    for seed in seeds:
        for name in names:
            if (name, seed) not in finished(out):
                append(out, learn(name, seed, seconds, console))


if __name__ == "__main__":
    tyro.cli(main)
