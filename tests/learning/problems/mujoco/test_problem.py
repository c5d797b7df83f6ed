"""A MuJoCo model as a control problem: its state, its inputs, what controls cost, and what is refused."""

import copy
import multiprocessing
import re
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import mujoco
import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.networks import Cascade, Multilayer, ValueNetwork
from swimmer_mj.learning.networks.policy import GreedyPolicy, greedy_control
from swimmer_mj.learning.problems.caution import CautionWarning
from swimmer_mj.learning.problems.forms import BatchForm, CostForm, EpisodeForm
from swimmer_mj.learning.problems.mujoco import MujocoProblem, Starts
from swimmer_mj.learning.td.continuous_td import ContinuousTD
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

CAREFUL = pytest.mark.filterwarnings("ignore::swimmer_mj.learning.problems.caution.CautionWarning")
"""A joint of the model is limited."""

ARM = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <body name="boat">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <geom size="0.2" mass="2"/>
      <body name="arm" pos="0.2 0 0">
        <joint name="elbow" axis="0 0 1" limited="true" range="-100 100" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05" mass="1"/><site name="hand" pos="0.5 0 0"/>
      </body>
      <body name="wheel" pos="-0.2 0 0">
        <joint name="wheel" axis="0 0 1" damping="0.2"/><geom type="box" size="0.2 0.1 0.1" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="east" joint="x" gear="3" ctrlrange="-1 1"/><motor name="bend" joint="elbow" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def reach(scene):
    """The hand ahead of the boat in x."""
    return -(scene.site("hand")[:, 0] - scene.joint("x") - 0.4).square()


def test_the_state_leaves_out_what_does_not_matter_and_encodes_what_turns():
    problem = MujocoProblem(ARM, reach)
    # The reward sees where the hand is relative to the boat; the wheel is a box, whose angle changes no acceleration.
    assert problem.layout.names == ("elbow", "x'", "y'", "elbow'", "wheel'")
    whole = MujocoProblem(ARM, reach, without=())
    assert whole.layout.names[:4] == ("x", "y", "elbow", "wheel")
    assert [whole.layout.names[i] for i in whole.encoding.angle] == ["wheel"]  # the elbow is limited
    assert whole.n_inputs == 9
    absolute = MujocoProblem(ARM, lambda scene: -scene.site("hand")[:, 0].square())
    assert absolute.layout.names[0] == "x"


def test_inputs_are_those_of_the_compiled_encoding_and_of_order_one():
    problem = MujocoProblem(ARM, reach, without=())
    x = problem.initial_states(np.random.default_rng(0), 32)
    z = problem.inputs(torch.from_numpy(x)).numpy()
    e = problem.encoding
    assert np.allclose(z[:, e.cosine], np.cos(x[:, e.angle]))
    assert np.allclose(z[:, e.sine], np.sin(x[:, e.angle]))
    assert np.allclose(z[:, e.scaled], x[:, e.linear] * e.scale)
    assert (0.2 < np.sqrt((z**2).mean(axis=0))).all()
    assert (np.sqrt((z**2).mean(axis=0)) < 3).all()


def test_a_control_that_costs_is_greedy_and_not_bang_bang():
    """The compiled choice of the instant against the formula, and the formula against a search."""
    problem = MujocoProblem(ARM, reach, control_cost=[0.3, 0.0], held=False)
    rng, N = np.random.default_rng(1), 32
    x, slope = problem.initial_states(rng, N), rng.normal(size=(N, problem.state_size))
    u, y = np.empty((2, N)), np.empty((problem.state_size, N))
    form = problem.form(BatchForm)
    form.greedy_step(None, x.T.copy(), slope.T.copy(), np.ones((2, N)), 0.0, u, y)
    _, B = problem.drift_and_control_matrix(x)
    cost = problem.form(CostForm).coefficients(x)
    expected = greedy_control(B, slope, problem.control_limits, cost)
    assert np.allclose(u.T, expected, rtol=0, atol=1e-12)
    assert 0 < np.count_nonzero(np.abs(expected[:, 0]) < 1) < N
    assert (np.abs(expected[:, 1]) == 1).all()
    tried = np.linspace(-1, 1, 2001)
    for n in range(N):
        worth = np.outer(slope[n] @ B[n], tried) - cost[n][:, None] * tried**2
        assert np.allclose(
            worth.max(axis=1), (slope[n] @ B[n]) * expected[n] - cost[n] * expected[n] ** 2, atol=1e-5
        )


