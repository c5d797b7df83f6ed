import ctypes
import gc
import os
import subprocess
import sys
import threading

import mujoco
import mujoco.batch
import mujoco.rollout
import numba
import numpy as np
import pytest

from swimmer_mj import viscous
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation import random_parameters
from swimmer_mj.viscous import acquire, hold, release, viscous_friction


@pytest.fixture(autouse=True)
def no_trace():
    gc.collect()  # environments that earlier tests dropped
    assert mujoco.get_mjcb_passive() is None
    yield
    gc.collect()
    left = mujoco.get_mjcb_passive()
    mujoco.set_mjcb_passive(None)
    assert left is None


def swimmer_model(parameters=PAPER, **kwargs):
    return mujoco.MjModel.from_xml_string(mjcf(parameters, **kwargs))


def moving_data(model, seed=0):
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    data.qpos[:] = rng.uniform(-3, 3, model.nq)
    data.qvel[:] = rng.uniform(-3, 3, model.nv)
    data.ctrl[:] = rng.uniform(-1, 1, model.nu)
    return data


def rod_friction(model, data, site, k, length):
    """The oracle: A.2's force, summed by Gauss points along the rod, each through MuJoCo's Jacobian there."""
    nodes, weights = np.polynomial.legendre.leggauss(2)  # exact: force linear, moment quadratic in the place
    t = data.site_xmat[site].reshape(3, 3)[:, 2]
    jacobian = np.zeros((3, model.nv))
    total = np.zeros(model.nv)
    for node, weight in zip(nodes, weights, strict=True):
        point = data.site_xpos[site] + node * length / 2 * t
        mujoco.mj_jac(model, data, jacobian, None, point, model.site_bodyid[site])
        v = jacobian @ data.qvel
        total += jacobian.T @ (-k * weight * length / 2 * (v - (v @ t) * t))
    return total


@pytest.mark.parametrize("n_links", [1, 2, 3, 5, 8])
def test_is_the_friction_of_a2_integrated_along_the_links(n_links):
    parameters = random_parameters(np.random.default_rng(n_links), n_links)
    model = swimmer_model(parameters)
    for seed in range(20):
        data = moving_data(model, seed)
        with viscous_friction():
            mujoco.mj_forward(model, data)
        expected = sum(
            rod_friction(model, data, i, parameters.viscous_friction, parameters.lengths[i])
            for i in range(n_links)
        )
        np.testing.assert_allclose(
            data.qfrc_passive, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max()
        )


def test_is_in_force_in_forward_step_inverse_and_nowhere_outside():
    model = swimmer_model()
    data = moving_data(model)

    def passive_forces():
        forces = []
        for function in (mujoco.mj_forward, mujoco.mj_inverse, mujoco.mj_step1, mujoco.mj_step):
            function(model, data)
            forces.append(np.abs(data.qfrc_passive).max())
        return forces

    assert max(passive_forces()) == 0
    with viscous_friction():
        assert min(passive_forces()) > 1
    assert max(passive_forces()) == 0


FOREIGN = """
<mujoco>
  <option density="1000" viscosity="0.1"/>
  <worldbody>
    <body name="a">
      <joint name="a" damping="0.1" stiffness="0.3"/>
      <geom name="a" type="capsule" fromto="0 0 0 .5 0 0" size=".05"/>
      <site name="a" type="capsule" fromto="0 0 0 .5 0 0" size=".05"/>
      <body name="b" pos=".5 0 0">
        <joint name="b" axis="0 1 0"/><geom name="b" type="capsule" fromto="0 0 0 .5 0 0" size=".05"/>
      </body>
    </body>
  </worldbody>
  <custom>
    <numeric name="swimmer_mj.viscous_friction" data="7"/>
    <tuple name="friction"><element objtype="site" objname="a" prm="7"/></tuple>
    <tuple name="swimmer_mj.viscous_friction2"><element objtype="site" objname="a" prm="7"/></tuple>
  </custom>
</mujoco>
"""


def test_another_model_moves_bit_for_bit_as_without_a_swimmer():
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)
    swimmer = swimmer_model()

    def trajectory(beside=None):
        data = moving_data(foreign)
        states = []
        for _ in range(200):
            mujoco.mj_step(foreign, data)
            if beside is not None:
                mujoco.mj_step(swimmer, beside)
            states.append(np.concatenate([data.qpos, data.qvel, data.qfrc_passive]))
        return np.array(states)

    alone = trajectory()
    with viscous_friction():
        data = moving_data(swimmer)
        beside = trajectory(data)
        assert np.abs(data.qfrc_passive).max() > 0
    np.testing.assert_array_equal(beside, alone)


