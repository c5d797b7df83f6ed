"""The callback that all laws share, seen by way of the viscous friction."""

import gc
import threading

import mujoco
import mujoco.batch
import mujoco.rollout
import numba
import numpy as np
import pytest

from swimmer_mj.compiled.pointers import pointer
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.passive import callback
from swimmer_mj.viscous import acquire, hold, release, viscous_friction


def swimmer_model():
    return mujoco.MjModel.from_xml_string(mjcf(PAPER))


def moving_data(model, seed=0):
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    data.qpos[:] = rng.uniform(-3, 3, model.nq)
    data.qvel[:] = rng.uniform(-3, 3, model.nv)
    data.ctrl[:] = rng.uniform(-1, 1, model.nu)
    return data


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
        monkeypatch.setattr(callback, "mujoco", Collecting())

    gc.disable()
    yield hold_in_a_cycle
    gc.enable()


def test_the_last_holder_may_be_collected_while_another_acquires(collected_while_acquiring):
    collected_while_acquiring()
    model = swimmer_model()
    data = moving_data(model)
    with (
        viscous_friction()
    ):  # which would call itself without end if it took itself for a callback to call before
        mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_passive).max() > 1
    assert mujoco.get_mjcb_passive() is None


def test_the_last_holder_may_be_collected_while_another_is_refused(collected_while_acquiring):
    def other(model, data):
        pass

    collected_while_acquiring()
    mujoco.set_mjcb_passive(other)
    with pytest.raises(
        RuntimeError, match=r"was replaced while laws were in force .'swimmer_mj.viscous_friction'.;"
    ):
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
        numba.carray(pointer(address), 1, np.float64)[0] += 1

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
    with pytest.raises(
        RuntimeError, match=r"was replaced while laws were in force .'swimmer_mj.viscous_friction'.;"
    ):
        acquire()
    release()
    assert mujoco.get_mjcb_passive() is other
    mujoco.set_mjcb_passive(None)


def test_environments_do_not_go_on_when_it_was_replaced():
    """As by None, by a library that cleans up: they would go on without friction."""
    gymnasium = pytest.importorskip("swimmer_mj.environments.gymnasium")
    vector = pytest.importorskip("swimmer_mj.environments.vector")
    env, envs = gymnasium.SwimmerEnv("swim3"), vector.SwimmerVectorEnv("swim3", 2)
    action = np.zeros(2, np.float32)
    uses = [env.reset, lambda: env.step(action), envs.reset, lambda: envs.step(np.stack([action] * 2))]
    for use in uses:
        use()
    installed = mujoco.get_mjcb_passive()
    mujoco.set_mjcb_passive(None)
    for use in uses:
        with pytest.raises(RuntimeError, match="was replaced while laws were in force"):
            use()
    mujoco.set_mjcb_passive(installed)
    for use in uses:
        use()
    env.close()
    envs.close()