def test_what_controls_cost_is_in_rewards_and_in_H():
    free, paid = MujocoProblem(ARM, reach), MujocoProblem(ARM, reach, control_cost=[0.3, 0.1])
    rng = np.random.default_rng(2)
    x, u = paid.initial_states(rng, 32), rng.uniform(-1, 1, (32, 2))
    r = paid.form(BatchForm).reward(x.T.copy(), u.T.copy())
    assert np.allclose(r, free.reward(x) - u**2 @ [0.3, 0.1])
    network = Multilayer(paid.n_inputs, (8,), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    judged = GreedyPolicy(paid, network).judge(x)
    a, B = paid.drift_and_control_matrix(x)
    state = torch.from_numpy(x).requires_grad_()
    V = network(paid.inputs(state))
    (slope,) = torch.autograd.grad(V.sum(), state)
    f = a + (B @ judged.control[..., None])[..., 0]
    H = free.reward(x) - judged.control**2 @ [0.3, 0.1] - V.detach().numpy() + (slope.numpy() * f).sum(axis=1)
    assert np.allclose(judged.hamiltonian, H)


def test_episodes_take_the_models_own_steps_and_count_what_controls_cost():
    problem = MujocoProblem(ARM, reach, control_cost=[0.3, 0.1], control_timestep=0.02)
    network = Multilayer(
        problem.n_inputs, (8,), generator=torch.Generator().manual_seed(3), dtype=torch.float64
    )
    policy = GreedyPolicy(problem, network)
    x = problem.initial_states(np.random.default_rng(4), 3)
    found = policy.episodes(x, np.full(25, 0.04), 0.02)
    for start, total in zip(x, found, strict=True):
        data, expected = mujoco.MjData(problem.model), 0.0
        problem.place(data, start)
        for _ in range(25):
            now = np.concatenate([data.qpos[[2]], data.qvel])
            u = policy(now)
            expected += 0.04 * (float(problem.reward(now[None])[0]) - u**2 @ [0.3, 0.1])
            data.ctrl[:] = problem.ctrl(u)
            mujoco.mj_step(problem.model, data, 2)
        assert total == pytest.approx(expected, rel=1e-6)


@CAREFUL
@pytest.mark.parametrize("seed", range(3))
def test_both_methods_learn_it(seed):
    """Value gradients bring the hand where it is asked for; TD(lambda) takes its steps through the same interface."""
    problem = MujocoProblem(ARM, lambda scene: 10 * reach(scene), control_cost=[0.01, 0.01], threads=1)
    generator = torch.Generator().manual_seed(seed)
    learner = ValueGradientLearner(
        problem,
        Multilayer(problem.n_inputs, (16, 16), generator=generator),
        ValueGradientSettings(trajectories=64, steps=20, dt=0.02, minibatch=64, trial_duration=2.0),
        seed=seed,
    )
    assert learner.engine == "compiled"
    starts = problem.initial_states(np.random.default_rng(9), 32)
    before = learner.rollout(starts, 5.0, 2.0, dt=0.02).mean()
    for _ in range(60):
        learner.step()
    after = learner.rollout(starts, 5.0, 2.0, dt=0.02).mean()
    assert after > 0.3 * before  # both are negative; 0 is best
    td = ContinuousTD(problem, Cascade(problem.n_inputs, 4, generator=generator))
    td.start_trial()
    x = starts[0]
    for _ in range(5):
        moment = td.learn_at(x)
        x = problem.step(x[None], moment.control[None], 0.01)[0]
    assert np.isfinite(x).all()


@CAREFUL
def test_learning_is_the_same_bits_again():
    def learned():
        problem = MujocoProblem(ARM, reach, threads=2)
        network = Multilayer(problem.n_inputs, (8,), generator=torch.Generator().manual_seed(0))
        settings = ValueGradientSettings(trajectories=32, steps=5, dt=0.02, minibatch=32, trial_duration=1.0)
        learner = ValueGradientLearner(problem, network, settings)
        for _ in range(3):
            learner.step()
        return torch.cat([w.detach().flatten() for w in network.parameters()])

    assert bool((learned() == learned()).all())


SMALL = ValueGradientSettings(trajectories=32, steps=5, dt=0.02, minibatch=32, trial_duration=1.0)
LIMITED = ARM.replace('<flag contact="disable"/>', "").replace('range="-100 100"', 'range="-1 1"')
FREE = ARM.replace('limited="true" range="-100 100"', 'limited="false"')


def layers(problem):
    return Multilayer(problem.n_inputs, (8,), generator=torch.Generator().manual_seed(0))


LEARNERS = [
    lambda problem: ValueGradientLearner(problem, layers(problem), SMALL),
    lambda problem: ContinuousTD(problem, layers(problem)),
]


def test_says_at_how_many_states_constraints_are_active():
    problem = MujocoProblem(LIMITED, reach)
    said = re.search(r"constraints .* are active at (\d+) % of the states seen", problem.caution())
    x, data = problem._seen(), mujoco.MjData(problem.model)
    beyond = np.abs(x[:, problem.layout.names.index("elbow")]) > np.radians(1.0)
    assert 0.1 < beyond.mean() < 0.9
    for state, outside in zip(x, beyond, strict=True):
        problem.place(data, state)
        mujoco.mj_forward(problem.model, data)
        assert (data.nefc > 0) == outside  # the joint's limit alone
    assert float(said[1]) == pytest.approx(100 * beyond.mean(), abs=0.5)
    assert MujocoProblem(FREE, reach).caution() is None


@pytest.mark.parametrize("make", LEARNERS)
def test_a_learner_warns_once_where_it_is_made(make):
    problem = MujocoProblem(LIMITED, reach)
    with pytest.warns(CautionWarning) as caught:
        make(problem)
    (warning,) = caught
    assert str(warning.message) == problem.caution()
    assert warning.filename == __file__
    make(MujocoProblem(FREE, reach))  # of which a warning would be an error


def test_a_warning_changes_no_bit_of_what_is_learned():
    def learned(caution):
        problem = MujocoProblem(LIMITED, reach, threads=1)
        problem.caution = caution or problem.caution
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CautionWarning)
            learner = LEARNERS[0](problem)
        learner.step()
        return torch.cat([w.detach().flatten() for w in learner.network.parameters()])

    assert bool((learned(None) == learned(lambda: None)).all())


