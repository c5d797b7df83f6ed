import copy
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode

import swimmer_mj.gymnasium
from swimmer_mj import SwimmerParameters
from swimmer_mj.environments.simulation import PhysicsError
from swimmer_mj.environments.vector import SwimmerVectorEnv

IDS = [id for id in gymnasium.registry if id.startswith("swimmer_mj/")]
SWIM5, STEER3 = "swimmer_mj/Swim5-v0", "swimmer_mj/Steer3-v0"


@pytest.fixture
def make():
    """gymnasium.make and make_vec, whose environments are closed after the test."""
    made = []

    def make(id, num_envs=None, **kwargs):
        env = gymnasium.make(id, **kwargs) if num_envs is None else gymnasium.make_vec(id, num_envs, **kwargs)
        made.append(env)
        return env

    yield make
    for env in made:
        env.close()


def actions(env, n_steps, seed=0):
    env.action_space.seed(seed)
    return [env.action_space.sample() for _ in range(n_steps)]


def assert_same_step(step, expected):
    """Observation, reward, termination and truncation are equal to the last bit, and of one type."""
    for value, other in zip(step[:4], expected[:4], strict=True):
        np.testing.assert_array_equal(value, other, strict=True)


def test_there_are_three_numbers_of_links_for_each_kind_of_task():
    assert [id.removeprefix("swimmer_mj/") for id in IDS] == [
        "Swim3-v0",
        "Swim4-v0",
        "Swim5-v0",
        "Steer3-v0",
        "Steer4-v0",
        "Steer5-v0",
    ]


def output_of(code):
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


def test_gymnasium_finds_the_environments_by_the_name_of_the_module():
    code = """
import gymnasium
env = gymnasium.make("swimmer_mj.gymnasium:swimmer_mj/Swim3-v0")
envs = gymnasium.make_vec("swimmer_mj.gymnasium:swimmer_mj/Swim3-v0", num_envs=2)
print(env.spec.id, envs.spec.id)
"""
    assert output_of(code) == ["swimmer_mj/Swim3-v0 swimmer_mj/Swim3-v0"]


def test_the_friction_is_in_force_until_the_environments_are_closed():
    code = """
import gymnasium, mujoco, swimmer_mj.gymnasium
env = gymnasium.make("swimmer_mj/Swim3-v0")
envs = gymnasium.make_vec("swimmer_mj/Swim3-v0", num_envs=2)
for close in env.close, envs.close, env.close, envs.close:
    print(mujoco.get_mjcb_passive() is None)
    close()
print(mujoco.get_mjcb_passive() is None)
"""
    assert output_of(code) == ["False", "False", "True", "True", "True"]


def test_registration_imports_no_simulator():
    code = "import sys, swimmer_mj.gymnasium; print({'mujoco', 'dm_control', 'torch', 'numba'} & set(sys.modules))"
    assert output_of(code) == ["set()"]


@pytest.mark.parametrize("id", IDS)
def test_an_environment_is_the_dm_control_task_to_the_last_bit(suite, make, id):
    env = make(id)
    task = id.removeprefix("swimmer_mj/").removesuffix("-v0").lower()
    reference = suite.load(task, task_kwargs={"random": 3})

    def flat(time_step):
        keys = "angles", "angular_velocities", "velocity"
        return np.concatenate([time_step.observation[key] for key in keys])

    for seed in (3, None):  # two episodes
        observation, info = env.reset(seed=seed)
        np.testing.assert_array_equal(observation, flat(reference.reset()), strict=True)
        assert info == {}
        steps = [(env.step(action), reference.step(action)) for action in actions(env, 500)]
        for i, ((observation, reward, terminated, truncated, info), time_step) in enumerate(steps, start=1):
            np.testing.assert_array_equal(observation, flat(time_step), strict=True)
            assert reward == time_step.reward
            assert (terminated, truncated, info) == (False, i == 500, {})
        assert steps[-1][1].last()
    reference.physics.free()


def test_spaces_and_frame_rate(make):
    env = make("swimmer_mj/Swim4-v0")
    assert env.observation_space == gymnasium.spaces.Box(-np.inf, np.inf, (10,), np.float64)
    assert env.action_space == gymnasium.spaces.Box(-1, 1, (3,), np.float32)
    assert env.metadata == {"render_modes": ["rgb_array"], "render_fps": 100}