def test_copies_and_pickles_of_a_model_keep_the_friction():
    import copy
    import pickle

    model = swimmer_model()
    for other in (copy.copy(model), copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        del model
        model = other
        data = moving_data(model)
        with viscous_friction():
            mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_passive).max() > 1


PARENT = """
<mujoco>
  <option timestep=".01" integrator="RK4" gravity="0 0 0"/>
  <visual><map zfar="200"/></visual>
  <worldbody>
    <body name="buoy" pos="1 2 3" euler="40 50 60">
      <freejoint name="buoy"/>
      <geom name="buoy" size=".2"/>
      <site name="deck" pos=".1 .2 .3"/>
    </body>
    <site name="berth" pos="5 5 5" euler="10 20 30"/>
  </worldbody>
</mujoco>
"""


def test_acts_on_swimmers_attached_in_a_larger_model():
    """Two of them, in space, one on a body that moves: each rod feels A.2's integral along it."""
    parent = mujoco.MjSpec.from_string(PARENT)
    swimmers = {
        place: SwimmerParameters(3, length=[1.0, 0.5, 2.0], viscous_friction=k)
        for place, k in (("deck", 3.0), ("berth", 5.0))
    }
    for place, p in swimmers.items():
        child = mujoco.MjSpec.from_string(mjcf(p))
        child.delete(child.body("target"))
        child.delete(child.geom("ground"))
        parent.attach(child, prefix=f"{place}/", site=parent.site(place))
    model = parent.compile()
    data = moving_data(model, 3)
    with viscous_friction():
        mujoco.mj_forward(model, data)
    expected = np.zeros(model.nv)
    for place, p in swimmers.items():
        for i in range(3):
            site = model.site(f"{place}/rod_{i + 1}").id
            expected += rod_friction(model, data, site, p.viscous_friction, p.lengths[i])
    np.testing.assert_allclose(data.qfrc_passive, expected, rtol=1e-10, atol=1e-10)


