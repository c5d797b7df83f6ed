"""What docs/physics-checks.md promises of the callback where others act in the same process, or in a child of it."""

import copy
import ctypes
import os
import pickle
import runpy
import subprocess
import sys
import threading
from pathlib import Path

import mujoco
import mujoco.batch
import numba
import numpy as np
import pytest

from swimmer_mj.compiled.pointers import pointer
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


def moving(model):
    data = mujoco.MjData(model)
    data.qvel[:] = np.linspace(-1, 1, model.nv)
    return data


def final_state(model, n_steps=100):
    data = moving(model)
    mujoco.mj_step(model, data, n_steps)
    return np.concatenate([data.qpos, data.qvel])


def test_sixteen_threads_of_swimmers_and_others_move_bit_for_bit_as_alone():
    stress = runpy.run_path(str(BENCHMARKS / "callback_stress.py"))
    assert stress["differences"](repeats=2) == 0


def test_two_parameter_sets_in_one_scope_are_each_their_own():
    sets = [PAPER, SwimmerParameters(3, mass=2.0, length=[0.5, 1, 2], viscous_friction=3.0)]
    models = [mujoco.MjModel.from_xml_string(mjcf(p)) for p in sets]
    alone = []
    for model in models:
        with viscous_friction():
            alone.append(final_state(model))
    with viscous_friction():
        datas = [moving(model) for model in models]
        for _ in range(100):
            for model, data in zip(models, datas, strict=True):
                mujoco.mj_step(model, data)
    for data, expected in zip(datas, alone, strict=True):
        np.testing.assert_array_equal(np.concatenate([data.qpos, data.qvel]), expected)


def test_a_model_compiles_in_a_scope_as_outside():
    xml = mjcf(PAPER)
    outside = mujoco.MjModel.from_xml_string(xml)
    with viscous_friction():
        inside = mujoco.MjModel.from_xml_string(xml)
        spec = mujoco.MjSpec.from_string(xml).compile()
    for model in (inside, spec):
        assert bytes(model.names) == bytes(outside.names)
        np.testing.assert_array_equal(model.body_inertia, outside.body_inertia)
        np.testing.assert_array_equal(model.dof_invweight0, outside.dof_invweight0)


@pytest.fixture
def counting():
    """A user's compiled callback that counts its calls."""
    calls = np.zeros(1)
    address = calls.ctypes.data

    @numba.cfunc(numba.types.void(numba.types.voidptr, numba.types.voidptr))
    def count(model, data):
        numba.carray(pointer(address), 1, np.float64)[0] += 1

    return count, calls


def test_a_users_compiled_callback_is_joined_in_c(counting):
    """So that models still compile, and MuJoCo's thread pools still take it."""
    count, calls = counting
    user = count.ctypes
    model = mujoco.MjModel.from_xml_string(mjcf(PAPER, integrator="Euler"))
    with viscous_friction():
        expected = final_state(model, 20)
    mujoco.set_mjcb_passive(user)
    try:
        with viscous_friction():
            assert isinstance(mujoco.get_mjcb_passive(), ctypes._CFuncPtr)
            mujoco.MjModel.from_xml_string(
                "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
            )
            before = calls[0]
            np.testing.assert_array_equal(final_state(model, 20), expected)
            assert calls[0] - before == 20
            batch = mujoco.batch.Batch(model, nsim=3, nthread=1)
            batch.qvel = np.tile(np.linspace(-1, 1, model.nv), (3, 1))
            before = calls[0]
            batch.step(nstep=20)
            np.testing.assert_array_equal(np.hstack([batch.qpos, batch.qvel]), np.tile(expected, (3, 1)))
            assert calls[0] - before == 60
        assert mujoco.get_mjcb_passive() is user
        before = calls[0]
        mujoco.mj_step(model, mujoco.MjData(model))
        assert calls[0] == before + 1
    finally:
        mujoco.set_mjcb_passive(None)
    with viscous_friction():  # and nobody calls it any more
        before = calls[0]
        np.testing.assert_array_equal(final_state(model, 20), expected)
        assert calls[0] == before


def test_a_users_python_callback_runs_for_its_models_also():
    seen = []
    foreign = mujoco.MjModel.from_xml_string(
        "<mujoco model='theirs'><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
    )
    mujoco.set_mjcb_passive(lambda model, data: seen.append(model.nv))
    try:
        with viscous_friction():
            mujoco.mj_step(foreign, mujoco.MjData(foreign))
        assert seen
        assert set(seen) == {foreign.nv}
    finally:
        mujoco.set_mjcb_passive(None)


def test_copied_and_pickled_environments_go_on_bit_for_bit(suite):
    env = suite.load("swim3", {"random": 0})
    env.reset()
    physics = env.physics
    copies = [physics.copy(), copy.deepcopy(physics), pickle.loads(pickle.dumps(physics))]
    with physics.reset_context():
        physics.data.qvel[:] = 1.0
    for other in copies:
        with other.reset_context():
            other.data.qvel[:] = 1.0
    physics.step(50)
    expected = physics.state_vector()
    physics.free()
    for other in copies:  # the friction is theirs too, though the first has let go of it
        other.step(50)
        np.testing.assert_array_equal(other.state_vector(), expected)
        assert np.abs(other.data.qfrc_passive).max() > 0.01
    del env, physics, copies, other


def swim(env):
    """Where an environment is after 20 steps."""
    env.reset()
    for _ in range(20):
        env.step(np.full(2, 0.5))
    return env.physics.state_vector()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_has_the_friction_even_if_forked_while_threads_enter_scopes(suite):
    env = suite.load("swim3", {"random": 0})
    stop = threading.Event()

    def enter_and_leave():
        while not stop.is_set():
            with viscous_friction():
                pass

    threads = [threading.Thread(target=enter_and_leave) for _ in range(4)]
    for thread in threads:
        thread.start()
    children = []
    for _ in range(10):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            status = 1
            try:
                with viscous_friction():
                    os.write(write, swim(env).tobytes())
                status = 0
            finally:
                os._exit(status)
        os.close(write)
        children.append((child, read))
    stop.set()
    for thread in threads:
        thread.join()
    expected = swim(env)
    for child, read in children:
        found = os.read(read, 4096)
        assert os.waitpid(child, 0)[1] == 0
        np.testing.assert_array_equal(np.frombuffer(found), expected)
        os.close(read)
    del env


_CHILD = """
import pickle, sys
import numpy as np
env = pickle.load(sys.stdin.buffer)
import mujoco
assert mujoco.get_mjcb_passive() is not None
for _ in range(20):
    env.step(np.full(2, 0.5))
sys.stdout.buffer.write(env.physics.state_vector().tobytes())
"""


def test_an_environment_pickled_into_another_process_swims_on_there(suite):
    """What spawn does: a new interpreter that is given the pickled environment."""
    env = suite.load("swim3", {"random": 0})
    env.reset()
    pickled = pickle.dumps(env)
    for _ in range(20):
        env.step(np.full(2, 0.5))
    expected = env.physics.state_vector()
    del env
    child = subprocess.run([sys.executable, "-c", _CHILD], input=pickled, capture_output=True, check=False)
    assert child.returncode == 0, child.stderr.decode()
    np.testing.assert_array_equal(np.frombuffer(child.stdout), expected)