def test_a_skipped_frame_holds_the_action(make):
    env, slow, slows = make(SWIM5), make(SWIM5, frame_skip=5), make(SWIM5, 1, frame_skip=5)
    for e in (env, slow, slows):
        e.reset(seed=0)
    assert slow.metadata["render_fps"] == slows.metadata["render_fps"] == 20
    for action in actions(env, 10):
        steps = [env.step(action) for _ in range(5)]
        observation, reward, *_ = slow.step(action)
        np.testing.assert_array_equal(observation, steps[-1][0])
        assert reward == pytest.approx(np.mean([step[1] for step in steps]), rel=1e-9, abs=1e-12)
        assert_same_step(
            [part[0] for part in slows.step(action[None])[:4]], (observation, reward, False, False)
        )


def test_torques_beyond_the_limits_are_clipped(make):
    env, other = make(SWIM5), make(SWIM5)
    env.reset(seed=0)
    other.reset(seed=0)
    action = np.array([2, -3, 0.5, 1], dtype=np.float32)
    assert_same_step(env.step(action), other.step(action.clip(-1, 1)))


@pytest.mark.parametrize("seed", [0, 2**32 - 1, 2**32, 2**100 + 1])
def test_a_seed_fixes_the_episodes(make, seed):
    env, other = make(STEER3), make(STEER3)
    first = env.reset(seed=seed)[0]
    second = env.reset()[0]
    np.testing.assert_array_equal(other.reset(seed=seed)[0], first)
    np.testing.assert_array_equal(other.reset()[0], second)
    assert not np.array_equal(first, second)
    assert not np.array_equal(env.reset(seed=seed + 1)[0], first)


def test_large_seeds_differ_beyond_their_low_words(make):
    env = make(STEER3)
    assert not np.array_equal(env.reset(seed=7)[0], env.reset(seed=7 + 2**32)[0])


def test_the_seed_of_an_unseeded_environment_gives_its_episode_again(make):
    env, other = make(STEER3), make(STEER3)
    first = env.reset()[0]
    assert not np.array_equal(other.reset()[0], first)
    np.testing.assert_array_equal(other.reset(seed=env.unwrapped.np_random_seed)[0], first)


def test_a_seed_is_not_negative(make):
    with pytest.raises(gymnasium.error.Error, match="greater or equal to zero"):
        make(SWIM5).reset(seed=-1)
    for seed in (-1, [0, -1], [0, 1.5]):
        with pytest.raises(ValueError, match=r"a seed must be an integer of at least 0, got (-1|1\.5)"):
            make(SWIM5, 2).reset(seed=seed)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_where_the_original_stands(make, copied):
    env = make(STEER3, max_episode_steps=30)
    env.reset(seed=0)
    for action in actions(env, 10):
        env.step(action)
    other = copied(env)
    steps = [(env.step(action), other.step(action)) for action in actions(env, 20, seed=1)]
    for step, expected in steps:
        assert_same_step(step, expected)
    assert steps[-1][1][3]  # truncated
    np.testing.assert_array_equal(env.reset()[0], other.reset()[0])
    other.close()


def test_another_swimmer(make):
    params = SwimmerParameters(n_links=3, mass=(1.0, 2.0, 0.5), length=(0.5, 1.0, 1.5), viscous_friction=3.0)
    env, envs = make(STEER3, params=params), make(STEER3, 1, params=params)
    assert env.unwrapped.physics.parameters == params
    np.testing.assert_array_equal(env.reset(seed=0)[0], envs.reset(seed=0)[0][0])
    for action in actions(env, 20):
        observation, reward, *_ = env.step(action)
        observations, rewards, *_ = envs.step(action[None])
        np.testing.assert_array_equal(observation, observations[0])
        assert reward == rewards[0]