def test_an_equality_constraint_is_in_steps_and_not_in_the_control_matrix():
    """The wheel turns as the elbow does; the control matrix is that of the arm without the constraint."""
    coupled = FREE.replace(
        "<actuator>", '<equality><joint joint1="wheel" joint2="elbow"/></equality><actuator>'
    )
    problem, free = (MujocoProblem(xml, reach, without=(), threads=1) for xml in (coupled, FREE))
    assert "are active at 100 % of the states seen" in problem.caution()
    with pytest.warns(CautionWarning, match="the control matrix is that without them"):
        LEARNERS[0](problem)
    x, names = problem.initial_states(np.random.default_rng(0), 8), problem.layout.names
    for wheel, elbow in (("wheel", "elbow"), ("wheel'", "elbow'")):
        x[:, names.index(wheel)] = x[:, names.index(elbow)]
    a, B = problem.drift_and_control_matrix(x)
    assert np.array_equal(B, free.drift_and_control_matrix(x)[1])

    def accelerations(u):
        found, data = [], mujoco.MjData(problem.model)
        for state in x:
            problem.place(data, state)
            data.ctrl[:] = problem.ctrl(u)
            mujoco.mj_forward(problem.model, data)
            found.append(data.qacc.copy())
        return np.array(found)

    bend = np.array([0.0, 1.0])
    still, bent = accelerations(np.zeros(2)), accelerations(bend)
    assert np.allclose(a[:, -4:], still, rtol=0, atol=1e-9 * np.abs(still).max())
    assert names[-1] == "wheel'"
    assert (B[:, -1, 1] == 0).all()
    assert (bent - still > 0.1)[:, -1].all()  # which the control matrix leaves out
    coast, gain = problem.batch().responses(np.ascontiguousarray(x.T), 0.01)
    assert np.allclose(coast + gain[1], problem.step(x, bend, 0.01).T, rtol=0, atol=1e-9)
    assert (gain[1, -1] > 1e-3).all()  # by which held controls are chosen


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            ('<motor name="east"', '<muscle name="east" lengthrange="-1 1"'),
            "'east' has a gain of type mjGAIN_MUSCLE",
        ),
        (('joint="x" gear="3"', 'joint="x" forcerange="-1 1"'), "'east' has a forcerange"),
        (
            ('<motor name="bend"', '<intvelocity name="bend" kp="1" actrange="-0.1 0.1"'),
            "'bend' has an actrange: its force is not affine in ctrl; leave that out, or take a motor",
        ),
        (
            ('name="bend" joint="elbow" ctrlrange="-1 1"', 'name="bend" joint="elbow"'),
            "'bend' has no ctrlrange",
        ),
        (
            ('name="elbow" axis', 'name="elbow" actuatorfrcrange="-1 1" axis'),
            "'elbow' has an actuatorfrcrange",
        ),
        (("<mujoco>", "<mujoko>"), "MuJoCo cannot compile the model"),
    ],
)
def test_refuses_a_model_it_cannot_learn_and_names_what_is_wrong(change, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        MujocoProblem(ARM.replace(*change), reach)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("reward", "options", "complaint"),
    [
        (lambda s: s.site("foot")[:, 0], {}, "the model has no site 'foot'; it has hand"),
        (lambda s: s.joint("knee"), {}, "the model has no joint 'knee'"),
        (lambda s: s.qvel, {}, r"reward_rate must have shape \(3,\)"),
        (lambda s: torch.log(-1 - s.qvel[:, 0] ** 2), {}, "reward_rate is not finite"),
        (reach, {"control_cost": [-1.0, 0.0]}, "control_cost must not be negative"),
        (reach, {"control_cost": [1.0]}, "control_cost must be one for each of 2 controls"),
        (reach, {"without": ["knee"]}, "without names joint 'knee'; the model has x, y, elbow, wheel"),
        (reach, {"s_gamma": 0.0}, "s_gamma must be positive"),
        (reach, {"control_limits": [1.0]}, "control_limits must be one for each of 2 controls, got 1"),
    ],
)
def test_refuses_bad_arguments_in_one_line(reward, options, complaint):
    with pytest.raises(ValueError, match=complaint):
        MujocoProblem(ARM, reward, **options)


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"there is no model nowhere\.xml"):
        MujocoProblem("nowhere.xml", reach)


