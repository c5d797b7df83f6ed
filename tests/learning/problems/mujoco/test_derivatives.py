"""Jacobians of MuJoCo's step, held against central differences in Python and against the paper's equations."""

import mujoco
import numpy as np
import pytest
import torch

from swimmer_mj import PAPER, SwimmerParameters
from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import from_qpos_qvel, to_qpos_qvel
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.learning.problems.forms import CoordinatesForm, TorchForm
from swimmer_mj.learning.problems.mujoco import MujocoProblem, Starts
from swimmer_mj.learning.problems.mujoco.implicit import once
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.mjcf import mjcf

DT = 0.01


def random_tree(seed):
    """A model of 3 to 6 bodies: hinges, slides, balls, springs, dampers, any actuator that is affine; half in fluid.

    Some bodies are free.
    """
    rng = np.random.default_rng(seed)
    bodies, joints = int(rng.integers(3, 7)), []
    children = {k: [] for k in range(-1, bodies)}
    for k in range(bodies):
        children[int(rng.integers(-1, k)) if k else -1].append(k)

    def vector(size=3):
        return " ".join(f"{value:.4f}" for value in rng.uniform(-1, 1, size))

    def body(k):
        kind = rng.choice(
            ["hinge", "slide", "ball", "free"] if k in children[-1] else ["hinge", "slide", "ball"]
        )
        soft = f'stiffness="{rng.uniform(0, 5):.3f}" damping="{rng.uniform(0, 2):.3f}"'
        turns_about = kind in ("hinge", "slide")
        axis = f'axis="{vector()}"' if turns_about else ""
        if turns_about:
            joints.append(f"j{k}")
        return (
            f'<body name="b{k}" pos="{vector()}"><joint name="j{k}" type="{kind}" {axis} {soft} armature="0.05"/>'
            f'<geom type="capsule" fromto="0 0 0 {vector()}" size="0.1" contype="0" conaffinity="0"/>'
            f'<site name="s{k}" pos="{vector()}"/>' + "".join(body(c) for c in children[k]) + "</body>"
        )

    world = "".join(body(k) for k in children[-1])
    if not joints:
        return random_tree(seed + 1000)
    limits = 'ctrllimited="true" ctrlrange="-1 2"'
    moved = [str(joint) for joint in rng.choice(joints, 4)]
    actuators = (
        f'<motor joint="{moved[0]}" gear="3" {limits}/><position joint="{moved[1]}" kp="2" {limits}/>'
        f'<velocity joint="{moved[2]}" kv="0.5" {limits}/><motor tendon="t" gear="2" {limits}/>'
        f'<general joint="{moved[3]}" dyntype="filter" dynprm="0.1" gainprm="2" {limits}/>'
        f'<general joint="{moved[0]}" dyntype="integrator" gainprm="1.5" actlimited="false" {limits}/>'
    )
    second = f'<joint joint="{moved[3]}" coef="-1.2"/>' if moved[3] != moved[0] else ""
    integrator = rng.choice(["Euler", "implicit", "implicitfast", "RK4"])
    density, viscosity = rng.integers(2) * rng.uniform(0, [50, 1])
    return (
        f'<mujoco><option timestep="{DT}" density="{density:.2f}" viscosity="{viscosity:.2f}" '
        f'integrator="{integrator}"/><worldbody>{world}</worldbody>'
        f'<tendon><fixed name="t"><joint joint="{moved[0]}" coef="0.7"/>{second}'
        f"</fixed></tendon><actuator>{actuators}</actuator>"
        f'<sensor><framelinvel name="v" objtype="site" objname="s0"/></sensor></mujoco>'
    )


def reward(scene):
    """Reads positions, an orientation and a velocity sensor."""
    return (
        torch.sin(scene.site("s0")).sum(1)
        + scene.body_frame("b1")[:, 2, 0]
        + scene.sensor("v").square().sum(1)
        + scene.qvel.square().sum(1)
    )


