import numpy as np
import pytest

from swimmer_mj import SwimmerParameters
from swimmer_mj.state import center_of_mass, expand, reduced_size
from swimmer_mj.trajectory import Trajectory

UNEQUAL = SwimmerParameters(3, mass=(1.0, 2.0, 0.5), length=(0.5, 1.5, 1.0), torque_limit=(2.0, 3.0))


def record(parameters=UNEQUAL, steps=20, seed=0, **changes):
    rng = np.random.default_rng(seed)
    n = parameters.n_links
    fields = {
        "times": 0.1 * np.arange(steps + 1),
        "states": rng.normal(size=(steps + 1, 2 * n + 4)),
        "controls": rng.normal(size=(steps, n - 1)),
        "target_directions": rng.uniform(-np.pi, np.pi, steps + 1),
        "values": rng.normal(size=steps + 1),
        "hamiltonians": np.full(steps + 1, np.nan),
    }
    return Trajectory(parameters, **(fields | changes))


def gliding(velocity, times, directions):
    """A stiff swimmer whose centre of mass moves with ``velocity`` (m/s)."""
    z = np.zeros(reduced_size(3))
    z[-2:] = velocity
    states = np.tile(expand(UNEQUAL, z), (times.size, 1))
    states[:, :2] += times[:, None] * velocity
    controls, unknown = np.zeros((times.size - 1, 2)), np.full(times.size, np.nan)
    return Trajectory(UNEQUAL, times, states, controls, directions, unknown, unknown)


@pytest.mark.parametrize("parameters", [UNEQUAL, SwimmerParameters(1, viscous_friction=0.0)])
def test_save_and_load_return_the_same_record(tmp_path, parameters):
    saved = record(parameters)
    saved.save(tmp_path / "new" / "episode.npz")
    loaded = Trajectory.load(tmp_path / "new" / "episode.npz")
    assert loaded.parameters == saved.parameters
    for name in ("times", "states", "controls", "target_directions", "values", "hamiltonians"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name), strict=True)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["episode.npz"]


def test_the_file_holds_no_pickle(tmp_path):
    record().save(tmp_path / "episode.npz")
    with np.load(tmp_path / "episode.npz", allow_pickle=False) as file:
        assert {file[name].dtype.kind for name in file.files} == {"f", "U"}


def test_a_save_that_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "episode.npz"
    record(seed=1).save(path)
    before = path.read_bytes()
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))  # no file may grow beyond 100 bytes
    try:
        with pytest.raises(OSError, match="File too large"):
            record(seed=2).save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_load_refuses_other_files(tmp_path):
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", times=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name in ("text.npz", "other.npz", "array.npy"):
        with pytest.raises(ValueError, match=f"{name} is not a saved trajectory"):
            Trajectory.load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        Trajectory.load(tmp_path / "absent.npz")


def test_load_refuses_damaged_files(tmp_path):
    """Whichever byte is spoilt: the file is refused, or says the same where the byte did not matter."""
    path = tmp_path / "episode.npz"
    saved = record(steps=1)
    saved.save(path)
    content, refused = path.read_bytes(), 0
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            loaded = Trajectory.load(path)
        except ValueError as error:
            assert f"{path} is not a saved trajectory: " in str(error)  # noqa: PT017
            refused += 1
        else:
            np.testing.assert_array_equal(loaded.states, saved.states)
    assert refused > len(content) / 2
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match="is not a saved trajectory"):
        Trajectory.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.zeros((2, 2))}, r"times must have shape \(T \+ 1,\)"),
        ({"times": np.empty(0)}, "times must have shape"),
        ({"times": np.zeros(21)}, "times must increase strictly"),
        ({"times": np.append(np.arange(20.0), np.inf)}, "times must be finite"),
        (
            {"states": np.zeros((21, 9))},
            r"states must have shape \(21, 10\) for 21 times and 3 links, got \(21, 9\)",
        ),
        ({"states": np.full((21, 10), np.nan)}, "states must be finite"),
        ({"controls": np.zeros((21, 2))}, r"controls must have shape \(20, 2\)"),
        ({"controls": np.full((20, 2), np.inf)}, "controls must be finite"),
        ({"target_directions": 0.0}, r"target_directions must have shape \(21,\)"),
        ({"values": np.zeros(20)}, r"values must have shape \(21,\)"),
        ({"hamiltonians": np.zeros(20)}, r"hamiltonians must have shape \(21,\)"),
    ],
)
def test_refusals_name_field_and_constraint(changes, message):
    with pytest.raises(ValueError, match=message):
        record(**changes)


def test_a_record_does_not_change():
    states = np.zeros((21, 10))
    trajectory = record(states=states)
    states[:] = 1.0
    assert not trajectory.states.any()
    with pytest.raises(ValueError, match="read-only"):
        trajectory.states[0] = 1.0


def test_speed_is_displacement_along_the_target_over_time():
    times = np.linspace(0.0, 4.0, 41)
    trajectory = gliding(np.array([0.6, 0.8]), times, np.zeros(41))
    assert trajectory.speed() == pytest.approx(0.6)
    assert trajectory.speed(after=2.0) == pytest.approx(0.6)
    np.testing.assert_allclose(trajectory.speeds(), 0.6)
    upwards = gliding(np.array([0.6, 0.8]), times, np.full(41, np.pi / 2))
    assert upwards.speed() == pytest.approx(0.8)


def test_speed_follows_a_target_that_turns():
    times = np.linspace(0.0, 4.0, 41)
    turning = gliding(np.array([0.6, 0.0]), times, np.where(times < 0.995, 0.0, np.pi))
    assert turning.speed() == pytest.approx((0.6 - 3 * 0.6) / 4)
    assert turning.speed(after=1.0) == pytest.approx(-0.6)
    assert turning.speed(after=0.5) == pytest.approx((0.5 * 0.6 - 3 * 0.6) / 3.5)


def test_speeds_are_the_derivative_of_the_centre_of_mass():
    rng = np.random.default_rng(3)
    x, h = rng.normal(size=10), 1e-6
    moved = x.copy()
    moved[:5] += h * x[5:]
    trajectory = record(steps=1, times=[0.0, h], states=[x, moved], target_directions=[0.7, 0.7])
    velocity = (center_of_mass(UNEQUAL, moved) - center_of_mass(UNEQUAL, x)) / h
    assert trajectory.speeds()[0] == pytest.approx(velocity @ [np.cos(0.7), np.sin(0.7)], rel=1e-5)


def test_speed_needs_time_left():
    with pytest.raises(ValueError, match=r"after must be less than the last time 2 s, got 2\.0"):
        record().speed(after=2.0)


@pytest.mark.parametrize(
    ("time", "index"), [(-1.0, 0), (0.0, 0), (0.149, 1), (0.151, 2), (2.0, 20), (9.0, 20)]
)
def test_index_of_the_nearest_state(time, index):
    assert record().index_at(time) == index


def test_index_in_a_single_state():
    assert record(steps=0).index_at(1.0) == 0
