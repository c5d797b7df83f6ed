"""The page in Chromium, offline, from file://, against MuJoCo and the policies in Python."""

import base64
import math
from importlib.resources import files

import mujoco
import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from swimmer_mj import PAPER, SwimmerParameters
from swimmer_mj import state as st
from swimmer_mj.learning.networks.networks import Multilayer
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.pretrained import pretrained_card, pretrained_directory, pretrained_swimmers
from swimmer_mj.learning.problems.problem import DT, episode_shares
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.learning.runs.run import load_policy
from swimmer_mj.mjcf import mjcf
from swimmer_mj.render.page.assemble import MAX_BYTES, write_page
from swimmer_mj.render.page.policies import describe

RNG_SEED = 20021124


def mujoco_state(parameters, z):
    """qpos and qvel of reduced states z, (..., 2n + 2), with the centre of mass at the origin."""
    x = st.split(st.expand(parameters, z), parameters.n_links)
    relative = lambda angles: np.diff(angles, axis=-1, prepend=0.0)  # noqa: E731
    return (
        np.concatenate([x.position, relative(x.angles)], axis=-1),
        np.concatenate([x.velocity, relative(x.angular_velocities)], axis=-1),
    )


def pretrained(name):
    """A policy whose network computes in double precision, with the weights as they were learned."""
    policy, _, _ = load_policy(pretrained_directory(name))
    policy.network.double()
    return policy


def slide(page, name, value):
    """Put a slider somewhere as a person does."""
    page.do(
        "const [name, value] = arguments; const slider = document.getElementById(name); slider.value = value;"
        "slider.dispatchEvent(new Event('input'))",
        name,
        value,
    )


def press(page, *keys):
    ActionChains(page.driver, duration=0).send_keys(*keys).perform()


def canvas_point(page, x, y):
    """Where in the window a point (in parts of the water's width and height) is."""
    box = page.js("document.getElementById('water').getBoundingClientRect().toJSON()")
    return round(box["x"] + x * box["width"]), round(box["y"] + y * box["height"])


def drag(page, start, end, steps=4):
    """Press at a point of the water, move to another, and hold; release() lets go."""
    chain = ActionChains(page.driver, duration=10)
    chain.w3c_actions.pointer_action.move_to_location(*start).pointer_down()
    for k in range(1, steps + 1):
        between = [round(a + (b - a) * k / steps) for a, b in zip(start, end, strict=True)]
        chain.w3c_actions.pointer_action.move_to_location(*between)
    chain.perform()


def release(page):
    chain = ActionChains(page.driver, duration=0)
    chain.w3c_actions.pointer_action.pointer_up()
    chain.perform()


# The file ---------------------------------------------------------------------------------------------------------


def test_is_one_file_that_needs_nothing_else(browser, page_file):
    browser.complaints()
    browser.open(page_file)
    browser.do("swimmer.step(100)")
    browser.drawn()
    assert browser.requests(page_file) == [page_file.as_uri()]
    assert browser.complaints() == []
    assert page_file.stat().st_size < MAX_BYTES
    assert browser.js("swimmer.policies()") == list(pretrained_swimmers())


# Physics and policies ---------------------------------------------------------------------------------------------


def held(page, torques):
    """qpos and qvel after a step under each of the torques, (steps, n - 1), by the page."""
    page.do(
        "for (const u of arguments[0]) { swimmer.hold(u); swimmer.step(1); } swimmer.hold(null)",
        torques.tolist(),
    )
    state = page.js("swimmer.state()")
    return np.array(state["qpos"] + state["qvel"])


