import importlib.resources
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

from swimmer_mj.mjcf import PAPER_MODELS, mjcf, mjcf_file, read_friction, read_parameters
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation import random_parameters
from swimmer_mj.viscous import viscous_friction


def compiled(parameters, **kwargs):
    return mujoco.MjModel.from_xml_string(mjcf(parameters, **kwargs))


@pytest.fixture(params=[1, 2, 3, 5, 8])
def parameters(request):
    return random_parameters(np.random.default_rng(request.param), request.param)


@pytest.mark.parametrize("friction", ["callback", "actuators"])
def test_parameters_survive_the_model_exactly(parameters, friction):
    model = compiled(parameters, friction=friction)
    assert read_parameters(model) == parameters
    assert read_friction(model) == friction


def test_links_are_rods(parameters):
    model = compiled(parameters)
    m, l = parameters.masses, parameters.lengths
    for i in range(parameters.n_links):
        body = model.body(f"link_{i + 1}")
        assert body.mass == m[i]
        assert body.inertia[2] == m[i] * l[i] ** 2 / 12
        np.testing.assert_array_equal(body.ipos, [l[i] / 2, 0, 0])
        np.testing.assert_array_equal(body.iquat, [1, 0, 0, 0])
        np.testing.assert_array_equal(body.pos, [l[i - 1] if i else 0, 0, 0])


def test_inertia_is_that_of_the_rods_also_about_the_first_joint(parameters):
    """What the compiled model does with it: the straight chain's moment of inertia about A_0."""
    model = compiled(parameters)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    m, l = parameters.masses, parameters.lengths
    centers = np.cumsum(l) - l / 2
    np.testing.assert_allclose(M[2, 2], (m * l**2 / 12 + m * centers**2).sum(), rtol=1e-13)
    np.testing.assert_allclose(M[0, 0], m.sum(), rtol=1e-13)


def test_nothing_acts_but_motors(parameters):
    model = compiled(parameters)
    assert (model.opt.density, model.opt.viscosity) == (0, 0)
    np.testing.assert_array_equal(model.opt.gravity, 0)
    for field in ("dof_damping", "dof_armature", "dof_frictionloss", "jnt_stiffness", "jnt_limited"):
        np.testing.assert_array_equal(getattr(model, field), 0)
    np.testing.assert_array_equal(model.geom_contype, 0)
    np.testing.assert_array_equal(model.geom_conaffinity, 0)


def test_motors_have_their_limits_as_gear(parameters):
    model = compiled(parameters)
    assert model.nu == parameters.n_links - 1
    np.testing.assert_array_equal(model.actuator_gear[:, 0], parameters.torque_limits)
    np.testing.assert_array_equal(model.actuator_ctrlrange, np.tile([-1.0, 1.0], (model.nu, 1)))
    for i in range(model.nu):
        assert model.joint(model.actuator_trnid[i, 0]).name == f"hinge_{i + 2}"
        assert model.actuator(i).name == f"motor_{i + 1}"


def test_friction_by_actuators_stands_at_the_links_middles_and_has_no_gain(parameters):
    model = compiled(parameters, friction="actuators")
    n, k, l = parameters.n_links, parameters.viscous_friction, parameters.lengths
    assert model.ntuple == 0  # no declaration that the callback would act on as well
    assert model.nu == n - 1 + 2 * n
    for i in range(n - 1):
        assert model.actuator(i).name == f"motor_{i + 1}"
    for i in range(n):
        site = model.site(f"rod_{i + 1}")
        np.testing.assert_array_equal(site.pos, [l[i] / 2, 0, 0])
        np.testing.assert_array_equal(site.quat, [1, 0, 0, 0])
        for name, gear, coefficient in (
            ("drag", [0, 1, 0, 0, 0, 0], k * l[i]),
            ("spin", [0, 0, 0, 0, 0, 1], k * l[i] ** 3 / 12),
        ):
            actuator = model.actuator(f"{name}_{i + 1}")
            assert actuator.trntype == mujoco.mjtTrn.mjTRN_SITE
            assert actuator.trnid[0] == site.id
            assert actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
            np.testing.assert_array_equal(actuator.gear, gear)
            np.testing.assert_array_equal(actuator.gainprm, 0)
            np.testing.assert_array_equal(actuator.biasprm[:3], [0, 0, -coefficient])


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_a_rod_decays_by_actuators_in_bare_mujoco(integrator):
    """No callback anywhere: m v' = -k l v for a step that is small against m / (k l)."""
    p = SwimmerParameters(1, mass=2.0, length=0.5, viscous_friction=10.0)
    model = compiled(p, friction="actuators", integrator=integrator, timestep=1e-5)
    data = mujoco.MjData(model)
    data.qvel[:2] = 3.0, 1.0
    mujoco.mj_step(model, data, 1000)
    np.testing.assert_allclose(data.qvel, [3.0, np.exp(-2.5 * 0.01), 0.0], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("friction", ["callback", "actuators"])
def test_everything_is_named(parameters, friction):
    root = ET.fromstring(mjcf(parameters, friction=friction))
    unnamed = [
        element.tag
        for section in ("worldbody", "asset", "actuator", "custom")
        for element in root.findall(f"{section}//*")
        if element.tag not in ("inertial", "element") and "name" not in element.attrib
    ]
    assert unnamed == []


def test_cameras_look_down_on_the_swimmer():
    model = compiled(PAPER)
    data = mujoco.MjData(model)
    data.qpos[:2] = 30, -20
    mujoco.mj_forward(model, data)
    tracking = data.camera("tracking")
    np.testing.assert_allclose(tracking.xpos[:2], data.subtree_com[model.body("link_1").id, :2], atol=1e-12)
    for name in ("top", "tracking"):
        np.testing.assert_allclose(data.camera(name).xmat, np.eye(3).ravel(), atol=1e-12)


def test_integrator_and_timestep_are_set():
    model = compiled(PAPER, integrator="Euler", timestep=0.002)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert model.opt.timestep == 0.002
    assert compiled(PAPER).opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"friction": "none"}, "friction must be callback or actuators, got 'none'"),
        ({"integrator": "rk4"}, "integrator must be Euler, RK4, implicit or implicitfast, got 'rk4'"),
        ({"timestep": 0.0}, "timestep must be positive and finite, got 0.0"),
        ({"timestep": float("nan")}, "timestep must be positive and finite, got nan"),
    ],
)
def test_refuses_unknown_integrators_and_bad_timesteps(kwargs, message):
    with pytest.raises(ValueError, match=message):
        mjcf(PAPER, **kwargs)


