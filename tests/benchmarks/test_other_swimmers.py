"""docs/other-swimmers.md says what the installed packages say today."""

import dataclasses
import importlib.util

import numpy as np
import other_swimmers as other
import pytest


@pytest.fixture(scope="module")
def stored():
    return {swimmer.name: swimmer for swimmer in other.read()}


pytestmark = pytest.mark.skipif(
    not importlib.util.find_spec("dm_control"), reason="there is no dm_control here"
)

INSTALLED = [name for module, name in other.SWIMMERS if importlib.util.find_spec(module)]


@pytest.fixture(scope="module")
def fresh(stored):
    return {swimmer.name: swimmer for swimmer in other.measure(stored.values())}


def test_all_swimmers_are_in_the_json(stored):
    assert list(stored) == [name for _, name in other.SWIMMERS]
    assert {"swim5", "swim3", "Swimmer-v5", "swimmer6", "swimmer15"} <= {*INSTALLED}


@pytest.mark.parametrize("name", INSTALLED)
def test_a_fresh_measurement_gives_the_stored_numbers(name, stored, fresh):
    old, new = (dataclasses.asdict(swimmers[name]) for swimmers in (stored, fresh))
    for field in old:
        if field == "versions":
            continue
        if isinstance(old[field], list):
            assert new[field] == pytest.approx(old[field], rel=1e-4), field
        else:
            assert new[field] == (
                pytest.approx(old[field]) if isinstance(old[field], float) else old[field]
            ), field


def test_the_page_has_the_tables_of_a_fresh_measurement(stored, fresh):
    page = other.PAGE.read_text(encoding="utf-8")
    assert other.tables([*fresh.values()]) in page
    assert other.page(page, [*stored.values()]) == page


def test_a_changed_number_would_be_noticed(stored):
    page = other.PAGE.read_text(encoding="utf-8")
    for change in (
        {"torque": 6.0},
        {"joint_limit": 1.0},
        {"link_mass": 1.1},
        {"across": [1.01] * 31},
        {"integrator": "RK5"},
    ):
        assert (
            other.tables([dataclasses.replace(stored["swim5"], **change), *[*stored.values()][1:]])
            not in page
        )


def test_drag_of_ours_is_that_of_the_paper(fresh):
    for name, n in (("swim5", 5), ("swim3", 3)):  # k l a rod, with k = 10 N·s/m², l = 1 m
        assert fresh[name].across == pytest.approx(10.0 * n * other.SPEEDS, rel=1e-5)
        assert not np.any(fresh[name].along)


def test_drag_of_dm_control_is_that_of_its_boxes(fresh):
    # MuJoCo's fluid: 1/2 density area speed² on the faces of each link's box, 0.002 m by 0.1 m by 0.02 m
    swimmer = fresh["swimmer6"]
    assert swimmer.across == pytest.approx(6 * 0.5 * 3000 * 0.1 * 0.02 * other.SPEEDS**2, rel=1e-4)
    assert swimmer.along == pytest.approx(6 * 0.5 * 3000 * 0.002 * 0.02 * other.SPEEDS**2, rel=1e-4)


def test_what_the_page_says_of_others_pages():
    pages = pytest.importorskip("gymnasium.envs.mujoco.swimmer_v5").SwimmerEnv.__doc__
    assert "*l<sub>i</sub>* = 0.1, and *k* = 0.1" in pages
    assert "Rémi Coulom's PhD thesis" in pages


def test_what_cannot_be_imported_keeps_its_numbers(stored, monkeypatch):
    monkeypatch.setattr(other.importlib.util, "find_spec", lambda name: None)
    assert other.measure(stored.values()) == [*stored.values()]
    assert other.measure() == []


def test_a_page_without_marks_is_refused(stored):
    with pytest.raises(ValueError, match="must have"):
        other.page("# Other swimmers\n", [*stored.values()])


def test_a_swimmer_that_is_not_as_described_is_refused():
    with pytest.raises(AssertionError, match=r"reward: found 1\.0, expected 2\.0"):
        other._hold("reward", 1.0, 2.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (1168.24, "1,168"),
        (35.6047, "35.6"),
        (0.36, "0.36"),
        (5e-4, "0.0005"),
        (1e-6, "1e-6"),
        (100, "100"),
        (50.0, "50"),
    ],
)
def test_numbers_have_three_digits(value, text):
    assert other._number(value) == text


def test_swimmers_with_the_same_drag_share_a_line(stored):
    across, along = other.drag_plot([*stored.values()]).axes
    assert [len(axes.lines) for axes in (across, along)] == [3, 2]
    assert [text.get_text() for text in across.get_legend().get_texts()] == [
        "swimmer-mj swim5\nswimmer-mj swim3",
        "Gymnasium Swimmer-v5\nBrax swimmer",
        "dm_control swimmer6\ndm_control swimmer15",
    ]
