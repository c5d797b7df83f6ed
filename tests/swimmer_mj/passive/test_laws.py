"""Laws of a user's own: where they act, in what order, and how they fail."""

import functools
import math
import operator
import threading

import mujoco
import mujoco.batch
import mujoco.rollout
import numba
import numpy as np
import pytest

from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER
from swimmer_mj.passive import LawError, Site, law
from swimmer_mj.viscous import friction, viscous_friction


@law("test.push")
def push(site, fx, fy, fz):
    return (fx, fy, fz), (0, 0, 0)


@law("test.drag")
def drag(site, c):
    x, y, z = site.velocity
    return (-c * x, -c * y, -c * z), (0.0, 0.0, 0.0)


@law("test.spin")
def spin(site):
    return (0, 0, 0), site.axes[0]


@law("test.limit")
def limited(site, top):
    if site.velocity[0] > top:
        raise ValueError(f"faster than\n{top} m/s")
    return (0, 0, 0), (0, 0, 0)


@law("test.root")
def root(site, x):
    return (0.0, 0.0, math.sqrt(x)), (0.0, 0.0, 0.0)


BALL = '<body pos="{}"><freejoint/><geom size=".1" mass="2"/><site name="{}"/></body>'


def model_of(custom, sites=("a", "b"), name="balls"):
    bodies = "".join(BALL.format(f"{i} 0 0", site) for i, site in enumerate(sites))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco model="{name}"><option gravity="0 0 0"/><worldbody><site name="fixed"/>{bodies}</worldbody>'
        f"<custom>{custom}</custom></mujoco>"
    )


def declaration(law_name, *elements):
    """A tuple: a site has its prm behind a colon, anything else its type."""
    rows = ""
    for element in elements:
        kind, name, prm = [*element.split(":"), "0"][:3]
        rows += f'<element objtype="{kind}" objname="{name}" prm="{prm}"/>'
    return f'<tuple name="{law_name}">{rows}</tuple>'


DRAGGED = declaration("test.drag", "site:a:3", "site:b:5")


def forces(model, *laws, velocity=1.0):
    data = mujoco.MjData(model)
    data.qvel[:] = velocity
    for one in laws:
        one.acquire()
    try:
        mujoco.mj_forward(model, data)
    finally:
        for one in laws:
            one.release()
    return data.qfrc_passive.copy()


# Where laws act
def test_each_site_has_its_own_parameter():
    np.testing.assert_array_equal(forces(model_of(DRAGGED), drag)[[0, 1, 2, 6, 7, 8]], [-3] * 3 + [-5] * 3)


def test_several_parameters_follow_their_site_and_may_serve_many():
    model = model_of(
        '<numeric name="other" data="9 9 9"/><numeric name="down" data="1 2 -3"/>'
        + declaration("test.push", "site:b", "numeric:down", "site:a", "numeric:down")
    )
    np.testing.assert_array_equal(forces(model, push), [1, 2, -3, 0, 0, 0] * 2)
    model.numeric("down").data[:] = 4, 5, 6  # read at each evaluation
    np.testing.assert_array_equal(forces(model, push), [4, 5, 6, 0, 0, 0] * 2)


def test_a_law_may_have_no_parameter():
    np.testing.assert_allclose(
        forces(model_of(declaration("test.spin", "site:a")), spin)[:6], [0, 0, 0, 1, 0, 0]
    )


def test_a_site_that_cannot_move_is_passed_over():
    model = model_of(declaration("test.drag", "site:fixed:1", "site:a:3"))
    assert forces(model, drag)[0] == -3


def test_several_laws_act_on_one_model_and_each_on_its_own_models():
    both = model_of(DRAGGED + declaration("test.spin", "site:a"))
    one = model_of(declaration("test.spin", "site:a"))
    expected = np.array([-3, -3, -3, 1, 0, 0, -5, -5, -5, 0, 0, 0])
    np.testing.assert_allclose(forces(both, drag, spin), expected)
    np.testing.assert_array_equal(forces(both, spin, drag), forces(both, drag, spin))
    np.testing.assert_allclose(forces(one, drag, spin), [0, 0, 0, 1, 0, 0] + [0] * 6)
    swimmer = mujoco.MjModel.from_xml_string(mjcf(PAPER))
    np.testing.assert_array_equal(forces(swimmer, friction, drag), forces(swimmer, friction))
    assert np.abs(forces(swimmer, friction)).max() > 1
    assert not forces(swimmer, drag).any()