class ByHand:
    """mj_step in Python, on a copy of the model as a learner steps it."""

    def __init__(self, problem):
        self.problem = problem
        self.model = mujoco.MjModel.from_xml_string(problem.xml)
        option, kinds = self.model.opt, mujoco.mjtIntegrator
        if option.integrator in (int(kinds.mjINT_RK4), int(kinds.mjINT_EULER)):
            fluid = option.density > 0 or option.viscosity > 0
            option.integrator = int(kinds.mjINT_IMPLICITFAST if fluid else kinds.mjINT_EULER)
        self.data = mujoco.MjData(self.model)

    def place(self, x, dof=None, epsilon=0.0):
        """The state x, moved by epsilon in a tangent direction: position, then velocity, then activation."""
        model, data, co = self.model, self.data, self.problem.layout.coordinates
        data.qpos[:] = model.qpos0
        data.qpos[co.scalar_qpos] = x[co.scalar_row]
        for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
            data.qpos[start : start + 4] = x[row : row + 4]
        data.qvel[co.velocity_dof] = x[co.velocity_row]
        data.act[:] = x[co.activation_row]
        if dof is None:
            return
        nv = model.nv
        if dof < nv:
            mujoco.mj_integratePos(model, data.qpos, np.eye(nv)[dof], epsilon)
        elif dof < 2 * nv:
            data.qvel[dof - nv] += epsilon
        else:
            data.act[dof - 2 * nv] += epsilon

    def objective(self, x, u, weights, dof, epsilon, dt):
        """weights . x(t + dt) + dt (reward - what u costs), at a state that is moved."""
        self.place(x, dof, epsilon)
        self.data.ctrl[:] = self.problem.ctrl(u)
        mujoco.mj_forward(self.model, self.data)
        data = self.data
        velocity = np.array(data.sensor("v").data)
        r = np.sin(data.site("s0").xpos).sum() + data.body("b1").xmat[6] + velocity @ velocity
        r += data.qvel @ data.qvel - 0.1 * (u @ u)
        mujoco.mj_step(self.model, data)
        co, y = self.problem.layout.coordinates, np.zeros(self.problem.state_size)
        y[co.scalar_row] = data.qpos[co.scalar_qpos]
        for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
            y[row : row + 4] = data.qpos[start : start + 4]
        y[co.velocity_row] = data.qvel[co.velocity_dof]
        y[co.activation_row] = data.act
        return weights @ y + dt * r


def tangent(problem, x, g):
    """A slope g of x in MuJoCo's tangent space: positions, velocities, activations."""
    co, nv = problem.layout.coordinates, problem.model.nv
    out = np.zeros(2 * nv + problem.model.na)
    out[co.scalar_dof] = g[co.scalar_row]
    for row, dof in zip(co.quaternion_row, co.quaternion_dof, strict=True):
        for k, unit in enumerate(np.eye(3)):
            turned = np.zeros(4)
            mujoco.mju_mulQuat(turned, x[row : row + 4], np.concatenate([[0], unit / 2]))
            out[dof + k] = g[row : row + 4] @ turned
    out[nv + co.velocity_dof] = g[co.velocity_row]
    out[2 * nv :] = g[co.activation_row]
    return out


WATER = 'density="40" viscosity="0.3" wind="0.5 -1 0.3" integrator="implicitfast"'


def tree_in_a_fluid(seed, fluid=WATER, extra=""):
    """A chain with a branch, of hinges and slides, on which one factor serves for all derivatives of a step."""
    rng = np.random.default_rng(seed)

    def vector(low=-1):
        return " ".join(f"{value:.4f}" for value in rng.uniform(low, 1, 3))

    def body(k, inside=""):
        kind = "slide" if k == seed % 3 else "hinge"
        limits = 'limited="true" range="-0.3 0.4"' if k == 2 else ""
        return (
            f'<body name="b{k}" pos="{vector()}"><joint name="j{k}" type="{kind}" axis="{vector()}" armature="0.05" '
            f'stiffness="{rng.uniform(0, 5):.3f}" damping="{rng.uniform(0, 0.1):.3f}" {limits}/>'
            f'<geom type="box" size="{vector(0.2)}" mass="{rng.uniform(0.1, 1):.3f}" contype="0" conaffinity="0"/>'
            f'<site name="s{k}" pos="{vector()}"/>{inside}</body>'
        )

    limits = 'ctrllimited="true" ctrlrange="-1 2"'
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{DT}" {fluid}/>'
        f"<worldbody>{body(0, body(1, body(2)) + body(3))}</worldbody>"
        f'<tendon><fixed name="t"><joint joint="j0" coef="0.7"/><joint joint="j3" coef="-1"/></fixed></tendon>'
        f'<actuator><motor joint="j1" gear="3" {limits}/><motor tendon="t" {limits}/>{extra}'
        f'<general joint="j2" dyntype="filter" dynprm="0.1" gainprm="2" {limits}/></actuator>'
        f'<sensor><framelinvel name="v" objtype="site" objname="s0"/></sensor></mujoco>'
    )


