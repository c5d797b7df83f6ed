import copy
import gc
import pickle

import mujoco
import numpy as np
import pytest

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters

dm_suite = pytest.importorskip("dm_control.suite", reason="there is no dm_control here")
from swimmer_mj.environments.suite import DOMAIN, SUITE, load, register, unregister, wrap_angle  # noqa: E402

TASKS = ["swim3", "swim4", "swim5", "steer3", "steer4", "steer5"]


@pytest.fixture(autouse=True)
def no_trace():
    yield
    gc.collect()
    assert mujoco.get_mjcb_passive() is None
    assert DOMAIN not in dm_suite._DOMAINS


def given(*states):
    """Initial states in turn."""
    remaining = iter(states)
    return lambda _: next(remaining)


def random_reduced_state(n, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, 2 * n + 2)


@pytest.mark.parametrize("task", TASKS)
def test_observations_and_actions_have_their_shapes(task):
    n = int(task[-1])
    env = load(task, {"random": 0})
    assert list(env.observation_spec()) == ["angles", "angular_velocities", "velocity"]
    assert [spec.shape for spec in env.observation_spec().values()] == [(n,), (n,), (2,)]
    action = env.action_spec()
    assert action.shape == (n - 1,)
    np.testing.assert_array_equal(action.minimum, -1)
    np.testing.assert_array_equal(action.maximum, 1)
    observation = env.reset().observation
    assert (np.abs(observation["angles"]) <= np.pi).all()
    assert (np.abs(observation["angular_velocities"]) <= 1).all()


def test_tasks_are_the_six_and_none_is_benchmarking():
    assert list(SUITE) == TASKS
    assert SUITE.tagged("benchmarking") == {}
    with pytest.raises(
        ValueError, match="no task 'swim6'; the tasks are swim3, swim4, swim5, steer3, steer4, steer5"
    ):
        load("swim6")


def test_an_episode_takes_five_seconds_of_a_hundredth():
    env = load("swim3", {"random": 0})
    assert env.control_timestep() == 0.01
    assert env.physics.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    env.reset()
    for _ in range(499):
        assert not env.step([0, 0]).last()
    last = env.step([0, 0])
    assert last.last()
    assert last.discount == 1.0
    assert env.physics.time() == pytest.approx(5.0)


def test_time_limit_control_timestep_and_parameters_can_be_set():
    parameters = SwimmerParameters(3, mass=2.0, length=0.5, viscous_friction=3.0, torque_limit=1.0)
    env = load("swim3", {"time_limit": 0.2, "params": parameters}, {"control_timestep": 0.05})
    assert env.physics.parameters == parameters
    env.reset()
    assert [env.step([0, 0]).last() for _ in range(4)] == [False, False, False, True]
    assert load("swim3", None, {"n_sub_steps": 3}).control_timestep() == pytest.approx(0.03)


def test_refuses_parameters_with_another_number_of_links():
    with pytest.raises(ValueError, match="the task is for 3 links, and params has 5"):
        load("swim3", {"params": PAPER})


@pytest.mark.parametrize("task", ["swim5", "steer5"])
@pytest.mark.parametrize("environment_kwargs", [{}, {"n_sub_steps": 4}, {"legacy_step": False}])
def test_reward_is_displacement_over_time(task, environment_kwargs):
    env = load(task, {"random": 1}, environment_kwargs)
    env.reset()
    rng = np.random.default_rng(0)
    angle = env.physics.target_direction()
    direction = [np.cos(angle), np.sin(angle)]
    for _ in range(20):
        before = env.physics.center_of_mass()
        reward = env.step(rng.uniform(-1, 1, 4)).reward
        displacement = env.physics.center_of_mass() - before
        assert type(reward) is float
        assert reward == pytest.approx(displacement @ direction / env.control_timestep(), abs=1e-12)


def test_before_the_first_step_the_reward_is_the_velocity():
    env = load("swim5", {"random": 1})
    velocity = env.reset().observation["velocity"]
    assert env.task.get_reward(env.physics) == pytest.approx(velocity[0], abs=1e-14)


def test_a_step_is_the_analytic_swimmers():
    parameters = SwimmerParameters(4, mass=[1, 2, 3, 1], length=[1, 0.5, 1, 2], torque_limit=[3, 4, 5])
    z = random_reduced_state(4)
    env = load("swim4", {"params": parameters, "initial_states": given(z)})
    env.reset()
    x = st.expand(parameters, z)
    np.testing.assert_allclose(env.physics.state_vector(), x, atol=1e-14)
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, 3)
        env.step(action)
        x = AnalyticSwimmer(parameters).rk4_step(x, action * parameters.torque_limits, 0.01)
    np.testing.assert_allclose(env.physics.state_vector(), x, rtol=1e-11, atol=1e-11)