def test_laws_come_and_go_one_by_one():
    model = model_of(DRAGGED + declaration("test.spin", "site:a"))
    data = mujoco.MjData(model)
    data.qvel[:] = 1

    def in_force():
        mujoco.mj_forward(model, data)
        return bool(data.qfrc_passive[0]), bool(data.qfrc_passive[3])

    assert in_force() == (False, False)
    with drag.in_force():
        with spin.in_force():
            assert in_force() == (True, True)
            with viscous_friction(), drag.in_force():
                assert in_force() == (True, True)
        assert in_force() == (True, False)
    assert in_force() == (False, False)


def test_the_sum_of_laws_does_not_depend_on_who_came_first():
    """To the last bit: these add otherwise in another order."""
    names = [
        declaration(f"test.part{i}", f"site:a:{value!r}") for i, value in enumerate((0.1, 0.2, 0.3, 1e16))
    ]
    parts = [law(f"test.part{i}")(lambda site, f: ((f, 0, 0), (0, 0, 0))) for i in range(4)]
    model = model_of("".join(names))
    found = {
        forces(model, *(parts[i] for i in order))[0] for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 3, 0, 1))
    }
    assert found == {0.1 + 0.2 + 0.3 + 1e16}


def test_a_law_is_evaluated_at_the_stages_of_a_step_and_in_thread_pools():
    model = model_of(DRAGGED)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 0.01
    data = mujoco.MjData(model)
    data.qvel[0] = 1
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with drag.in_force():
        rolled, _ = mujoco.rollout.rollout(
            model,
            [mujoco.MjData(model) for _ in range(2)],
            np.tile(state, (3, 1)),
            nstep=100,
            persistent_pool=False,
        )
        batch = mujoco.batch.Batch(model, nsim=3, nthread=2)
        batch.qvel = np.tile(data.qvel, (3, 1))
        batch.step(nstep=100)
        mujoco.mj_step(model, data, 100)
    np.testing.assert_allclose(data.qvel[0], math.exp(-3 / 2), rtol=1e-9)
    velocity = 1 + model.nq
    np.testing.assert_array_equal(rolled[:, -1, velocity], [data.qvel[0]] * 3)
    np.testing.assert_array_equal(batch.qvel[:, 0], [data.qvel[0]] * 3)


def test_a_declaration_follows_an_attached_model():
    child = (
        f"<mujoco><worldbody>{BALL.format('0 0 0', 'a')}</worldbody>"
        f'<custom><numeric name="n" data="1 2 3"/>{declaration("test.push", "site:a", "numeric:n")}</custom></mujoco>'
    )
    parent = mujoco.MjSpec.from_string(
        f"<mujoco><option gravity='0 0 0'/><worldbody><site name='x'/>{BALL.format('0 0 1', 'mine')}</worldbody>"
        '<custom><numeric name="n" data="7 8 9 10"/></custom></mujoco>'
    )
    for prefix in ("left/", "right_"):
        parent.attach(mujoco.MjSpec.from_string(child), prefix=prefix, site=parent.site("x"))
    model = parent.compile()
    np.testing.assert_array_equal(forces(model, push), [0] * 6 + [1, 2, 3, 0, 0, 0] * 2)


def test_declare_writes_what_mjcf_would():
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><option gravity='0 0 0'/><worldbody>{BALL.format('0 0 0', 'a')}{BALL.format('1 0 0', 'b')}"
        "</worldbody></mujoco>"
    )
    push.declare(spec, "a", fz=3, fx=1, fy=2)
    push.declare(spec, "b", fx=4, fy=5, fz=6)
    drag.declare(spec, "b", c=7)
    spin.declare(spec, "a")
    for model in (spec.compile(), mujoco.MjModel.from_xml_string(spec.to_xml())):
        np.testing.assert_allclose(forces(model, push), [1, 2, 3, 0, 0, 0, 4, 5, 6, 0, 0, 0])
        np.testing.assert_allclose(forces(model, drag), [0] * 6 + [-7] * 3 + [0] * 3)
        np.testing.assert_allclose(forces(model, spin)[:6], [0, 0, 0, 1, 0, 0])


