import numpy as np
import pytest
import torch

from swimmer_mj import SwimmerParameters
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states, record_episode
from swimmer_mj.render.value_map import GRID, coordinate_names, target_frame_states, value_map

LINKS = 3
NAMES = ("theta1", "theta2", "theta3", "omega1", "omega2", "omega3", "vx", "vy")


@pytest.fixture(scope="module")
def policy():
    """Of a network that has learned nothing, whose V varies."""
    problem = Swimming(SwimmerParameters(n_links=LINKS))
    network = Cascade(problem.n_inputs, 8)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weights in network.parameters():
            weights.copy_(0.5 * torch.randn(weights.shape, generator=generator, dtype=weights.dtype))
    return GreedyPolicy(problem, network)


@pytest.fixture(scope="module")
def episode(policy):
    """In dm_control, towards 1 rad and then the other way."""
    start = evaluation_states(LINKS)[0]
    direction = lambda time: 1.0 if time < 0.2 else 1.0 - np.pi  # noqa: E731
    return record_episode(policy, policy.problem.parameters, start, 0.3, direction)


def test_states_are_those_that_the_policy_judged(policy, episode):
    """V along the episode, as it was recorded."""
    np.testing.assert_allclose(policy.judge(target_frame_states(episode)).value, episode.values, atol=1e-5)


def test_coordinates_have_names():
    assert coordinate_names(LINKS) == NAMES


@pytest.mark.parametrize(("over", "time"), [(("theta2", "omega3"), None), (("vx", "theta1"), 0.1)])
def test_v_is_that_of_the_state_with_two_coordinates_changed(policy, episode, check_whole, over, time):
    figure = value_map(policy, episode, over, time)
    axes = figure.axes[0]
    filled = axes.collections[0]
    state = target_frame_states(episode)[-1 if time is None else 10]
    i, j = (NAMES.index(name) for name in over)
    scale = [180 / np.pi if name.startswith("theta") else 1.0 for name in over]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    z = np.tile(state, (GRID, GRID, 1))
    z[..., i] = np.linspace(left, right, GRID) / scale[0]
    z[..., j] = np.linspace(bottom, top, GRID)[:, None] / scale[1]
    V = policy.judge(z).value
    assert (filled.zmin, filled.zmax) == pytest.approx((V.min(), V.max()), abs=1e-5)
    dot = axes.lines[-1].get_xydata()[0]
    assert np.cos(np.radians(dot)) == pytest.approx(np.cos(np.radians(state[[i, j]] * scale)), abs=1e-9)
    assert left < dot[0] < right
    assert bottom < dot[1] < top
    for k, name in enumerate(over):
        if name.startswith("theta"):
            low, high = (axes.get_xlim(), axes.get_ylim())[k]
            assert high - low == pytest.approx(360)
            assert abs(dot[k] - (low + high) / 2) <= 45.1, "the state near the middle"
    check_whole(figure)


@pytest.mark.parametrize(
    ("over", "complaint"),
    [
        (("theta1", "theta9"), "there is no coordinate 'theta9' of 3 links; there are theta1, theta2"),
        (("vx", "vx"), "V is drawn over two different coordinates, got vx and vx"),
    ],
)
def test_refusals(policy, episode, over, complaint):
    with pytest.raises(ValueError, match=complaint):
        value_map(policy, episode, over)