def test_accessors_say_what_mujoco_says():
    env = load("swim5", {"random": 0})
    env.reset()
    physics = env.physics
    physics.forward()
    root = physics.named.data.subtree_com["link_1"]
    np.testing.assert_allclose(physics.center_of_mass(), root[:2], atol=1e-13)
    mujoco.mj_subtreeVel(physics.model.ptr, physics.data.ptr)
    np.testing.assert_allclose(
        physics.center_of_mass_velocity(), physics.named.data.subtree_linvel["link_1"][:2], atol=1e-13
    )
    for i in range(5):
        np.testing.assert_allclose(
            physics.joint_positions()[i], physics.named.data.xpos[f"link_{i + 1}"][:2], atol=1e-13
        )
        heading = physics.named.data.xmat[f"link_{i + 1}"][[0, 3]]
        np.testing.assert_allclose(
            [np.cos(physics.angles()[i]), np.sin(physics.angles()[i])], heading, atol=1e-13
        )
    np.testing.assert_array_equal(
        physics.state_vector(),
        np.concatenate(
            [physics.data.qpos[:2], physics.angles(), physics.data.qvel[:2], physics.angular_velocities()]
        ),
    )


def test_state_vector_survives_there_and_back_and_is_not_wrapped():
    physics = load("swim5").physics
    x = np.random.default_rng(0).uniform(-30, 30, 14)
    with physics.reset_context():
        physics.set_state_vector(x)
    np.testing.assert_allclose(physics.state_vector(), x, atol=1e-13)


def test_friction_is_in_force_in_reset_forward_and_step():
    env = load("swim5", {"random": 0})
    physics = env.physics

    def friction():
        return np.abs(physics.data.qfrc_passive).max()

    env.reset()
    assert friction() > 0.1
    physics.data.qfrc_passive[:] = 0
    physics.forward()
    assert friction() > 0.1
    physics.data.qfrc_passive[:] = 0
    env.step([1, 0, 0, 1])
    assert friction() > 0.1


@pytest.mark.parametrize("friction", ["callback", "actuators"])
@pytest.mark.parametrize("legacy_step", [True, False])
def test_a_task_does_not_go_on_when_the_callback_was_replaced(friction, legacy_step):
    env = load("swim3", {"random": 0, "friction": friction}, {"legacy_step": legacy_step})
    env.reset()
    installed = mujoco.get_mjcb_passive()
    mujoco.set_mjcb_passive(None)
    for use in (env.physics.reset, lambda: env.step([0, 0]), env.reset):
        if friction == "callback":
            with pytest.raises(RuntimeError, match="was replaced while laws were in force"):
                use()
        else:
            use()
    mujoco.set_mjcb_passive(installed)
    env.reset()
    env.step([0, 0])


def test_friction_leaves_when_the_last_environment_is_freed_or_dropped():
    first, second = load("swim3"), load("swim5")
    copies = [copy.deepcopy(first), pickle.loads(pickle.dumps(second))]
    physics = second.physics.copy()
    for env in (first, second, *copies):
        assert mujoco.get_mjcb_passive() is not None
        env.physics.free()
    assert mujoco.get_mjcb_passive() is not None
    del physics
    gc.collect()
    assert mujoco.get_mjcb_passive() is None


def test_copies_go_on_as_the_original_does():
    env = load("steer5", {"random": 3})
    env.reset()
    env.step([1, -1, 1, -1])
    originals = copy.deepcopy(env), pickle.loads(pickle.dumps(env)), env
    steps = [[other.step([1, 0, -1, 1]) for _ in range(5)][-1] for other in originals]
    for step in steps[:2]:
        assert step.reward == steps[2].reward
        np.testing.assert_array_equal(step.observation["angles"], steps[2].observation["angles"])
    for other in originals:
        other.physics.free()


@pytest.mark.parametrize("task", ["swim3", "steer3"])
def test_seeds_decide(task):
    def episode(seed):
        env = load(task, {"random": seed})
        observations = [env.reset().observation for _ in range(2)]
        observations.append(env.step([1, -1]).observation)
        return np.array([np.concatenate(list(o.values())) for o in observations])

    np.testing.assert_array_equal(episode(7), episode(7))
    assert (episode(7) != episode(8)).any()
    assert (episode(7)[0] != episode(7)[1]).any()


