"""The laws of docs/physics.md against statements of the same forces that share nothing with them."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from swimmer_mj.passive import Law

PAGE = (Path(__file__).parents[3] / "docs" / "physics.md").read_text(encoding="utf-8")
EXAMPLES = {
    re.search(r'@law\("(.*?)"\)', code)[1]: code
    for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    if "@law" in code
}

ARM = """
<mujoco>
  <worldbody>
    <body pos="1 2 3" euler="10 20 30">
      <freejoint/>
      <geom size="0.3" mass="2" pos="0.1 0 0.2"/>
      <site name="a" pos="0.2 0.3 0.4" euler="50 60 70"/>
      <body pos="0.5 0 0" euler="0 40 0">
        <joint axis="0 1 1" pos="0.1 0 0"/>
        <joint type="slide" axis="1 0 0"/>
        <geom type="box" size="0.1 0.2 0.3" mass="1"/>
        <site name="b" pos="-0.1 0.3 0.2" euler="-20 0 80"/>
        <body pos="0 0.4 0">
          <geom size="0.1" mass="0.3"/>
          <site name="c" pos="0.1 0 0.1" euler="0 90 10"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def example(name):
    """The law of an example."""
    names = {}
    exec(EXAMPLES[name], names)
    (law,) = (value for value in names.values() if isinstance(value, Law))
    return law


def drag(x, R, v, t, c):
    return -c * np.linalg.norm(v) * v, np.zeros(3)


def spring(x, R, v, t, stiffness, reach, rate):
    return stiffness * (np.array([reach * np.cos(rate * t), 0, 0]) - x), np.zeros(3)


def rotor(x, R, v, t, speed, thrust, torque):
    axis = R @ [0, 0, 1]
    return axis * thrust * speed**2, -axis * torque * speed**2 * np.sign(speed)


CASES = {
    "example.drag": (drag, {"a": [2.0], "c": [0.5]}),
    "example.spring": (spring, {"b": [3.0, 0.7, 5.0]}),
    "example.rotor": (rotor, {"a": [30.0, 1e-2, 1e-3], "b": [-20.0, 2e-2, 3e-3], "c": [10.0, 0.1, 0.2]}),
}


def test_there_are_three_examples_of_15_lines_each():
    assert EXAMPLES.keys() == CASES.keys()
    for code in EXAMPLES.values():
        assert len([line for line in code.splitlines() if line]) <= 15


@pytest.mark.parametrize("name", CASES)
def test_a_law_exerts_what_mj_apply_ft_does(name):
    """Force and moment by NumPy, from MuJoCo's own site velocities; to the joints by MuJoCo's own Jacobians."""
    law, (force, sites) = example(name), CASES[name]
    spec = mujoco.MjSpec.from_string(ARM)
    for site, parameters in sites.items():
        law.declare(spec, site, **dict(zip(law.parameters, parameters, strict=True)))
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(20):
        data.qpos[:] = rng.uniform(-1, 1, model.nq)
        data.qvel[:] = rng.uniform(-3, 3, model.nv)
        data.time = rng.uniform(0, 10)
        with law.in_force():
            mujoco.mj_forward(model, data)
        expected, velocity = np.zeros(model.nv), np.zeros(6)
        for site, parameters in sites.items():
            i = model.site(site).id
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, i, velocity, 0)
            x, R = data.site_xpos[i], data.site_xmat[i].reshape(3, 3)
            F, M = force(x, R, velocity[3:], data.time, *parameters)
            mujoco.mj_applyFT(model, data, F, M, x, model.site_bodyid[i], expected)
        assert np.abs(expected).max() > 0.1
        np.testing.assert_allclose(data.qfrc_passive, expected, rtol=1e-11, atol=1e-11)


def moving(name, gravity="0 0 0"):
    """The simulation of an example, as its page has it after the last step, from the start."""
    names = {}
    exec(EXAMPLES[name], names)
    model = names["data"].model
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 0.01
    model.opt.gravity = [float(g) for g in gravity.split()]
    (law,) = (value for value in names.values() if isinstance(value, Law))
    return law, model, mujoco.MjData(model)


def test_quadratic_drag_slows_a_ball_as_its_solution_does():
    """m v' = -c v^2, so v = v0 / (1 + c v0 t / m)."""
    law, model, data = moving("example.drag")
    data.qvel[:3] = v0 = np.array([3.0, 0.0, 4.0])
    with law.in_force():
        mujoco.mj_step(model, data, 200)
    np.testing.assert_allclose(data.qvel[:3], v0 / (1 + 2 * 5 * 2.0 / 1), rtol=1e-5, atol=1e-12)


def test_a_spring_to_a_moving_point_is_of_the_integrators_order():
    """m x'' = k (r cos t - x) has the solution cos t; a far end held over the step would make RK4 first-order."""
    law, model, data = moving("example.spring")
    errors = []
    for steps in (20, 40):
        mujoco.mj_resetData(model, data)
        model.opt.timestep = 2.0 / steps
        with law.in_force():
            mujoco.mj_step(model, data, steps)
        errors.append(abs(data.qpos[0] - np.cos(2.0)))
    assert 3.5 < np.log2(errors[0] / errors[1]) < 4.5


def test_a_rotor_that_bears_the_weight_hovers_and_turns_the_body_against_it():
    law, model, data = moving("example.rotor", gravity="0 0 -9.81")
    with law.in_force():
        mujoco.mj_step(model, data, 100)
    np.testing.assert_allclose(data.qvel, [0, 0, 0, 0, 0, -1.0], atol=1e-9)