def held_in_python(parameters, qpos, qvel, torques):
    model = mujoco.MjModel.from_xml_string(mjcf(parameters, friction="actuators"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    for u in torques:
        data.ctrl[: len(u)] = u / parameters.torque_limits
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


@pytest.mark.parametrize("n", [3, 6])
def test_500_steps_under_given_torques_are_mujocos(page, n):
    parameters = SwimmerParameters(n_links=n)
    rng = np.random.default_rng(RNG_SEED)
    torques = rng.uniform(-5, 5, (500, n - 1))
    qpos, qvel = rng.uniform(-1, 1, (2, n + 2))
    page.do(f"swimmer.choose('swim{n}-value-gradient')")
    page.do("swimmer.setState(arguments[0], arguments[1])", qpos.tolist(), qvel.tolist())
    expected = held_in_python(parameters, qpos, qvel, torques)
    assert_allclose(held(page, torques), expected, rtol=0, atol=1e-9)
    assert np.abs(expected[: n + 2] - qpos).max() > 1
    assert page.js("swimmer.state().time") == pytest.approx(5.0)


def test_sliders_change_the_physics_that_is_computed(page):
    friction, torque = 10**-0.5, 1.5
    slide(page, "friction", -0.5)
    slide(page, "torque", torque)
    changed = SwimmerParameters(
        viscous_friction=friction * PAPER.viscous_friction, torque_limit=torque * PAPER.torque_limits
    )
    rng = np.random.default_rng(RNG_SEED)
    torques = rng.choice([-7.5, 7.5], (50, 4))
    qpos, qvel = rng.uniform(-1, 1, (2, 7))
    page.do("swimmer.setState(arguments[0], arguments[1])", qpos.tolist(), qvel.tolist())
    assert_allclose(held(page, torques), held_in_python(changed, qpos, qvel, torques), rtol=0, atol=1e-9)
    assert_array_equal(np.abs(page.js("swimmer.judge().control")), 7.5)
    page.do("document.getElementById('as-learned').click()")
    assert_array_equal(np.abs(page.js("swimmer.judge().control")), 5.0)


@pytest.mark.parametrize("name", ["swim5-value-gradient", "swim5-paper"])
def test_controls_values_and_hamiltonians_of_1000_states(page, name):
    """Both networks compute in double precision with the same weights; a cascade, and layers.

    That the policies act in single precision in Python changes a control only where the switching function is nearly 0.
    """
    policy = pretrained(name)
    z = policy.problem.initial_states(np.random.default_rng(RNG_SEED), 1000)
    z[:, 5:] *= 3
    judged = policy.judge(z)
    qpos, qvel = mujoco_state(PAPER, z)
    page.do(f"swimmer.choose('{name}')")
    found = page.js(
        "arguments[0].map((qpos, k) => { swimmer.setState(qpos, arguments[1][k]); return swimmer.judge(); })",
        qpos.tolist(),
        qvel.tolist(),
    )
    control, value, H, switching = (
        np.array([one[key] for one in found]) for key in ("control", "value", "hamiltonian", "switching")
    )
    decided = np.abs(switching) > 1e-6
    assert_array_equal(control[decided], judged.control[decided])
    assert decided.mean() > 0.999
    assert_allclose(value, judged.value, rtol=0, atol=1e-10)
    assert_allclose(H, judged.hamiltonian, rtol=0, atol=1e-9)

    single, _, _ = load_policy(pretrained_directory(name))
    differ = single(z) != control
    assert np.abs(switching[differ]).max(initial=0.0) < 1e-4 * np.abs(switching).max()


@pytest.mark.parametrize(
    "how",
    [{"coordinates": "joints"}, {"held": True}, {"coordinates": "joints", "held": True}],
    ids=["joints", "held", "both"],
)
def test_policies_of_joints_and_of_held_torques_act_as_in_python(another_page, tmp_path, how):
    """With random weights, so large that some held torques are within their limits; in two directions."""
    parameters = SwimmerParameters(n_links=4, mass=[0.5, 1.0, 1.5, 0.7], length=[1.2, 0.8, 1.0, 0.6])
    problem = Swimming(parameters, s_gamma=0.5, **how)
    network, generator = Multilayer(problem.n_inputs, (16, 16)).double(), torch.Generator().manual_seed(3)
    for weight in network.parameters():
        weight.data = torch.randn(weight.shape, generator=generator, dtype=torch.float64)
    policy = GreedyPolicy(problem, network)
    write_page(tmp_path / "own.html", [describe(policy, "own", "own", 1.0, None)])
    another_page.open(tmp_path / "own.html", motion=False)
    z = problem.initial_states(np.random.default_rng(RNG_SEED), 100)
    z[:, 4:] *= 3
    judged = policy.judge(z)
    turned = z.copy()
    turned[:, :4] += 2.0
    turned[:, 8:] = st.rotate(z[:, 8:], 2.0)
    for angle, states in ((0.0, z), (2.0, turned)):
        qpos, qvel = mujoco_state(parameters, states)
        another_page.do("swimmer.setTarget(arguments[0])", angle)
        found = another_page.js(
            "arguments[0].map((qpos, k) => { swimmer.setState(qpos, arguments[1][k]); return swimmer.judge(); })",
            qpos.tolist(),
            qvel.tolist(),
        )
        control, value, H = (
            np.array([one[key] for one in found]) for key in ("control", "value", "hamiltonian")
        )
        assert_allclose(value, judged.value, rtol=0, atol=1e-9)
        assert_allclose(control, judged.control, rtol=0, atol=1e-6)
        assert_allclose(H, judged.hamiltonian, rtol=0, atol=1e-6)
    inside = np.abs(judged.control) < parameters.torque_limits - 1e-9
    assert inside.any() == ("held" in how)


def test_another_target_direction_is_the_same_seen_from_a_turned_frame(page):
    z = pretrained("swim5-value-gradient").problem.initial_states(np.random.default_rng(RNG_SEED), 20)
    turned = z.copy()
    turned[:, :5] += 2.0
    turned[:, 10:] = st.rotate(z[:, 10:], 2.0)
    judged = []
    for angle, states in ((0.0, z), (2.0, turned)):
        page.do("swimmer.setTarget(arguments[0])", angle)
        qpos, qvel = mujoco_state(PAPER, states)
        judged.append(
            page.js(
                "arguments[0].map((qpos, k) => { swimmer.setState(qpos, arguments[1][k]);"
                "const { switching, value, hamiltonian } = swimmer.judge();"
                "return [value, hamiltonian, ...switching]; })",
                qpos.tolist(),
                qvel.tolist(),
            )
        )
    assert_allclose(judged[1], judged[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["swim5-value-gradient", "swim5-paper"])
def test_speed_is_what_python_finds(page, name):
    """Of the first start of an evaluation, over 30 to 60 s."""
    policy, _, _ = load_policy(pretrained_directory(name))
    start = evaluation_states(5, 1)
    expected = policy.episodes(start, episode_shares(60.0, 30.0, DT), DT)[0]
    qpos, qvel = mujoco_state(PAPER, start[0])
    page.do(f"swimmer.choose('{name}')")
    page.do("swimmer.setState(arguments[0], arguments[1])", qpos.tolist(), qvel.tolist())
    centers = []
    for _ in range(2):
        page.do("swimmer.step(3000)")
        qpos = np.array(page.js("swimmer.state().qpos"))
        x = st.join(qpos[:2], np.cumsum(qpos[2:]), np.zeros(2), np.zeros(5))
        centers.append(st.center_of_mass(PAPER, x)[0])
    assert (centers[1] - centers[0]) / 30 == pytest.approx(expected, rel=0.01)


# Hands on ---------------------------------------------------------------------------------------------------------


def test_a_click_behind_turns_the_swimmer(page):
    page.do("swimmer.step(400)")
    page.drawn()
    before = page.js("swimmer.state()")
    assert before["target"] == 0
    assert before["speed"] > 0.5
    behind = canvas_point(page, 0.06, 0.5)
    drag(page, behind, behind)
    release(page)
    assert abs(page.js("swimmer.state().target")) > 2.5
    turned = page.js(
        "Array.from({ length: 100 }, () => { swimmer.step(10); return swimmer.state(); })"
        ".find(({ target, speed }) => Math.cos(target) < -0.8 && speed > 0.5)"
    )
    assert turned is not None
    assert turned["time"] - before["time"] <= 10


def test_a_drag_in_the_water_is_a_direction(page):
    drag(page, canvas_point(page, 0.1, 0.9), canvas_point(page, 0.3, 0.6))
    box = page.js("document.getElementById('water').getBoundingClientRect().toJSON()")
    expected = math.atan2(0.3 * box["height"], 0.2 * box["width"])
    assert page.js("swimmer.state().target") == pytest.approx(expected, abs=0.02)
    release(page)
    page.do("swimmer.step(50)")
    assert page.js("swimmer.state().target") == pytest.approx(expected, abs=0.02)


def test_the_pointer_pushes_a_swimmer(page):
    """It is drawn in the middle, at rest; pulled upwards, it goes up. Let go, it swims as it would from there."""
    page.do("swimmer.step(120)")
    undisturbed = page.js("swimmer.state().qpos")
    page.do("swimmer.choose('swim5-value-gradient')")
    page.drawn()
    drag(page, canvas_point(page, 0.5, 0.5), canvas_point(page, 0.5, 0.1))
    assert page.js("swimmer.state().target") == 0
    page.do("swimmer.step(120)")
    assert page.js("swimmer.state().qpos")[1] - undisturbed[1] > 0.5
    release(page)
    state = page.js("swimmer.state()")
    page.do("swimmer.step(10)")
    after = page.js("swimmer.state()")
    page.do("swimmer.choose('swim5-value-gradient')")
    page.do("swimmer.setState(arguments[0], arguments[1]); swimmer.step(10)", state["qpos"], state["qvel"])
    assert_allclose(after["qvel"], page.js("swimmer.state().qvel"), rtol=0, atol=1e-9)


def test_a_push_is_as_strong_and_as_long_as_the_docs_say(page):
    """40 N on the middle link for 0.2 s, to the left of the target direction; no torques."""
    page.do("swimmer.hold([0, 0, 0, 0])")
    state = page.js("swimmer.state()")
    press(page, "p")
    page.do("swimmer.step(40)")
    model = mujoco.MjModel.from_xml_string(mjcf(PAPER, friction="actuators"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state["qpos"], state["qvel"]
    for k in range(40):
        data.body("link_3").xfrc_applied[1] = 40.0 if k < 20 else 0.0
        mujoco.mj_step(model, data)
    after = page.js("swimmer.state()")
    assert_allclose(after["qpos"] + after["qvel"], [*data.qpos, *data.qvel], rtol=0, atol=1e-9)


def test_keys(page):
    js = page.js
    for keys, angle in (
        ([Keys.ARROW_UP], 90),
        ([Keys.ARROW_LEFT], 180),
        ([Keys.ARROW_DOWN], -90),
        ([Keys.ARROW_RIGHT], 0),
    ):
        press(page, *keys)
        assert math.degrees(js("swimmer.state().target")) == pytest.approx(angle)
    ActionChains(page.driver, duration=0).key_down(Keys.ARROW_UP).key_down(Keys.ARROW_LEFT).perform()
    assert math.degrees(js("swimmer.state().target")) == pytest.approx(135)
    ActionChains(page.driver, duration=0).key_up(Keys.ARROW_UP).key_up(Keys.ARROW_LEFT).perform()

    assert js("swimmer.state().time") == 0
    press(page, "..")
    assert js("swimmer.state().time") == pytest.approx(0.02)
    start = js("swimmer.state().qpos")
    press(page, "r")
    assert js("swimmer.state().qpos") != start
    press(page, "0")
    first = js("swimmer.state().qpos")
    press(page, "0.")
    undisturbed = js("swimmer.state().qvel")
    press(page, "0")
    assert js("swimmer.state().qpos") == first
    press(page, "p.")
    assert np.abs(np.subtract(js("swimmer.state().qvel"), undisturbed)).max() > 0.05

    press(page, "3")
    assert len(js("swimmer.state().qpos")) == 5
    assert js("document.querySelectorAll('#policies :checked').length") == 2
    press(page, "m")
    assert js("[...document.querySelectorAll('#policies :checked')].map(box => box.value)") == ["swim3-paper"]
    press(page, "9")  # there is none with nine links
    assert len(js("swimmer.state().qpos")) == 5

    pace = js("document.getElementById('pace-now').textContent")
    press(page, "[[")
    assert js("document.getElementById('pace-now').textContent") != pace
    press(page, "]]")
    assert js("document.getElementById('pace-now').textContent") == pace
    for key, box in (("t", "trails"), ("u", "torques")):
        press(page, key)
        assert js(f"document.getElementById('{box}').checked") is False
        press(page, key)
    press(page, " ")
    page.drawn()
    assert js("document.getElementById('play').textContent") == "Pause"
    press(page, " ")
    stopped = js("swimmer.state().time")
    assert stopped > 0
    page.drawn()
    assert js("swimmer.state().time") == stopped


def test_a_slider_is_moved_by_keys_and_says_where_it_is(page):
    page.do("document.getElementById('torque').focus()")
    press(page, Keys.ARROW_RIGHT)
    assert page.js("document.getElementById('torque-now').textContent") == "5.25 N·m"
    assert page.js("swimmer.state().target") == 0  # the key was the slider's
    page.do("document.getElementById('friction').focus()")
    press(page, Keys.HOME)
    assert page.js("document.getElementById('friction-now').textContent") == "1.0 N·s/m²"


def test_the_speed_of_time_is_the_sliders(page):
    """Within a factor, for machines that are busy: ten times slower, then as fast as the wall clock."""
    run = (
        "const done = arguments[0]; const [time, start] = [swimmer.state().time, performance.now()]; swimmer.play();"
        "setTimeout(() => { swimmer.pause();"
        "done((swimmer.state().time - time) / (performance.now() - start) * 1000); }, 600)"
    )
    slide(page, "pace", -1)
    slow = page.driver.execute_async_script(run)
    slide(page, "pace", 0)
    fast = page.driver.execute_async_script(run)
    assert 0.02 < slow < 0.15
    assert 2 * slow < fast < 1.3


def test_two_race_and_the_numbers_stand_side_by_side(page):
    page.do("swimmer.choose('swim5-value-gradient', 'swim5-paper'); swimmer.step(2000)")
    page.drawn()
    rows = page.js(
        "[...document.querySelectorAll('#policies tr')].map(row => [...row.cells].map(cell => cell.textContent))"
    )
    assert [row[0] for row in rows] == ["value gradient, joints", "the paper's TD(λ)", "value gradient"]
    for row, name in zip(rows[1:], ("swim5-paper", "swim5-value-gradient"), strict=True):
        assert float(row[2]) == pytest.approx(pretrained_card(name)["swimming_speed"], abs=0.005)
        assert float(row[1]) == pytest.approx(float(row[2]), rel=0.15)
    page.do("swimmer.choose('swim5-value-gradient', 'swim5-paper')")
    page.drawn()
    ahead = canvas_point(page, 0.95, 0.5)
    drag(page, ahead, ahead)
    release(page)
    page.do("swimmer.step(1000)")
    page.drawn()
    assert page.js("document.getElementById('message').textContent") in (
        "There first: value gradient",
        "There first: the paper's TD(λ)",
    )


def test_who_has_arrived_goes_on_as_it_went(page):
    """Two that start apart come to a point from two sides. Of the page's own modules, with another MuJoCo."""
    wasm = files("swimmer_mj.render.page").joinpath("mujoco/mujoco.wasm.gz").read_bytes()
    before, after, later = page.driver.execute_async_script(
        "const [wasm, done] = arguments; const scripts = document.querySelectorAll('script[type=module]');"
        "const text = scripts[scripts.length - 1].textContent.replace(/^start\\(\\)[^]*/m, '');"
        "const { Arena, decodeBytes, unzip } = new Function(`${text}; return { Arena, decodeBytes, unzip };`)();"
        "unzip(decodeBytes(wasm)).then(wasmBinary => loadMujoco({ wasmBinary })).then(mujoco => {"
        "  const { policies } = JSON.parse(document.getElementById('content').textContent);"
        "  const arena = new Arena(mujoco, policies);"
        "  const targets = () => arena.racers.map(({ swimmer }) => swimmer.target);"
        "  arena.choose(['swim5-value-gradient', 'swim5-joints']);"
        "  arena.swimTo(3, 0);"
        "  let before = null;"
        "  for (let k = 0; k < 3000 && 'x' in arena.target; k++) { before = targets(); arena.step(); }"
        "  arena.step(10);"
        "  const after = targets();"
        "  arena.reset();"
        "  done([before, after, targets()]);"
        "});",
        base64.b64encode(wasm).decode(),
    )
    assert abs(before[0] - before[1]) > 0.1
    assert_allclose(after, before, rtol=0, atol=0.05)
    assert later[0] == later[1] == after[0]


def test_a_box_takes_a_swimmer_out_and_one_stays(page):
    page.do("swimmer.choose('swim5-value-gradient', 'swim5-paper')")
    box = "document.querySelector('#policies input[value=\"swim5-paper\"]')"
    checked = "[...document.querySelectorAll('#policies :checked')].map(box => box.value)"
    page.do(f"{box}.click()")
    assert page.js(checked) == ["swim5-value-gradient"]
    page.do(f"{box}.click()")
    assert page.js(checked) == ["swim5-paper", "swim5-value-gradient"]
    page.do("document.querySelector('#policies input[value=\"swim5-value-gradient\"]').click()")
    page.do(f"{box}.click()")
    assert page.js(checked) == ["swim5-paper"]


def test_wrong_arguments_are_refused(page):
    refuse = "try { %s; return null; } catch (error) { return error.message; }"
    assert "there is no policy fish; there are swim3-paper" in page.do(refuse % "swimmer.choose('fish')")
    assert "must have 7 numbers each, got 2 and 7" in page.do(
        refuse % "swimmer.setState([0, 0], new Array(7).fill(0))"
    )
    assert "as many links each, got 5, 3" in page.do(refuse % "swimmer.choose('swim5-paper', 'swim3-paper')")
    assert "torques must be 4 finite numbers, got [1]" in page.do(refuse % "swimmer.hold([1])")
    assert "a finite number of radians, got NaN" in page.do(refuse % "swimmer.setTarget(NaN)")
    assert "qpos and qvel must be finite numbers" in page.do(
        refuse % "swimmer.setState(new Array(7).fill(NaN), new Array(7).fill(0))"
    )
    assert page.js("swimmer.state().qpos.length") == 7


# Every screen, every wish -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1440, 900), (834, 1112), (390, 844), (320, 568)])
def test_nothing_is_cut_off(page, size):
    page.resize(*size, mobile=size[0] < 500)
    page.drawn()
    assert page.js("document.documentElement.scrollWidth") <= size[0]
    outside = page.js(
        "[...document.querySelectorAll('button, output, label, h1, td, figcaption')].filter(one => {"
        "const box = one.getBoundingClientRect();"
        "return box.width > 0 && (box.left < 0 || box.right > innerWidth + 0.5);"
        "}).map(one => one.outerHTML)"
    )
    assert outside == []


def test_a_finger_sets_the_target(page):
    page.resize(390, 844, mobile=True)
    page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    page.drawn()
    x, y = canvas_point(page, 0.5, 0.9 * 0.2)
    page.driver.execute_cdp_cmd(
        "Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
    )
    page.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    assert page.js("swimmer.state().target") == pytest.approx(math.pi / 2, abs=0.2)


def luminance(color):
    r, g, b = (int(color[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (r, g, b)]
    return np.dot(linear, (0.2126, 0.7152, 0.0722))


def contrast(one, other):
    """WCAG's contrast ratio; 4.5 is asked of text, 3 of graphics."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_can_be_read_in_both_themes(page, scheme):
    page.emulate(scheme)
    color = lambda name: page.js(  # noqa: E731
        f"getComputedStyle(document.documentElement).getPropertyValue('--{name}').trim()"
    )
    for text, ground in (
        ("text", "panel"), ("muted", "panel"), ("accent", "panel"), ("on-accent", "accent"), ("muted", "water"),
        ("racer-0", "panel"), ("racer-1", "panel"), ("racer-2", "panel"), ("racer-3", "panel"), ("text", "raised"),
    ):  # fmt: skip
        assert contrast(color(text), color(ground)) >= 4.5, (text, ground)
    for mark in ("target", "torque", "racer-0", "racer-1", "racer-2", "racer-3"):
        assert contrast(color(mark), color("water")) >= 3, mark
    page.emulate("light" if scheme == "dark" else "dark")
    assert color("panel") != page.js("'#000000'")


def test_everything_that_can_be_used_has_a_name_for_screen_readers(page):
    nameless = page.js(
        "[...document.querySelectorAll('button, input, canvas')].filter(one =>"
        "!(one.textContent.trim() || one.getAttribute('aria-label') || (one.labels && one.labels.length)))"
        ".map(one => one.outerHTML)"
    )
    assert nameless == []


def test_nothing_moves_before_play_where_less_motion_is_preferred(browser, page_file):
    wait = "setTimeout(arguments[0], 300)"
    browser.open(page_file, motion=False)
    browser.driver.execute_async_script(wait)
    assert browser.js("swimmer.state().time") == 0
    press(browser, " ")
    browser.driver.execute_async_script(wait)
    assert browser.js("swimmer.state().time") > 0
    browser.open(page_file)
    browser.driver.execute_async_script(wait)
    assert browser.js("swimmer.state().time") > 0