def test_responses_are_those_of_steps():
    """Where the arm comes to in a learner's step is affine in the controls."""
    problem = MujocoProblem(ARM, reach, without=(), control_timestep=0.02)
    rng, batch = np.random.default_rng(3), problem.batch()
    x = np.ascontiguousarray(problem.initial_states(rng, 32).T)
    u = rng.uniform(-1, 1, (2, 32))
    coast, gain = batch.responses(x, 0.01)
    np.testing.assert_allclose(
        coast + (gain * u[:, None]).sum(axis=0), batch.step(x, u, 0.01), rtol=0, atol=1e-9
    )
    assert np.abs(gain[:, -2:]).max() > 0.1


CART = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/></body></worldbody>
<actuator><motor joint="x" ctrlrange="-1 1" gear="2000"/></actuator></mujoco>"""


class Bowl(ValueNetwork):
    """V = -v^2, of the inputs of the cart."""

    def __init__(self, n_inputs):
        super().__init__()
        self.n_inputs, self.weight = n_inputs, torch.nn.Parameter(torch.ones(1, dtype=torch.float64))

    def forward(self, z):
        return -self.weight * z[..., -1] ** 2


def slow(scene):
    return -(scene.qvel[:, 0] ** 2)


def test_a_policy_acts_as_its_learner_did():
    """V is that of the learner's steps: where those differ from the model's, controls are still chosen by them."""
    problem = MujocoProblem(CART, slow, control_timestep=0.05)  # the model's own steps are of 0.002 s
    x = problem.initial_states(np.random.default_rng(5), 32)
    flat, policy = np.ascontiguousarray(x.T), GreedyPolicy(problem, Bowl(problem.n_inputs))
    u, y = np.empty((1, 32)), np.empty_like(flat)
    problem.batch().greedy_step(policy._slope_at, flat, policy._slope_at(flat), np.ones_like(u), 0.05, u, y)
    np.testing.assert_allclose(policy(x), u.T, rtol=1e-12)
    assert 0 < np.count_nonzero(np.abs(u) < 1)


def test_a_held_control_oversteps_nothing():
    """A cart to be stopped at the origin by a strong motor: bang-bang for the instant it would shake."""
    ends = {}
    for held in (True, False):
        problem = MujocoProblem(CART, slow, held=held, control_timestep=0.02)
        x = problem.initial_states(np.random.default_rng(4), 32)
        policy = GreedyPolicy(problem, Bowl(problem.n_inputs))
        for _ in range(50):
            u = policy(x)
            for _ in range(10):
                x = problem.step(x, u, 0.002)
        ends[held] = np.abs(x[:, -1]).max()
    assert ends[True] < 1e-3 < 0.1 < ends[False]


@CAREFUL
def test_how_coordinates_enter_the_network_can_be_said():
    """A limited joint by cos and sin, a free one by its angle, a velocity by a factor, one not at all."""
    inputs = {"elbow": "angle", "wheel": 0.5, "x'": 3.0, "y": 0.0}
    problem = MujocoProblem(ARM, reach, without=(), inputs=inputs)
    names, e = problem.layout.names, problem.encoding
    assert [names[i] for i in e.angle] == ["elbow"]
    factor = dict(zip((names[i] for i in e.linear), e.scale, strict=True))
    assert factor["wheel"] == 0.5
    assert factor["x'"] == 3.0
    assert "y" not in factor
    assert problem.n_inputs == len(names)  # one more for the angle, one less for what is left out
    x = problem.initial_states(np.random.default_rng(0), 4)
    z = problem.inputs(torch.from_numpy(x)).numpy()
    assert np.allclose(z[:, e.cosine[0]], np.cos(x[:, names.index("elbow")]))
    learner = ValueGradientLearner(
        problem,
        Multilayer(problem.n_inputs, (8,), generator=torch.Generator().manual_seed(0)),
        ValueGradientSettings(trajectories=32, steps=5, minibatch=32, trial_duration=1.0),
    )
    assert learner.engine == "compiled"
    assert np.isfinite(learner.step()).all()


@pytest.mark.parametrize(
    ("inputs", "complaint"),
    [
        ({"knee": 1.0}, "inputs names 'knee'; the state has x, y, elbow"),
        ({"elbow": "cosine"}, "inputs['elbow'] must be a finite factor or 'angle', got 'cosine'"),
        ({"elbow": np.inf}, "inputs['elbow'] must be a finite factor or 'angle', got inf"),
    ],
)
def test_what_cannot_enter_is_refused(inputs, complaint):
    with pytest.raises(ValueError, match=re.escape(complaint)):
        MujocoProblem(ARM, reach, without=(), inputs=inputs)


POINT = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="point">
      <joint name="x" type="slide" axis="1 0 0" damping="1"/><joint name="y" type="slide" axis="0 1 0" damping="1"/>
      <geom size="0.05"/><site name="point"/>
    </body>
  </worldbody>
  <actuator><motor joint="x" ctrlrange="-1 1"/><motor joint="y" ctrlrange="-1 1"/></actuator>
  <sensor><clock name="clock"/><e_kinetic name="energy"/></sensor>
</mujoco>
"""