def test_a_law_may_use_numpy_and_compiled_functions():
    @numba.njit
    def length(v):
        return np.sqrt(v @ v)

    @law("test.numpy")
    def squared(site, c):
        v = np.array(site.velocity)
        return -c * length(v) * v, np.zeros(3)

    found = forces(model_of(declaration("test.numpy", "site:a:2")), squared)
    np.testing.assert_allclose(found[:3], [-2 * math.sqrt(3)] * 3)


def test_a_law_is_a_function_in_python_too():
    zero = (0.0, 0.0, 0.0)
    site = Site(0.0, zero, ((1, 0, 0), (0, 1, 0), (0, 0, 1)), zero, (1.0, 2.0, 3.0), zero)
    assert drag(site, 2.0) == ((-2.0, -4.0, -6.0), zero)
    assert repr(push) == "<law 'test.push' of fx, fy, fz>"


# How laws fail
def fails(one, model, data=None, evaluate=mujoco.mj_forward):
    """What is said of a law that fails in a scope, and the data."""
    if data is None:
        data = mujoco.MjData(model)
    with pytest.raises(LawError) as caught, one.in_force():
        evaluate(model, data)
    assert "\n" not in str(caught.value)
    assert mujoco.get_mjcb_passive() is None
    return str(caught.value), data


def test_a_law_that_raises_says_so_with_its_own_exception():
    model = model_of(declaration("test.limit", "site:b:2.5"))
    data = mujoco.MjData(model)
    data.qvel[6], data.time = 3.0, 0.25
    with pytest.raises(LawError) as caught, limited.in_force():
        mujoco.mj_forward(model, data)
    assert str(caught.value) == (
        "the law 'test.limit' raised ValueError: faster than 2.5 m/s, at the site 'b' of the model 'balls', time 0.25 s"
    )
    assert isinstance(caught.value.__cause__, ValueError)
    assert np.isnan(data.qfrc_passive[6:]).all()
    assert not data.qfrc_passive[:6].any()


def test_a_law_that_returns_no_number_says_so():
    message, data = fails(root, model_of(declaration("test.root", "site:a:4", "site:b:-1")))
    assert message == (
        "the law 'test.root' returned a force or a moment that is not finite "
        "at the site 'b' of the model 'balls', time 0 s"
    )
    assert data.qfrc_passive[2] == 2
    assert np.isnan(data.qfrc_passive[8])


def test_a_division_by_zero_is_noticed():
    inverse = law("test.inverse")(lambda site, x: ((1 / x, 0, 0), (0, 0, 0)))
    message, _ = fails(inverse, model_of(declaration("test.inverse", "site:a:0")))
    assert "is not finite at the site 'a'" in message


def test_arrays_of_a_wrong_length_are_noticed():
    short = law("test.short")(lambda site: (np.zeros(2), np.zeros(3)))
    message, _ = fails(short, model_of(declaration("test.short", "site:a")))
    assert "has not three components at the site 'a'" in message


@pytest.mark.parametrize(
    ("one", "elements", "says"),
    [
        (drag, ["site:a:1", "body:world"], "element 1 of its tuple 'x/test.drag' must be a site"),
        (drag, ["numeric:three"], "element 0 of its tuple 'x/test.drag' must be a site"),
        (
            push,
            ["site:a", "numeric:three", "site:b", "numeric:two"],
            "element 2 of its tuple 'x/test.push' must be followed by a numeric of 3 numbers (fx, fy, fz)",
        ),
        (
            push,
            ["site:a:1", "site:b:1"],
            "element 0 of its tuple 'x/test.push' must be followed by a numeric of 3",
        ),
        (push, ["site:a"], "element 0 of its tuple 'x/test.push' must be followed by a numeric of 3"),
        (push, ["numeric:three", "site:a"], "element 0 of its tuple 'x/test.push' must be a site"),
        (friction, ["site:a:1"], "must be a site of type capsule"),
    ],
)
def test_a_wrong_declaration_is_noticed_at_the_first_evaluation_and_by_check(one, elements, says):
    model = model_of(
        '<numeric name="two" data="1 2"/><numeric name="three" data="1 2 3"/>'
        + declaration(f"x/{one.name}", *elements)
    )
    message, data = fails(one, model)
    assert message.startswith(f"the law {one.name!r} cannot act on the model 'balls': ")
    assert says in message
    assert np.isnan(data.qfrc_passive).all()
    with pytest.raises(LawError) as caught:
        one.check(model)
    assert str(caught.value) == message