def test_many_threads_step_as_one():
    model = swimmer_model()

    def final_state(seed):
        data = moving_data(model, seed)
        for _ in range(50):
            mujoco.mj_step(model, data)
        return np.concatenate([data.qpos, data.qvel])

    with viscous_friction():
        expected = [final_state(seed) for seed in range(16)]
        found = [None] * 16

        def work(seed):
            with viscous_friction():
                found[seed] = final_state(seed)

        threads = [threading.Thread(target=work, args=(seed,)) for seed in range(16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    np.testing.assert_array_equal(found, expected)


def test_works_in_mujocos_own_thread_pools():
    model = swimmer_model()
    datas = [moving_data(model, seed) for seed in range(4)]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    initial = np.zeros((4, size))
    for row, data in zip(initial, datas, strict=True):
        mujoco.mj_getState(model, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.stack([np.tile(data.ctrl, (20, 1)) for data in datas])
    with viscous_friction():
        states, _ = mujoco.rollout.rollout(
            model, [mujoco.MjData(model) for _ in range(2)], initial, control, persistent_pool=False
        )
        batch = mujoco.batch.Batch(model, nsim=4, nthread=2)
        for field in ("qpos", "qvel", "ctrl"):
            batch.bind(field)[:] = [getattr(data, field) for data in datas]
        for _ in range(20):
            batch.step()
        for data in datas:
            mujoco.mj_step(model, data, 20)
    expected = np.array([data.qpos for data in datas])
    np.testing.assert_array_equal(states[:, -1, 1 : 1 + model.nq], expected)
    np.testing.assert_array_equal(batch.qpos, expected)


def test_reads_no_array_beyond_its_end():
    code = """
import mujoco
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.viscous import viscous_friction
model = mujoco.MjModel.from_xml_string(mjcf(PAPER))
data = mujoco.MjData(model)
data.qvel[:] = 1
with viscous_friction():
    mujoco.mj_forward(model, data)
print(abs(data.qfrc_passive).max() > 1)
"""
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_scopes_nest_and_end_with_exceptions():
    with viscous_friction():
        installed = mujoco.get_mjcb_passive()
        with pytest.raises(KeyError), viscous_friction():
            raise KeyError
        assert mujoco.get_mjcb_passive() is installed
    assert mujoco.get_mjcb_passive() is None


def test_scopes_of_many_threads_leave_no_trace():
    def work():
        for _ in range(300):
            with viscous_friction():
                assert mujoco.get_mjcb_passive() is not None

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert mujoco.get_mjcb_passive() is None


def test_release_without_acquire_is_refused():
    with pytest.raises(RuntimeError, match="released more often than acquired"):
        release()


def test_is_held_as_long_as_its_owner_lives_or_until_let_go():
    class Owner:
        pass

    first, second = Owner(), Owner()
    hold(first)
    let_go = hold(second)
    let_go()
    let_go()
    assert mujoco.get_mjcb_passive() is not None
    del first
    gc.collect()
    assert mujoco.get_mjcb_passive() is None
    assert second is not None


@pytest.fixture
def collected_while_acquiring(monkeypatch):
    """A function that makes a holder, which a garbage collection inside the next acquire() finds."""

    class Owner:
        pass

    class Collecting:
        def __getattr__(self, name):
            return getattr(mujoco, name)

        def get_mjcb_passive(self):
            found = mujoco.get_mjcb_passive()
            gc.collect()
            return found

    def hold_in_a_cycle():
        owner = Owner()
        owner.itself = owner
        hold(owner)
        monkeypatch.setattr(viscous, "mujoco", Collecting())

    gc.disable()
    yield hold_in_a_cycle
    gc.enable()


def test_the_last_holder_may_be_collected_while_another_acquires(collected_while_acquiring):
    collected_while_acquiring()
    model = swimmer_model()
    data = moving_data(model)
    _, before = viscous._compiled()
    with viscous_friction():
        assert before[0] == 0  # else the friction calls itself without end
        mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_passive).max() > 1
    assert mujoco.get_mjcb_passive() is None


def test_the_last_holder_may_be_collected_while_another_is_refused(collected_while_acquiring):
    def other(model, data):
        pass

    collected_while_acquiring()
    mujoco.set_mjcb_passive(other)
    with pytest.raises(RuntimeError, match="was replaced while the viscous friction was in force"):
        acquire()
    with viscous_friction():  # none holds it any more: the other is there first
        assert mujoco.get_mjcb_passive() is not other
    assert mujoco.get_mjcb_passive() is other
    mujoco.set_mjcb_passive(None)


def test_a_users_python_callback_keeps_running():
    model = swimmer_model()
    data = moving_data(model)
    with viscous_friction():
        mujoco.mj_forward(model, data)
    friction = data.qfrc_passive.copy()

    def push(_, data):
        data.qfrc_passive[0] += 100

    mujoco.set_mjcb_passive(push)
    with viscous_friction():
        mujoco.mj_forward(model, data)
    assert mujoco.get_mjcb_passive() is push
    mujoco.set_mjcb_passive(None)
    friction[0] += 100
    np.testing.assert_allclose(data.qfrc_passive, friction, rtol=1e-14)


def test_a_users_compiled_callback_keeps_running():
    calls = np.zeros(1)
    address = calls.ctypes.data

    @numba.cfunc(numba.types.void(numba.types.voidptr, numba.types.voidptr))
    def count(model, data):
        numba.carray(viscous._pointer(address), 1, np.float64)[0] += 1

    user = count.ctypes
    model = swimmer_model()
    data = moving_data(model)
    mujoco.set_mjcb_passive(user)
    with viscous_friction():
        mujoco.mj_forward(model, data)
    assert mujoco.get_mjcb_passive() is user
    mujoco.set_mjcb_passive(None)
    assert calls[0] == 1
    assert np.abs(data.qfrc_passive).max() > 1


def test_refuses_to_go_on_when_it_was_replaced_and_leaves_the_other_in_place():
    def other(model, data):
        pass

    acquire()
    mujoco.set_mjcb_passive(other)
    with pytest.raises(RuntimeError, match="was replaced while the viscous friction was in force"):
        acquire()
    release()
    assert mujoco.get_mjcb_passive() is other
    mujoco.set_mjcb_passive(None)


def test_misplaced_struct_fields_are_found_before_anything_runs(monkeypatch):
    """One field more in front of the struct, as a version with another layout would have it."""
    layout = viscous._c_struct

    def shifted(declaration):
        struct = layout(declaration)
        if getattr(declaration, "name", "") != "mjData":
            return struct
        return type("Struct", (ctypes.Structure,), {"_fields_": [("new", ctypes.c_void_p), *struct._fields_]})

    monkeypatch.setattr(viscous, "_c_struct", shifted)
    with pytest.raises(RuntimeError, match=r"cannot be used with MuJoCo .*MjData.site_xpos is not where"):
        viscous._records()