def near_the_origin(width):
    return lambda scene: (1 - scene.site("point")[:, :2].square().sum(1) / width**2).clamp(min=0)


@pytest.mark.parametrize("width", [0.001, 0.02, 0.3])
def test_a_position_that_matters_only_near_a_goal_is_kept(width):
    assert MujocoProblem(POINT, near_the_origin(width)).layout.names == ("x", "y", "x'", "y'")
    along = MujocoProblem(POINT, lambda scene: (1 - scene.joint("x").square() / width**2).clamp(min=0))
    assert along.layout.names == ("x", "x'", "y'")


def test_an_angle_is_one_only_if_a_whole_turn_makes_no_difference():
    free = MujocoProblem(ARM, reach, without=())
    sprung = MujocoProblem(
        ARM.replace('name="wheel" axis', 'name="wheel" stiffness="1" axis'), reach, without=()
    )
    wound = MujocoProblem(ARM, lambda scene: reach(scene) - (scene.joint("wheel") - 4) ** 2, without=())
    assert [len(problem.encoding.angle) for problem in (free, sprung, wound)] == [1, 0, 0]


def test_a_state_that_is_no_longer_finite_earns_nothing():
    """MuJoCo alone would go on from qpos0, where all is well."""
    stiff = POINT.replace('axis="1 0 0" damping="1"', 'axis="1 0 0" stiffness="1e6"')
    problem = MujocoProblem(stiff, lambda scene: torch.exp(-(scene.joint("x") ** 2)))
    network = Multilayer(problem.n_inputs, (4,), generator=torch.Generator().manual_seed(0))
    found = GreedyPolicy(problem, network).episodes(
        problem.states(Starts(np.ones((1, 2)), np.zeros((1, 2)))), np.ones(300), 0.01
    )
    assert not np.isfinite(found).any()