def test_given_initial_states_come_in_turn_with_the_centre_of_mass_at_the_origin():
    states = [random_reduced_state(3, seed) for seed in range(3)]
    env = load("swim3", {"initial_states": given(*states)})
    for z in states:
        observation = env.reset().observation
        np.testing.assert_allclose(np.concatenate(list(observation.values())), z, atol=1e-14)
        np.testing.assert_allclose(env.physics.center_of_mass(), 0, atol=1e-14)


def test_steering_is_swimming_in_a_turned_world():
    z = random_reduced_state(5)
    steer = load("steer5", {"random": 5, "initial_states": given(z)})
    first = steer.reset()
    direction = steer.physics.target_direction()
    assert abs(direction) > 0.1
    seen = st.join_reduced(*first.observation.values())
    swim = load("swim5", {"initial_states": given(seen)})
    np.testing.assert_allclose(st.join_reduced(*swim.reset().observation.values()), seen, atol=1e-14)
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, 4)
        turned, straight = steer.step(action), swim.step(action)
        assert turned.reward == pytest.approx(straight.reward, abs=1e-11)
        for key in turned.observation:
            np.testing.assert_allclose(turned.observation[key], straight.observation[key], atol=1e-11)


@pytest.mark.parametrize("friction", ["callback", "actuators"])
def test_a_reset_of_the_physics_keeps_the_target_direction(friction):
    env = load("steer5", {"random": 5, "friction": friction})
    env.reset()
    physics = env.physics
    direction = physics.target_direction()
    assert abs(direction) > 0.1
    x = st.expand(PAPER, random_reduced_state(5))
    x[:2] += [3.0, 4.0]

    def check():
        assert physics.target_direction() == direction
        mark = physics.named.data.xpos["target"][:2] - physics.center_of_mass()
        np.testing.assert_allclose(mark, 3.2 * np.array([np.cos(direction), np.sin(direction)]), atol=1e-12)

    physics.reset()
    check()
    with physics.reset_context():
        physics.set_state_vector(x)
        physics.move_target_mark(physics.center_of_mass())
    check()
    action = [1, -1, 1, -1]
    velocity = physics.center_of_mass()
    reward = env.step(action).reward
    velocity = (physics.center_of_mass() - velocity) / 0.01
    assert reward == pytest.approx(velocity @ [np.cos(direction), np.sin(direction)], abs=1e-12)
    again = load("steer5", {"random": 5, "friction": friction})
    again.reset()
    np.testing.assert_array_equal(env.reset().observation["angles"], again.reset().observation["angles"])
    assert physics.target_direction() == again.physics.target_direction() != direction


def test_steering_draws_directions_all_around():
    env = load("steer3", {"random": 0})
    directions = []
    for _ in range(200):
        env.reset()
        directions.append(env.physics.target_direction())
    assert min(directions) < -3 < 3 < max(directions)
    np.testing.assert_allclose(np.mean(directions), 0, atol=0.4)


@pytest.mark.parametrize("task", ["swim5", "steer5"])
def test_the_mark_goes_ahead_of_the_swimmer_in_the_target_direction(task):
    env = load(task, {"random": 2})
    env.reset()
    for _ in range(3):
        env.step([1, 1, -1, -1])
        env.physics.forward()
        mark = env.physics.named.data.xpos["target"][:2] - env.physics.center_of_mass()
        angle = env.physics.target_direction()
        np.testing.assert_allclose(mark, 3.2 * np.array([np.cos(angle), np.sin(angle)]), atol=1e-12)
        heading = env.physics.named.data.xmat["target"][[0, 3]]
        np.testing.assert_allclose(heading, [np.cos(angle), np.sin(angle)], atol=1e-12)


def test_angles_wrap_into_minus_pi_to_pi():
    angles = np.array([0.0, np.pi, -np.pi, 3 * np.pi, 7.0, -7.0, 100.0])
    wrapped = wrap_angle(angles)
    assert ((wrapped > -np.pi) & (wrapped <= np.pi)).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-13)
    assert wrapped[2] == np.pi


CONSTANTS = (
    "ALL_TASKS",
    "BENCHMARKING",
    "EASY",
    "HARD",
    "EXTRA",
    "NO_REWARD_VIZ",
    "REWARD_VIZ",
    "TASKS_BY_DOMAIN",
)