def test_references_that_were_spoilt_later_are_noticed():
    for spoil in (-1, 3):
        model = model_of(DRAGGED)
        model.tuple_objid[1] = spoil
        assert "element 1 of its tuple 'test.drag' must be a site" in fails(drag, model)[0]


def test_a_missing_site_is_noticed_where_it_is_named():
    with pytest.raises(ValueError, match="unrecognized object 'nosuch' in tuple"):
        model_of(declaration("test.drag", "site:nosuch:1"))
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{BALL.format('0 0 0', 'a')}</worldbody></mujoco>")
    with pytest.raises(LawError, match=r"^the law 'test.drag' needs a site named 'nosuch': .* are \['a'\]$"):
        drag.declare(spec, "nosuch", c=1)
    with pytest.raises(
        LawError, match=r"^the law 'test.push' takes finite numbers fx, fy, fz, got {'fx': 1}$"
    ):
        push.declare(spec, "a", fx=1)
    with pytest.raises(LawError, match=r"^the law 'test.drag' takes finite numbers c, got {'c': nan}$"):
        drag.declare(spec, "a", c=math.nan)
    for c in ("heavy", None, [1, 2]):
        with pytest.raises(LawError, match=r"^the law 'test.drag' takes finite numbers c, got {'c': "):
            drag.declare(spec, "a", c=c)
    with pytest.raises(LawError, match=r"needs a site of type capsule, which 'a' is not$"):
        friction.declare(spec, "a", k=1)
    assert not spec.tuples


def test_check_says_if_a_model_does_not_declare_the_law_and_changes_nothing():
    with pytest.raises(
        LawError, match=r"the model 'balls' declares no law 'test.drag': its tuples are \['test.spin'\]"
    ):
        drag.check(model_of(declaration("test.spin", "site:a")))
    model = model_of(declaration("test.limit", "site:a:2"))
    limited.check(model)
    data = mujoco.MjData(model)
    data.qvel[0] = 3
    with pytest.raises(LawError, match="faster than 2"):
        limited.check(model, data)
    assert not data.qfrc_passive.any()
    limited.raise_failure()  # checks are nobody else's failures


def test_a_state_that_is_not_finite_is_no_failure_of_the_law():
    model = model_of(DRAGGED)
    assert np.isnan(forces(model, drag, velocity=math.nan)).any()
    drag.raise_failure()


def test_each_scope_tells_of_the_first_failure_in_it():
    model = model_of(declaration("test.limit", "site:a:2", "site:b:3"))
    data = mujoco.MjData(model)

    def evaluate(*velocities):
        for data.qvel[0], data.qvel[6] in velocities:
            mujoco.mj_forward(model, data)

    with pytest.raises(LawError, match="site 'a'"), limited.in_force():
        evaluate((5, 0), (0, 5))
    with pytest.raises(LawError, match="site 'b'"), limited.in_force():
        evaluate((0, 0), (0, 5), (5, 0))
    with limited.in_force():
        evaluate((0, 0))


def test_an_exception_that_leaves_the_scope_has_a_note():
    data = mujoco.MjData(model_of(declaration("test.limit", "site:a:2")))
    data.qvel[0] = 5

    def fail_and_leave():
        with limited.in_force():
            mujoco.mj_forward(data.model, data)
            raise KeyError

    with pytest.raises(KeyError) as caught:
        fail_and_leave()
    (note,) = caught.value.__notes__
    assert "faster than 2.0 m/s" in note
    with limited.in_force():
        pass


def test_a_failure_outside_scopes_is_told_once_when_asked_for():
    class Owner:
        pass

    owner = Owner()
    data = mujoco.MjData(model_of(declaration("test.limit", "site:a:2")))
    let_go = limited.hold(owner)
    for velocity in (5, 0, 6):
        data.qvel[0] = velocity
        mujoco.mj_forward(data.model, data)
        if velocity:
            with pytest.raises(LawError, match="the model 'balls', time 0 s"):
                limited.raise_failure()
        limited.raise_failure()
    let_go()