def test_a_disabled_actuator_is_no_control():
    two = POINT.replace('timestep="0.01"', 'timestep="0.01" actuatorgroupdisable="2"')
    problem = MujocoProblem(
        two.replace('<motor joint="y"', '<motor joint="y" group="2"'), near_the_origin(1.0)
    )
    assert len(problem.control_limits) == 1
    assert problem.ctrl(np.ones(1)).tolist() == [1.0, 0.0]


def test_a_ball_joint_begins_in_its_range():
    ball = """<mujoco><worldbody><body>
    <joint name="b" type="ball" range="0 30" limited="true"/><geom size="0.1" pos="0 0 0.3"/></body></worldbody>
    <actuator><motor joint="b" gear="1 0 0" ctrlrange="-1 1"/></actuator></mujoco>"""
    problem = MujocoProblem(ball, lambda scene: scene.qvel[:, 0])
    x = problem.initial_states(np.random.default_rng(0), 200)
    turned = np.degrees(2 * np.arccos(x[:, 0]))
    assert 25 < turned.max() < 30 < 100
    assert turned.min() < 5


def test_films_show_the_policy_the_goal():
    def draw(rng, count):
        return Starts(rng.uniform(-1, 1, (count, 2)), np.zeros((count, 2)), rng.uniform(2, 3, (count, 1)))

    problem = MujocoProblem(POINT, lambda scene: -((scene.joint("x") - scene.goal[:, 0]) ** 2), draw=draw)
    goal, seen = problem.initial_states(np.random.default_rng(0), 1)[0, -1], []
    for _ in problem.play(lambda x: seen.append(x[-1]) or np.zeros(2), 0.03):
        pass
    assert seen == [goal] * 3
    assert goal > 2


def test_several_threads_may_ask_at_once():
    """As the runs of several seeds do, which share a problem."""
    problem = MujocoProblem(ARM, reach, without=(), threads=1)
    batches = [problem.initial_states(np.random.default_rng(k), 200) for k in range(4)]
    expected = [problem.step(x, np.ones(2), 0.01) for x in batches]

    def differs(k):
        return any((problem.step(batches[k], np.ones(2), 0.01) != expected[k]).any() for _ in range(100))

    with ThreadPoolExecutor(4) as pool:
        assert not any(pool.map(differs, range(4)))


def test_copies_and_children_of_a_problem_that_has_been_used_can_be_used():
    problem = MujocoProblem(POINT, near_the_origin(1.0), threads=2)
    x = problem.initial_states(np.random.default_rng(0), 8)
    expected = problem.step(x, np.zeros(2), 0.01)
    np.testing.assert_array_equal(copy.deepcopy(problem).step(x, np.zeros(2), 0.01), expected)
    child = multiprocessing.get_context("fork").Process(target=problem.step, args=(x, np.zeros(2), 0.01))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of Python's, at a fork beside threads
        child.start()
    child.join(60)
    child.kill()
    assert child.exitcode == 0