def test_one_factor_is_used_only_where_the_rest_is_the_same_at_all_states():
    def is_used(xml):
        return once(mujoco.MjModel.from_xml_string(xml))

    assert is_used(tree_in_a_fluid(0))
    assert not is_used(tree_in_a_fluid(0, 'integrator="implicitfast"'))  # no fluid
    for other in ("Euler", "implicit"):
        assert not is_used(tree_in_a_fluid(0, f'density="40" integrator="{other}"'))
    for extra in ('<velocity joint="j0" kv="1"/>', '<position joint="j0" kp="1" kv="0.1"/>'):
        assert not is_used(tree_in_a_fluid(0, extra=extra))
    for old, new in (
        ('damping="', 'damping="0.1 '),  # that of a joint grows with its velocity
        ('<fixed name="t"', '<fixed name="t" damping="1"'),
        ('<geom type="box"', '<geom type="box" fluidshape="ellipsoid"'),
        ('type="slide" axis', 'type="ball" axis'),
        ("<worldbody>", '<option><flag damper="disable"/></option><worldbody>'),
    ):
        xml = tree_in_a_fluid(0)
        assert old in xml
        assert not is_used(xml.replace(old, new)), new


def test_what_a_held_control_does_in_a_fluid_is_the_difference_of_two_steps():
    problem = MujocoProblem(tree_in_a_fluid(0), reward, without=(), threads=1)
    x = problem.initial_states(np.random.default_rng(0), 20)
    coast, gain = problem.batch().responses(np.ascontiguousarray(x.T), DT)
    still = problem.step(x, np.zeros((20, 3)), DT)
    assert (coast == still.T).all()
    for k, limit in enumerate(problem.control_limits):
        held = np.zeros((20, 3))
        held[:, k] = 1e-3 * limit
        difference = (problem.step(x, held, DT) - still) / (1e-3 * limit)
        assert np.abs(difference).max() > 0
        assert np.allclose(gain[k].T, difference, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("tree", "controls", "seed"),
    [*((random_tree, 6, seed) for seed in range(8)), *((tree_in_a_fluid, 3, seed) for seed in range(6))],
)
def test_costates_of_random_trees_are_central_differences_of_mj_step(tree, controls, seed):
    xml = tree(seed)
    problem = MujocoProblem(xml, reward, control_cost=[0.1] * controls, without=(), threads=1)
    problem.xml = xml
    rng = np.random.default_rng(seed)
    N, p, q = 4, problem.state_size, len(problem.control_limits)
    x = problem.initial_states(rng, N)
    x[:, problem.layout.coordinates.activation_row] = rng.uniform(-1, 1, (N, problem.model.na))
    u = rng.uniform(-1, 1, (N, q)) * problem.control_limits
    later = rng.normal(size=(N, p))
    y = problem.step(x, u, DT)
    X, slopes = np.stack([x.T, y.T]), np.stack([np.zeros((p, N)), later.T])
    out = np.zeros((1, p + 1, N))
    # With s_gamma 0 and infinite s_lambda the costate is later . F + dt dr/dx.
    problem.batch().targets(X, u.T[None].copy(), np.zeros((2, N)), slopes, DT, 0.0, np.inf, out)
    hand, epsilon = ByHand(problem), 1e-5
    for n in range(N):
        expected = [
            (
                hand.objective(x[n], u[n], later[n], dof, epsilon, DT)
                - hand.objective(x[n], u[n], later[n], dof, -epsilon, DT)
            )
            / (2 * epsilon)
            for dof in range(2 * problem.model.nv + problem.model.na)
        ]
        scale = 1 + np.abs(expected).max()
        assert np.allclose(tangent(problem, x[n], out[0, :p, n]), expected, rtol=0, atol=1e-5 * scale)


def test_the_random_trees_have_joints_of_all_kinds():
    found = [mujoco.MjModel.from_xml_string(random_tree(seed)).jnt_type for seed in range(8)]
    for kind in ("FREE", "BALL", "SLIDE", "HINGE"):
        number = int(getattr(mujoco.mjtJoint, f"mjJNT_{kind}"))
        assert sum(number in types for types in found) >= 3, kind