def test_links_too_light_for_mujoco_are_refused_and_the_lightest_that_are_not_compile():
    for mass, length in ((1e-9, [1.0, 1e-3]), (0.9e-15, 1e3)):
        with pytest.raises(
            ValueError, match=r"above 1e-15, and link 1 of .* kg and .* m has .*; take smaller units"
        ):
            mjcf(SwimmerParameters(2, mass=mass, length=length))
    for mass, length in ((1.1e-15, 1e3), (1.0, 1.1 * np.sqrt(2e-15) / 0.07)):
        compiled(SwimmerParameters(2, mass=mass, length=length))


@pytest.mark.parametrize("name", PAPER_MODELS)
def test_generated_files_are_the_builders_output(name):
    n_links, friction = PAPER_MODELS[name]
    file = importlib.resources.files("swimmer_mj.models").joinpath(name)
    expected = mjcf_file(SwimmerParameters(n_links=n_links), friction)
    assert file.read_text(encoding="utf-8") == expected, "run: python -m swimmer_mj.mjcf"
    assert read_parameters(mujoco.MjModel.from_xml_string(expected)) == SwimmerParameters(n_links=n_links)


def test_other_models_have_no_parameters():
    for read in (read_parameters, read_friction):
        with pytest.raises(ValueError, match="not one swimmer's model"):
            read(mujoco.MjModel.from_xml_string("<mujoco/>"))


def test_denormal_numbers_which_mujoco_cannot_read_are_zero():
    for friction in ("callback", "actuators"):
        model = compiled(SwimmerParameters(2, viscous_friction=2.3e-308), friction=friction)
        assert read_parameters(model).viscous_friction == 2.3e-308
        assert read_parameters(compiled(SwimmerParameters(2, viscous_friction=1e-310))).viscous_friction == 0


def furled(model, seed):
    """The deepest contact (m) and the sharpest bend (rad) in 10 s under torques that change at random."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[3:] = rng.uniform(-1.0, 1.0, model.nv - 3)
    deepest = sharpest = 0.0
    with viscous_friction():
        for step in range(1000):
            if step % 60 == 0:
                data.ctrl[:] = rng.choice([-1.0, 1.0], model.nu)
            mujoco.mj_step(model, data)
            deepest = min([deepest, *data.contact.dist])
            sharpest = max(sharpest, np.abs(data.qpos[3:]).max())
    return deepest, sharpest


@pytest.mark.parametrize("n", [3, 5])
def test_solid_links_do_not_pass_through_each_other(n):
    """Axes of links are apart as long as contacts are less deep than the links are thick."""
    p = SwimmerParameters(n)
    solid, passing = (compiled(p, solid=solid) for solid in (True, False))
    thick = 2 * float(solid.geom("link_1").size[0])
    found = np.array([furled(solid, seed) for seed in range(10)])
    assert found[:, 0].min() > -thick
    assert found[:, 1].max() < np.pi
    assert found[:, 0].min() < 0 or n == 3, "none has met another"
    assert found[:, 1].max() > np.pi - 0.2
    assert max(furled(passing, seed)[1] for seed in range(5)) > np.pi
    assert read_parameters(solid) == p


def test_solid_links_that_do_not_touch_move_as_others():
    rng = np.random.default_rng(0)
    solid, passing = (compiled(PAPER, solid=solid) for solid in (True, False))
    accelerations = []
    qpos, qvel = rng.uniform(-0.5, 0.5, solid.nq), rng.normal(size=solid.nv)
    for model in (solid, passing):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        with viscous_friction():
            mujoco.mj_forward(model, data)
        accelerations.append(data.qacc.copy())
    np.testing.assert_allclose(*accelerations, rtol=1e-12)