def test_batches_of_no_states_are_none():
    problem = MujocoProblem(POINT, near_the_origin(1.0))
    x = np.zeros((0, 4))
    assert problem.step(x, np.zeros(2), 0.01).shape == (0, 4)
    assert problem.reward(x).shape == (0,)
    assert problem.drift_and_control_matrix(x)[1].shape == (0, 4, 2)


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda p: p.reward(np.zeros((4, 3))), "states must have a last axis of 4, got shape (4, 3)"),
        (lambda p: p.drift_and_control_matrix(np.zeros((3, 8))), "states must have a last axis of 4"),
        (lambda p: p.step(np.zeros((3, 4)), np.zeros(2), 0.0), "dt must be positive and finite, got 0.0"),
    ],
)
def test_refuses_states_and_steps_that_are_none(call, complaint):
    with pytest.raises(ValueError, match=re.escape(complaint)):
        call(MujocoProblem(POINT, near_the_origin(1.0)))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            ("<worldbody>", '<option><flag actuation="disable"/></option><worldbody>'),
            "there is nothing to control",
        ),
        (
            ('ctrlrange="-1 1"/><motor', 'ctrlrange="-1 1" delay="0.02" nsample="3"/><motor'),
            "acts late (delay)",
        ),
    ],
)
def test_refuses_actuators_that_do_something_else_than_their_control(change, complaint):
    with pytest.raises(ValueError, match=re.escape(complaint)):
        MujocoProblem(POINT.replace(*change), near_the_origin(1.0))


def test_a_tendon_whose_force_is_limited_is_refused():
    drawn = POINT.replace(
        "<actuator>",
        '<tendon><fixed name="rope" actuatorfrcrange="-0.1 0.1"><joint joint="x" coef="1"/></fixed></tendon><actuator>'
        '<motor tendon="rope" ctrlrange="-1 1"/>',
    )
    with pytest.raises(ValueError, match="tendon 'rope' has an actuatorfrcrange"):
        MujocoProblem(drawn, near_the_origin(1.0))


@pytest.mark.parametrize(
    ("reward", "complaint"),
    [
        (
            lambda s: s.sensor("clock")[:, 0],
            "'clock' is of type mjSENS_CLOCK, whose reading is not that of the state",
        ),
        (lambda s: s.sensor("energy")[:, 0], "'energy' is of type mjSENS_E_KINETIC"),
        (lambda s: s.nothing, "AttributeError: 'Scene' object has no attribute 'nothing'"),
        (lambda s: 1.0, "reward_rate must return a tensor"),
        (lambda s: s.qpos[:, 0].numpy(), "reward_rate must return a tensor"),
        (None, "reward_rate must be a function of a Scene, got None"),
    ],
)
def test_refuses_rewards_that_cannot_be_followed(reward, complaint):
    with pytest.raises(ValueError, match=re.escape(complaint)) as caught:
        MujocoProblem(POINT, reward)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"control_timestep": 0.015}, "a whole number of the model's steps of 0.01 s, got 0.015"),
        ({"control_timestep": -0.01}, "a whole number of the model's steps of 0.01 s, got -0.01"),
        ({"control_limits": 2.0}, "control_limits must be one for each of 2 controls, got 2.0"),
        ({"draw": lambda rng, n: np.zeros((n, 2))}, "draw must return Starts(qpos, qvel), got ndarray"),
        (
            {"draw": lambda rng, n: Starts(np.zeros((n, 2)), np.zeros((n, 3)))},
            "qvel of 2 initial states must have shape (2, 2)",
        ),
        (
            {"draw": lambda rng, n: Starts(np.zeros((7, 2)), np.zeros((7, 2)))},
            "qpos of 2 initial states must have shape (2, 2)",
        ),
    ],
)
def test_refuses_what_does_not_fit_the_model(options, complaint):
    with pytest.raises(ValueError, match=re.escape(complaint)):
        MujocoProblem(POINT, near_the_origin(1.0), **options)