def test_register_adds_the_domain_and_unregister_restores_everything():
    def constants():
        return {name: getattr(dm_suite, name) for name in CONSTANTS}

    before, domains = constants(), dict(dm_suite._DOMAINS)
    unregister()
    assert constants() == before
    register()
    try:
        register()
        assert dm_suite.TASKS_BY_DOMAIN[DOMAIN] == tuple(TASKS)
        ours = {(DOMAIN, task) for task in TASKS}
        for name in ("ALL_TASKS", "EXTRA", "REWARD_VIZ"):
            assert set(getattr(dm_suite, name)) - set(before[name]) == ours
        for name in ("BENCHMARKING", "EASY", "HARD", "NO_REWARD_VIZ"):
            assert getattr(dm_suite, name) == before[name]
        env = dm_suite.load(DOMAIN, "swim3", task_kwargs={"random": 0}, visualize_reward=True)
        assert env.task.visualize_reward
        expected = load("swim3", {"random": 0}).reset().observation
        np.testing.assert_array_equal(env.reset().observation["angles"], expected["angles"])
    finally:
        unregister()
    assert constants() == before
    assert domains == dm_suite._DOMAINS
    assert list(dm_suite.TASKS_BY_DOMAIN) == list(before["TASKS_BY_DOMAIN"])


def test_register_refuses_to_take_another_domains_name(monkeypatch):
    monkeypatch.setitem(dm_suite._DOMAINS, DOMAIN, dm_suite.swimmer)
    with pytest.raises(ValueError, match="already has another domain"):
        register()
    unregister()
    assert dm_suite._DOMAINS[DOMAIN] is dm_suite.swimmer
    monkeypatch.undo()


def test_colours_show_the_reward():
    env = load("swim3", {"random": 0}, visualize_reward=True)
    env.reset()
    step = env.step([1, -1])
    rgba = env.physics.named.model.mat_rgba
    blend = np.clip(step.reward, 0, 1) ** 4
    np.testing.assert_allclose(
        rgba["self"], blend * rgba["self_highlight"] + (1 - blend) * rgba["self_default"], atol=1e-6
    )


def test_both_statements_of_the_friction_give_one_task():
    environments = [load("steer4", {"random": 3, "friction": f}) for f in ("callback", "actuators")]
    for one, other in zip(*(env.action_spec().__reduce__()[1] for env in environments), strict=True):
        np.testing.assert_array_equal(one, other)
    rng = np.random.default_rng(0)
    steps = [env.reset() for env in environments]
    for _ in range(30):
        action = rng.uniform(-1, 1, 3)
        steps = [env.step(action) for env in environments]
        np.testing.assert_array_equal(environments[1].physics.control(), action)
        for one, other in zip(*(step.observation.values() for step in steps), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)
        assert steps[0].reward == pytest.approx(steps[1].reward, abs=1e-10)


def test_after_a_reset_the_friction_by_actuators_is_in_force_and_the_motors_are_not():
    callback, actuators = (load("swim5", {"random": 3, "friction": f}) for f in ("callback", "actuators"))
    x = st.expand(PAPER, random_reduced_state(5))
    vacuum = AnalyticSwimmer(SwimmerParameters(viscous_friction=0.0)).drift(x)[-7:]
    for physics in (callback.physics, actuators.physics):
        with physics.reset_context():
            physics.set_state_vector(x)
            physics.set_control([1, -1, 1, -1])
        found = np.concatenate([physics.data.qacc[:2], physics.data.qacc[2:].cumsum()])
        np.testing.assert_allclose(found, AnalyticSwimmer().drift(x)[-7:], rtol=1e-10)
        assert np.abs(found - vacuum).max() > 1
        np.testing.assert_array_equal(physics.control(), [1, -1, 1, -1])
        physics.reset()
        np.testing.assert_allclose(physics.data.qacc, 0, atol=1e-12)


def test_friction_by_actuators_leaves_the_callback_alone_and_survives_copies():
    env = load("swim3", {"random": 0, "friction": "actuators"})
    env.reset()
    for physics in (env.physics, env.physics.copy(), pickle.loads(pickle.dumps(env.physics))):
        physics.step()
        assert physics.parameters == SwimmerParameters(3)
        assert mujoco.get_mjcb_passive() is None
    physics = env.physics
    physics.reload_from_xml_string(mjcf(PAPER))
    assert mujoco.get_mjcb_passive() is not None
    physics.reload_from_xml_string(mjcf(PAPER, friction="actuators"))
    assert mujoco.get_mjcb_passive() is None
    physics.free()
    with pytest.raises(ValueError, match="friction must be callback or actuators, got 'both'"):
        load("swim3", {"friction": "both"})