def test_given_initial_states(make):
    states = np.random.default_rng(0).uniform(-1, 1, (4, 8))
    remaining = iter(states)
    env = make("swimmer_mj/Swim3-v0", initial_states=lambda _: next(remaining))
    np.testing.assert_allclose([env.reset()[0] for _ in states], states, rtol=0, atol=1e-14)
    remaining = iter(states)
    envs = make("swimmer_mj/Swim3-v0", 4, initial_states=lambda _: next(remaining))
    np.testing.assert_allclose(envs.reset()[0], states, rtol=0, atol=1e-14)


@pytest.mark.parametrize("num_envs", [None, 1])
@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"task": "swim6"}, "no task 'swim6'"),
        ({"frame_skip": 0}, "frame_skip must be an integer of at least 1, got 0"),
        ({"frame_skip": 1.5}, r"frame_skip must be an integer of at least 1, got 1\.5"),
        ({"width": 2000}, "width must be an integer from 1 to 1280, got 2000"),
        ({"width": 0}, "width must be an integer from 1 to 1280, got 0"),
        ({"height": 721}, "height must be an integer from 1 to 720, got 721"),
        ({"camera_name": "side"}, "camera_name must be one of tracking, top; got 'side'"),
        ({"params": SwimmerParameters(n_links=4)}, "for 5 links, and params has 4"),
    ],
)
def test_bad_arguments(make, num_envs, kwargs, message):
    with pytest.raises(ValueError, match=message):
        make(SWIM5, num_envs, **kwargs)


def test_the_largest_frame_and_the_cameras_are_the_models(make):
    model = make(SWIM5).unwrapped.physics.model
    largest = model.vis.global_.offwidth, model.vis.global_.offheight
    assert largest == swimmer_mj.environments.gymnasium._LARGEST_FRAME
    assert {model.camera(i).name for i in range(model.ncam)} == {*swimmer_mj.environments.gymnasium._CAMERAS}


@pytest.mark.parametrize("steps", [0, -2, 1.5])
def test_an_episode_has_a_step_or_no_end(make, steps):
    bounds = "unless -1 for never, must be an integer of at least 1"
    with pytest.raises(ValueError, match=f"max_episode_steps, {bounds}, got {steps}"):
        make(SWIM5, 2, max_episode_steps=steps)


@pytest.mark.parametrize("nthread", [-1, 1.5])
def test_threads_are_a_whole_number(nthread):
    with pytest.raises(ValueError, match=f"nthread must be an integer of at least 0, got {nthread}"):
        SwimmerVectorEnv("swim5", 2, nthread=nthread)


@pytest.mark.parametrize("num_envs", [0, -1, 1.5])
def test_a_vector_has_an_environment(num_envs):
    with pytest.raises(ValueError, match=f"num_envs must be an integer of at least 1, got {num_envs}"):
        SwimmerVectorEnv("swim5", num_envs)


def test_a_step_before_the_first_reset_is_refused():
    env = swimmer_mj.gymnasium.SwimmerEnv("swim5")
    action = np.zeros(4, np.float32)
    with pytest.raises(ResetNeeded, match=r"call reset\(\) before the first step\(\)"):
        env.step(action)
    env.reset()
    assert type(env.step(action)[1]) is float
    env.close()


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_a_vector_closes_with_the_arguments_that_others_take(make, mode):
    envs = make(SWIM5, 2, vectorization_mode=mode)
    envs.reset()
    envs.close(timeout=1, terminate=True)
    with pytest.raises(RuntimeError if mode == "sync" else ClosedEnvironmentError):
        envs.reset()


def test_a_closed_environment_does_not_go_on_without_friction():
    env = swimmer_mj.gymnasium.SwimmerEnv("swim5", render_mode="rgb_array")
    env.reset(seed=0)
    copied = copy.deepcopy(env)
    env.close()
    for use in (env.reset, lambda: env.step(np.zeros(4, np.float32)), env.render):
        with pytest.raises(RuntimeError, match="the simulation is closed and would go on without friction"):
            use()
    copied.step(np.zeros(4, np.float32))
    copied.close()