def test_a_model_is_taken_in_whatever_way_it_comes():
    made = [mujoco.MjModel.from_xml_string(POINT), mujoco.MjSpec.from_string(POINT)]
    for model in made:
        assert MujocoProblem(model, near_the_origin(1.0)).state_size == 4
    taken = "an MjModel, an MjSpec, XML, a path, an environment or a Physics of dm_control, or a MuJoCo environment of "
    for other, kind in ((3, "int"), (gymnasium.make("CartPole-v1"), "CartPoleEnv")):
        with pytest.raises(ValueError, match=f"the model must be {taken}Gymnasium, got {kind}"):
            MujocoProblem(other, near_the_origin(1.0))
    with pytest.raises(ValueError, match=r"unrecognized element Element 'worldbdy', line \d+"):
        MujocoProblem(POINT.replace("worldbody", "worldbdy"), near_the_origin(1.0))


def from_dm_control(given):
    suite = pytest.importorskip("dm_control.suite", reason="there is no dm_control here")
    environment = suite.load("swimmer", "swimmer6")
    physics = environment.physics
    ways = {"environment": environment, "physics": physics, "model": physics.model}
    return ways[given], physics.model.ptr, environment.control_timestep() if given == "environment" else None


def from_gymnasium(name, wrapped, **options):
    import swimmer_mj.gymnasium  # noqa: F401 - the names of its environments

    environment = gymnasium.make(name, **options)
    inner = environment.unwrapped
    model = inner.model if hasattr(inner, "model") else inner.physics.model
    return environment if wrapped else inner, model, model.opt.timestep * inner.frame_skip


@pytest.mark.parametrize(
    ("make", "arguments"),
    [
        (from_dm_control, {"given": "environment"}),
        (from_dm_control, {"given": "physics"}),
        (from_dm_control, {"given": "model"}),
        (from_gymnasium, {"name": "Swimmer-v5", "wrapped": True}),
        (from_gymnasium, {"name": "Swimmer-v5", "wrapped": False}),
        (from_gymnasium, {"name": "swimmer_mj/Swim3-v0", "wrapped": True, "frame_skip": 5}),
    ],
)
def test_an_environment_is_its_model_and_its_control_step(make, arguments):
    given, model, held_for = make(**arguments)
    assert isinstance(model, mujoco.MjModel)
    found = MujocoProblem(given, slow, threads=1)
    right = MujocoProblem(model, slow, threads=1, control_timestep=held_for)
    assert found.control_timestep == right.control_timestep == pytest.approx(held_for or model.opt.timestep)
    assert held_for is None or held_for > 1.5 * model.opt.timestep
    assert found.form(EpisodeForm) == right.form(EpisodeForm)
    assert found.layout.names == right.layout.names
    assert found.control_limits.tolist() == right.control_limits.tolist()
    x = right.initial_states(np.random.default_rng(0), 8)
    assert np.array_equal(found.initial_states(np.random.default_rng(0), 8), x)
    for one, other in zip(found.drift_and_control_matrix(x), right.drift_and_control_matrix(x), strict=True):
        assert np.array_equal(one, other)
    u = right.control_limits / 2
    assert np.array_equal(found.step(x, u, 0.01), right.step(x, u, 0.01))
    assert np.array_equal(found.inputs(torch.from_numpy(x)), right.inputs(torch.from_numpy(x)))
    longer = MujocoProblem(given, slow, threads=1, control_timestep=20 * model.opt.timestep)
    assert longer.control_timestep == 20 * model.opt.timestep


def test_other_peoples_environments_are_not_imported():
    code = "import sys, swimmer_mj.learning.problems.mujoco; print({'dm_control', 'gymnasium'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("reward", [lambda s: (s.qpos[:, 0] > 0).double(), lambda s: s.qpos[:, 0].detach()])
def test_value_gradients_do_not_follow_a_reward_without_a_slope(reward):
    problem = MujocoProblem(POINT, reward, without=())
    network = Multilayer(problem.n_inputs, (4,), generator=torch.Generator().manual_seed(0))
    settings = ValueGradientSettings(trajectories=32, steps=5, minibatch=32, trial_duration=1.0)
    with pytest.raises(ValueError, match="the reward has no slope"):
        ValueGradientLearner(problem, network, settings).step()
