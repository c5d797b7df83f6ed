import gc
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation import random_parameters
from swimmer_mj.viscous import viscous_friction


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