def test_a_closed_vector_has_freed_its_simulations_and_threads():
    code = """
import os
from swimmer_mj.environments.simulation import PhysicsError
from swimmer_mj.environments.vector import SwimmerVectorEnv
for _ in range(2):  # the first leaves what libraries keep
    before = len(os.listdir("/proc/self/task"))
    envs = SwimmerVectorEnv("swim3", 64, nthread=8)
    envs.reset()
    running = len(os.listdir("/proc/self/task"))
    simulations = weakref.ref(envs._batch)
    envs.close()
    envs.close()
    envs.close_extras()
    print(running - before, len(os.listdir("/proc/self/task")) - before, simulations())
"""
    assert output_of(f"import weakref{code}")[1] == "7 0 None"


def test_bad_render_mode():
    with pytest.raises(ValueError, match=r"render_mode must be None or one of .*, got 'human'"):
        swimmer_mj.gymnasium.SwimmerEnv("swim5", render_mode="human")


def test_an_action_has_a_number_per_joint(make):
    env, envs = make(SWIM5), make(SWIM5, 3)
    env.reset()
    envs.reset()
    with pytest.raises(ValueError, match=r"action must have shape \(4,\), got \(3,\)"):
        env.unwrapped.step(np.zeros(3, np.float32))
    with pytest.raises(ValueError, match=r"actions must have shape \(3, 4\), got \(4,\)"):
        envs.step(np.zeros(4, np.float32))


def test_a_frame(make):
    env = make(SWIM5, render_mode="rgb_array", width=96, height=64)
    env.reset(seed=0)
    frame = env.render()
    assert frame.shape == (64, 96, 3)
    assert frame.dtype == np.uint8
    env.reset(seed=1)
    assert not np.array_equal(env.render(), frame)


def test_without_a_render_mode_there_is_no_frame(make):
    env = make(SWIM5)
    env.reset()
    with pytest.warns(UserWarning, match="without render_mode"):
        assert env.unwrapped.render() is None


@pytest.mark.parametrize("autoreset_mode", AutoresetMode)
@pytest.mark.parametrize("id", [SWIM5, STEER3])
@pytest.mark.parametrize("nthread", [1, 2])
def test_a_vector_is_its_single_environments_to_the_last_bit(make, id, autoreset_mode, nthread):
    sync = make(
        id,
        5,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": autoreset_mode},
        max_episode_steps=20,
    )
    envs = make(id, 5, autoreset_mode=autoreset_mode, nthread=nthread, max_episode_steps=20)
    assert type(envs).__name__ == "SwimmerVectorEnv"
    assert envs.metadata == sync.metadata
    assert envs.metadata["autoreset_mode"] is autoreset_mode
    for space in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(envs, space) == getattr(sync, space)

    np.testing.assert_array_equal(envs.reset(seed=4)[0], sync.reset(seed=4)[0], strict=True)
    half = np.array([True, False, True, False, False])
    for i, action in enumerate(actions(sync, 65)):
        if i == 7:  # from here on, episodes do not end together
            reset = [e.reset(options={"reset_mask": half}) for e in (envs, sync)]
            np.testing.assert_array_equal(reset[0][0], reset[1][0])
        step, expected = envs.step(action), sync.step(action)
        assert_same_step(step, expected)
        assert step[4].keys() == expected[4].keys()
        for key in ("final_obs", "_final_obs"):
            for value, other in zip(step[4].get(key, ()), expected[4].get(key, ()), strict=True):
                np.testing.assert_array_equal(value, other)
        if autoreset_mode is AutoresetMode.DISABLED and step[3].any():
            reset = [e.reset(options={"reset_mask": step[3].copy()}) for e in (envs, sync)]
            np.testing.assert_array_equal(reset[0][0], reset[1][0])


def test_whole_episodes_of_a_vector_are_those_of_single_environments(make):
    envs = make(SWIM5, 3)
    assert envs.spec.max_episode_steps == 500
    observations, _ = envs.reset(seed=10)
    steps = [envs.step(action) for action in actions(envs, 501)]
    assert [i for i, step in enumerate(steps, start=1) if step[3].any()] == [500]
    assert steps[499][3].all()
    assert not any(step[2].any() for step in steps)
    for i in range(3):
        env = make(SWIM5)
        np.testing.assert_array_equal(env.reset(seed=10 + i)[0], observations[i])
        for action, step in zip(actions(envs, 500), steps, strict=False):
            assert_same_step(env.step(action[i]), [part[i] for part in step[:4]])
        np.testing.assert_array_equal(env.reset()[0], steps[500][0][i])