def test_steps_and_drift_of_random_trees_are_mujocos():
    for seed in range(8):
        xml = random_tree(seed)
        problem = MujocoProblem(xml, reward, without=(), threads=1)
        problem.xml = xml
        rng, co = np.random.default_rng(seed), problem.layout.coordinates
        x = problem.initial_states(rng, 3)
        u = rng.uniform(-1, 1, (3, 6)) * problem.control_limits
        y, (a, B) = problem.step(x, u, DT), problem.drift_and_control_matrix(x)
        hand = ByHand(problem)
        for n in range(3):
            hand.place(x[n])
            hand.data.ctrl[:] = problem.ctrl(u[n])
            mujoco.mj_forward(hand.model, hand.data)
            f = a[n] + B[n] @ u[n]
            scale = 1 + np.abs(f).max()
            assert np.allclose(f[co.velocity_row], hand.data.qacc[co.velocity_dof], rtol=0, atol=1e-9 * scale)
            assert np.allclose(f[co.activation_row], hand.data.act_dot, rtol=0, atol=1e-9 * scale)
            mujoco.mj_step(hand.model, hand.data)
            assert np.allclose(y[n][co.scalar_row], hand.data.qpos[co.scalar_qpos], rtol=0, atol=1e-12)
            for row, start in zip(co.quaternion_row, co.quaternion_qpos, strict=True):
                assert np.allclose(y[n][row : row + 4], hand.data.qpos[start : start + 4], rtol=0, atol=1e-12)
            assert np.allclose(
                y[n][co.velocity_row], hand.data.qvel[co.velocity_dof], rtol=0, atol=1e-9 * scale
            )


# The paper's swimmer ----------------------------------------------------------------------------------------------


def swimming(friction, parameters=PAPER, **options):
    """The swimmer as a MuJoCo problem, with the velocity of its centre of mass as reward."""
    n, m, l = parameters.n_links, torch.tensor(parameters.masses), torch.tensor(parameters.lengths)

    def draw(rng, count):
        full = st.expand(parameters, random_initial_state(rng, n, size=count))
        return Starts(*to_qpos_qvel(full, n))

    def reward(scene):
        theta, omega = torch.cumsum(scene.qpos[:, 2:], 1), torch.cumsum(scene.qvel[:, 2:], 1)
        across = -l * torch.sin(theta) * omega
        joints = scene.qvel[:, :1] + torch.cumsum(across, 1) - across
        return ((joints + across / 2) * m).sum(1) / m.sum()

    model = mujoco.MjModel.from_xml_string(mjcf(parameters, friction=friction))
    return MujocoProblem(model, reward, draw=draw, **options)


UNEQUAL = SwimmerParameters(n_links=4, mass=[1.0, 0.5, 2.0, 1.0], length=[1.0, 0.7, 1.2, 0.4])


@pytest.mark.parametrize("parameters", [PAPER, UNEQUAL], ids=["paper", "unequal"])
@pytest.mark.parametrize("friction", ["callback", "actuators"])
def test_the_swimmers_drift_and_control_matrix_are_those_of_the_paper(friction, parameters):
    problem, n = swimming(friction, parameters), parameters.n_links
    assert set(problem.layout.names) >= {"hinge_1", "slide_x'"}
    assert "slide_x" not in problem.layout.names  # where it is does not matter, and this was found out
    x = problem.initial_states(np.random.default_rng(3), 50)
    a, B = problem.drift_and_control_matrix(x)
    qpos = np.concatenate([np.zeros((50, 2)), x[:, :n]], axis=1)
    expected, matrix = AnalyticSwimmer(parameters).drift_and_control_matrix(from_qpos_qvel(qpos, x[:, n:]))
    for found, right in ((a[:, n:, None], expected[:, n + 2 :, None]), (B[:, n:], matrix[:, n + 2 :] * 5.0)):
        absolute = found.copy()
        absolute[:, 2:] = np.cumsum(found[:, 2:], axis=1)  # accelerations of absolute angles
        assert np.allclose(absolute, right, rtol=1e-10, atol=1e-10 * np.abs(right).max())


def step_of_the_paper(x, u):
    """MuJoCo's semi-implicit Euler step, with accelerations of A.3."""
    qpos = np.concatenate([np.zeros((len(x), 2)), x[:, :5]], axis=1)
    acceleration = AnalyticSwimmer(PAPER).derivative(from_qpos_qvel(qpos, x[:, 5:]), 5.0 * u)[:, 7:]
    acceleration[:, 3:] -= acceleration[:, 2:-1].copy()
    velocity = x[:, 5:] + DT * acceleration
    return np.concatenate([x[:, :5] + DT * velocity[:, 2:], velocity], axis=1)