def test_a_step_that_fails_is_one_that_mujoco_takes_for_unstable(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log
    model = model_of(declaration("test.root", "site:a:-1"))
    _, data = fails(root, model, evaluate=mujoco.mj_step)
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number > 0


def test_many_threads_may_fail_at_once():
    models = [model_of(declaration("test.limit", f"site:{site}:2"), name=f"model {site}") for site in "ab"]
    messages, start = [[] for _ in range(8)], threading.Barrier(8)

    def work(i):
        data = mujoco.MjData(models[i % 2])
        data.qvel[:] = 5
        start.wait()
        for _ in range(100):
            messages[i].append(fails_in_thread(data)[0])

    def fails_in_thread(data):
        try:
            with limited.in_force():
                for _ in range(20):
                    mujoco.mj_forward(data.model, data)
        except LawError as error:
            return str(error), np.isnan(data.qfrc_passive).any()
        return None, None

    threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for of_thread in messages:
        assert None not in of_thread
        placed = [
            message for message in of_thread if "hid where" not in message
        ]  # which may happen, and is said
        assert placed
        for message in placed:
            assert "faster than 2.0 m/s, at the site" in message
            assert ("'a' of the model 'model a'" in message) != ("'b' of the model 'model b'" in message)


# Laws that are none
def no_vectors(site, c):
    return -c


def two_numbers(site, c):
    return (c, c), (c, c, c)


def tuple_product(site, c):
    return -c * site.velocity, (0, 0, 0)


def unknown_field(site, c):
    return site.speed, (0, 0, 0)


def mixed_array(site, c):
    """At which numba fails without a word."""
    return np.array([[c, c, c], [0, 0, 0]])


def unknown_name(site, c):
    return undefined(site), (0, 0, 0)  # noqa: F821


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (no_vectors, "must return a force and a moment, each of three numbers, but returns float64"),
        (two_numbers, "must return a force and a moment, each of three numbers, but returns .*float64 x 2"),
        (tuple_product, r"does not compile: No implementation .*mul.* \(test_laws.py, line \d+\)"),
        (unknown_field, r"does not compile: Unknown attribute 'speed' .* \(test_laws.py, line \d+\)"),
        (unknown_name, "does not compile: NameError: name 'undefined' is not defined"),
        (mixed_array, "(does not compile|must return a force and a moment)"),  # by numba's version
    ],
)
def test_a_law_that_does_not_compile_says_so_in_a_line_and_is_not_in_force(function, says):
    bad = law("test.bad")(function)
    with pytest.raises(LawError, match=f"^the law 'test.bad' {says}") as caught, bad.in_force():
        pytest.fail("the scope was entered")
    assert "\n" not in str(caught.value)
    assert bad.holders == 0


@pytest.mark.parametrize("name", ["drag", "", ".drag", "lab.", "lab.my drag", "lab.drag\0", no_vectors])
def test_a_name_has_a_dot_inside(name):
    with pytest.raises(ValueError, match="a law's name must have a dot inside and no space"):
        law(name)


@pytest.mark.parametrize("function", [lambda: 0, lambda site, c=1: 0, lambda *site: 0, lambda site, *, c: 0])
def test_a_law_takes_a_site_and_plain_parameters(function):
    with pytest.raises(
        TypeError, match="a law takes the site and its parameters, without defaults or stars, got"
    ):
        law("test.signature")(function)


@pytest.mark.parametrize(
    "function", [numba.njit(no_vectors), functools.partial(no_vectors, c=1.0), operator.neg]
)
def test_a_law_is_made_of_a_function_in_python(function):
    with pytest.raises(
        TypeError, match="a law is made of a function in Python, which it compiles itself, got"
    ):
        law("test.compiled")(function)


def test_a_shape_is_one_of_mujocos():
    with pytest.raises(ValueError, match=r"a law's shape must be one of sphere, .* or None, got 'rod'"):
        law("test.shape", shape="rod")


def test_laws_that_would_claim_one_tuple_are_not_let_in_together():
    twin, longer = (
        law("test.drag")(lambda site, c: ((0, 0, 0), (0, 0, 0))),
        law("my_test.drag")(drag.function),
    )
    for other in (twin, longer):
        with drag.in_force():
            with pytest.raises(
                RuntimeError, match=f"'{other.name}' cannot be in force together with another law 'test.drag'"
            ):
                other.acquire()
            with drag.in_force():
                pass
        with other.in_force():
            pass