def test_other_lengths_of_episodes(make):
    env, envs, endless = (
        make(STEER3, max_episode_steps=510),
        make(STEER3, 1, max_episode_steps=510),
        make(STEER3, 1, max_episode_steps=-1),
    )
    for e in (env, envs, endless):
        e.reset(seed=0)
    for i, action in enumerate(actions(env, 510), start=1):
        step = env.step(action)
        assert step[3] == (i == 510)
        assert_same_step([part[0] for part in envs.step(action[None])[:4]], step)
        assert not endless.step(action[None])[3]


def test_seeds_of_a_vector(make):
    envs, other = make(STEER3, 3), make(STEER3, 3)
    first = envs.reset()[0]
    assert len(np.unique(first, axis=0)) == 3
    np.testing.assert_array_equal(other.reset(seed=envs.np_random_seed)[0], first)
    np.testing.assert_array_equal(other.reset()[0], envs.reset()[0])

    large = np.array([2**40, 7, 2**62])  # of NumPy's integers
    np.testing.assert_array_equal(envs.reset(seed=large)[0], other.reset(seed=large.tolist())[0])

    envs.reset(seed=[5, None, 6])
    assert envs.np_random_seed == (5, other.np_random_seed[1], 6)
    with pytest.raises(ValueError, match="one number or 3, one per environment; got 2"):
        envs.reset(seed=[1, 2])


@pytest.mark.parametrize("mask", [[True, False, True], [1, 0], [False, False]])
def test_bad_reset_masks(make, mask):
    envs = make(SWIM5, 2)
    with pytest.raises(ValueError, match="reset_mask must be a bool array of shape"):
        envs.reset(options={"reset_mask": np.array(mask)})


def test_observations_of_a_vector_stay_as_they_were_given(make):
    envs = make(SWIM5, 2)
    kept = [envs.reset(seed=0)[0]]
    before = [kept[0].copy()]
    for action in actions(envs, 3):
        kept += envs.step(action)[:4]
        before += [x.copy() for x in kept[len(before) :]]
    for value, other in zip(kept, before, strict=True):
        np.testing.assert_array_equal(value, other)


def test_a_vector_steps_only_episodes_that_run(make):
    envs = make(SWIM5, 2, autoreset_mode="Disabled", max_episode_steps=1)
    action = np.zeros((2, 4), np.float32)
    with pytest.raises(ResetNeeded, match="before the first step"):
        envs.step(action)
    envs.reset()
    envs.step(action)
    with pytest.raises(ResetNeeded, match=r"environments \[0 1\]"):
        envs.step(action)
    envs.close()
    with pytest.raises(ClosedEnvironmentError):
        envs.step(action)
    with pytest.raises(ClosedEnvironmentError):
        envs.reset()


def test_an_action_that_is_no_number_is_reported(make, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file in the working directory
    env, envs = make(SWIM5), make(SWIM5, 3)
    env.reset(seed=0)
    action = np.full(4, np.nan, np.float32)
    with pytest.raises(PhysicsError):
        env.step(action)

    observations, _ = envs.reset(seed=0)
    with pytest.raises(PhysicsError, match=r"environments \[1\]"):
        envs.step(np.stack([np.zeros(4, np.float32), action, np.zeros(4, np.float32)]))
    np.testing.assert_array_equal(envs.reset(seed=0)[0], observations)
    envs.step(np.zeros((3, 4), np.float32))


def test_frames_of_a_vector(make):
    def fast(random):
        velocity = [30.0, 0.0]  # m/s: it leaves the first frame's view
        return np.concatenate([random.uniform(-1, 1, 6), velocity])

    kwargs = {"render_mode": "rgb_array", "width": 96, "height": 64, "initial_states": fast}
    envs, env = make(STEER3, 2, **kwargs), make(STEER3, **kwargs)
    envs.reset(seed=0)
    env.reset(seed=1)
    for action in actions(envs, 20):
        envs.step(action)
        env.step(action[1])
    frames = envs.render()
    assert not np.array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[1], env.render())