def step_of_the_built_in_swimmer(x, u):
    """The same step in torch, with accelerations of the equations that the swimmer itself is learned from."""
    swimmer = Swimming(PAPER, coordinates="joints")
    form, joints = swimmer.form(TorchForm), swimmer.form(CoordinatesForm)
    state = joints.leave(torch.cat([x[:, :5], x[:, 7:], x[:, 5:7]], dim=1))
    f = form.drift(state) + (form.control_matrix(state) @ (5.0 * u)[..., None])[..., 0]
    change = (torch.func.vmap(torch.func.jacrev(joints.enter))(state) @ f[..., None])[..., 0]
    velocity = x[:, 5:] + DT * torch.cat([change[:, 10:], change[:, 5:10]], dim=1)
    return torch.cat([x[:, :5] + DT * velocity[:, 2:], velocity], dim=1)


def by_central_differences(x, u, later):
    """later . dF/dx with F the step of the paper, (N, 12)."""
    expected, epsilon = np.empty_like(x), 1e-5
    for j, unit in enumerate(np.eye(12)):
        ahead, behind = (step_of_the_paper(x + sign * epsilon * unit, u) for sign in (1, -1))
        expected[:, j] = (later * (ahead - behind)).sum(axis=1) / (2 * epsilon)
    return expected


def by_the_built_in_equations(x, u, later):
    """The same, exactly: by automatic differentiation."""
    held = torch.from_numpy(u)
    pull_back = torch.func.vjp(lambda y: step_of_the_built_in_swimmer(y, held), torch.from_numpy(x))[1]
    return pull_back(torch.from_numpy(later))[0].numpy()


@pytest.mark.parametrize(
    ("statement", "centred", "tolerance"),
    [
        (by_central_differences, False, 1e-6),
        (by_central_differences, True, 1e-7),
        (by_the_built_in_equations, False, 1e-6),
        (by_the_built_in_equations, True, 2e-8),
    ],
)
@pytest.mark.parametrize("friction", ["callback", "actuators"])
def test_the_swimmers_jacobian_is_that_of_its_equations(friction, statement, centred, tolerance):
    """MuJoCo's, by finite differences: held against A.3, and against the exact Jacobian of the built-in swimmer."""
    problem = swimming(friction)
    rng, N = np.random.default_rng(5), 16
    x = problem.initial_states(rng, N)
    u, later = rng.uniform(-1, 1, (N, 4)), rng.normal(size=(N, 12))
    y = step_of_the_paper(x, u)
    assert np.allclose(problem.step(x, u, DT), y, rtol=0, atol=1e-12)
    built_in = step_of_the_built_in_swimmer(torch.from_numpy(x), torch.from_numpy(u))
    assert np.allclose(built_in, y, rtol=0, atol=1e-12)
    out = np.zeros((1, 13, N))
    X, slopes = np.stack([x.T, y.T]), np.stack([np.zeros((12, N)), later.T])
    batch = problem.batch(centred=centred)
    batch.targets(X, u.T[None].copy(), np.zeros((2, N)), slopes, DT, 0.0, np.inf, out)
    state = torch.from_numpy(x).requires_grad_()
    rate, _ = problem.rate(state, torch.from_numpy(problem.read(x)))  # which reads the state alone
    (reward_slope,) = torch.autograd.grad(rate.sum(), state)
    expected = statement(x, u, later)
    found = out[0, :12].T - DT * reward_slope.numpy()
    assert np.allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_the_number_of_threads_changes_no_bit():
    def costates(threads):
        problem = swimming("callback", threads=threads)
        rng = np.random.default_rng(7)
        x, u = problem.initial_states(rng, 32).T.copy(), rng.uniform(-1, 1, (3, 4, 32))
        X = [x]
        for held in u:
            X.append(problem.step(X[-1].T, held.T, DT).T.copy())
        out = np.zeros((3, 13, 32), np.float32)
        problem.batch().targets(
            np.stack(X), u, rng.normal(size=(4, 32)), rng.normal(size=(4, 12, 32)), DT, 1.0, 1.0, out
        )
        return out

    assert (costates(1) == costates(3)).all()
