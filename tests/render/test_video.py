import itertools
import math
import re
import subprocess
import sys

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from swimmer_mj import PAPER, SwimmerParameters
from swimmer_mj.mjcf import mjcf
from swimmer_mj.render.video import frames, write_video
from swimmer_mj.state import expand, link_centers, reduced_size
from swimmer_mj.trajectory import Trajectory

WIDTH, HEIGHT = 320, 240


def standing(angles, *, parameters=PAPER, center=(0.0, 0.0), direction=0.0):
    """A single state: no velocity, the centre of mass at ``center``."""
    z = np.zeros(reduced_size(parameters.n_links))
    z[: parameters.n_links] = angles
    x = expand(parameters, z)
    x[:2] += center
    unknown = [np.nan]
    controls = np.empty((0, parameters.n_links - 1))
    return Trajectory(parameters, [0.0], [x], controls, [direction], unknown, unknown)


def draw(trajectory, **options):
    """The only frame of a single state."""
    (frame,) = frames(trajectory, **({"width": WIDTH, "height": HEIGHT, "caption": False} | options))
    return frame.astype(int)


def pixel_of(point, center, parameters):
    """Row and column where a camera above ``center`` that looks down, y upwards, sees ``point``."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf(parameters))
    camera = model.camera("top")
    scale = HEIGHT / 2 / (camera.pos[2] * math.tan(math.radians(camera.fovy[0]) / 2))
    x, y = scale * (np.asarray(point) - center)
    return round(HEIGHT / 2 - 0.5 - y), round(WIDTH / 2 - 0.5 + x)


def is_blue(pixel):
    return pixel[2] - pixel[0] > 60 and pixel[0] < 100


def is_orange(pixel):
    return pixel[0] - pixel[2] > 80


def test_links_appear_where_the_state_says():
    angles = [0.3, -0.5, 0.8, 0.0, -0.9]
    trajectory = standing(angles, center=(1.5, -0.7))
    frame = draw(trajectory, camera="top")
    for i, point in enumerate(link_centers(PAPER, trajectory.states[0])):
        pixel = frame[pixel_of(point, (0.0, 0.0), PAPER)]
        assert (is_orange if i % 2 else is_blue)(pixel), (i, pixel)
    mirrored = draw(standing([-a for a in angles], center=(1.5, 0.7)), camera="top")
    outer = link_centers(PAPER, trajectory.states[0])[0]
    assert not is_blue(mirrored[pixel_of(outer, (0.0, 0.0), PAPER)])


def test_unequal_links_appear_where_the_state_says():
    parameters = SwimmerParameters(3, mass=(1.0, 3.0, 0.5), length=(0.5, 2.0, 1.0))
    trajectory = standing([2.0, 0.4, -1.0], parameters=parameters)
    frame = draw(trajectory, camera="top")
    for i, point in enumerate(link_centers(parameters, trajectory.states[0])):
        pixel = frame[pixel_of(point, (0.0, 0.0), parameters)]
        assert (is_orange if i % 2 else is_blue)(pixel), (i, pixel)


def swimmer_pixels(frame):
    return np.argwhere((frame[..., 2] - frame[..., 0] > 60) & (frame[..., 0] < 100))


def test_tracking_follows_the_centre_of_mass_over_a_ground_that_stays():
    here, there = draw(standing(np.zeros(5))), draw(standing(np.zeros(5), center=(13.3, -7.1)))
    np.testing.assert_allclose(
        swimmer_pixels(here).mean(axis=0), swimmer_pixels(there).mean(axis=0), atol=1.0
    )
    changed = np.abs(here - there).max(axis=-1) > 4
    assert changed.mean() > 0.05  # the grid has moved on


def test_a_fixed_camera_sees_the_swimmer_move():
    here = swimmer_pixels(draw(standing(np.zeros(5)), camera="top")).mean(axis=0)
    there = swimmer_pixels(draw(standing(np.zeros(5), center=(1.0, 0.5)), camera="top")).mean(axis=0)
    assert there[1] - here[1] > 5  # to the right
    assert there[0] - here[0] < -2  # and up


@pytest.mark.parametrize("direction", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_the_mark_stands_in_the_target_direction(direction):
    frame = draw(standing(np.zeros(5), direction=direction), camera="top")
    red = np.argwhere((frame[..., 0] - frame[..., 2] > 80) & (frame[..., 0] - frame[..., 1] > 100))
    assert len(red) > 10
    row, column = red.mean(axis=0) - [HEIGHT / 2, WIDTH / 2]
    seen = np.array([column, -row]) / math.hypot(row, column)
    np.testing.assert_allclose(seen, [math.cos(direction), math.sin(direction)], atol=0.05)


def test_one_frame_each_period_of_the_recorded_time(episode):
    drawn = list(frames(episode, width=64, height=48, fps=10))
    assert len(drawn) == 30
    assert {(frame.shape, frame.dtype) for frame in drawn} == {((48, 64, 3), np.dtype(np.uint8))}


def test_frame_k_shows_the_state_at_its_time(episode):
    sixth = next(itertools.islice(frames(episode, width=WIDTH, height=HEIGHT, fps=4, caption=False), 5, None))
    at = episode.index_at(5 / 4)
    alone = Trajectory(
        episode.parameters,
        episode.times[[at]],
        episode.states[[at]],
        np.empty((0, 4)),
        episode.target_directions[[at]],
        [np.nan],
        [np.nan],
    )
    np.testing.assert_array_equal(sixth, draw(alone))
    first = next(frames(episode, width=WIDTH, height=HEIGHT, fps=4, caption=False))
    assert (np.abs(sixth.astype(int) - first) > 60).any(axis=-1).sum() > 100


def two_states(angles, later):
    """A second in which the links turn from some angles to others."""
    states = [standing(angles).states[0], standing(later).states[0]]
    return Trajectory(PAPER, [0.0, 1.0], states, np.zeros((1, 4)), [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])


def test_between_two_records_lies_what_is_between_them():
    moving = two_states(np.zeros(5), np.full(5, 1.0))
    drawn = [*frames(moving, width=WIDTH, height=HEIGHT, fps=2, slow=2.0, caption=False, camera="top")]
    assert len(drawn) == 4, "twice as long"
    lost = Trajectory(PAPER, [0.0], [moving.states.mean(axis=0)], np.empty((0, 4)), [0.0], [0.0], [0.0])
    np.testing.assert_array_equal(drawn[2], draw(lost, camera="top"))


def rivals(frame):
    """Rows and columns of the dark links of the first and of the second swimmer."""
    r, g, b = np.moveaxis(frame.astype(int), -1, 0)
    orange = (r - b > 120) & (b < 70) & (g - b > 20)  # the mark is red: as much green as blue
    return np.argwhere((b - r > 60) & (r < 100)), np.argwhere(orange)


@pytest.mark.parametrize("apart", [0.0, 20.0])
def test_two_swimmers_are_seen_side_by_side_in_one_water(apart):
    start, away = (standing(np.zeros(5), center=(2 * x, 0.0)).states[0] for x in (0.0, apart))
    unknown = [np.nan, np.nan]
    here, other = (
        Trajectory(PAPER, [0.0, 1.0], states, np.zeros((1, 4)), [0.0, 0.0], unknown, unknown)
        for states in ([start, start], [start, away])
    )
    _, frame = frames(here, against=other, width=WIDTH, height=HEIGHT, fps=2, caption=False)
    blue, orange = rivals(frame)
    assert len(blue) > 10
    assert len(orange) > 10
    assert orange[:, 0].mean() > blue[:, 0].mean() + 5, "the second one on the right of the first: below"
    ahead = orange[:, 1].mean() - blue[:, 1].mean()
    assert ahead > 100 if apart else abs(ahead) < 8
    for found in (blue, orange):
        assert (found.min(axis=0) > 3).all()
        assert (found.max(axis=0) < [HEIGHT - 4, WIDTH - 4]).all()


def test_the_slower_of_two_may_have_other_links_and_both_are_named():
    three = standing([0.2, -0.2, 0.2], parameters=SwimmerParameters(3))
    size = {"width": 640, "height": 480, "against": three}
    named, other = (
        next(frames(standing(np.zeros(5)), **size, names=names)) for names in (("one", "two"), ("one", "six"))
    )
    changed = np.argwhere(np.abs(named.astype(int) - other).max(axis=-1) > 40)
    assert len(changed) > 5
    assert changed[:, 0].min() > 440, "the last line"


@pytest.mark.parametrize(
    ("size", "overlay"), [((640, 480), True), ((1280, 720), False), ((1920, 1080), True)]
)
def test_sizes_of_the_command_line(size, overlay):
    width, height = size
    frame = draw(standing(np.zeros(5)), width=width, height=height, overlay=overlay)
    assert frame.shape == (height, width, 3)
    water = frame[: round(0.76 * height)]
    assert len(swimmer_pixels(water)) > 0.001 * width * height
    assert (np.median(frame[-20:]) == 255) == overlay, "white paper below the water"


def test_the_caption_is_written_at_the_lower_left():
    trajectory = standing(np.zeros(5))
    changed = np.argwhere(np.abs(draw(trajectory, caption=True) - draw(trajectory)).max(axis=-1) > 40)
    assert len(changed) > 100
    assert changed[:, 0].min() > 0.88 * HEIGHT
    assert changed[:, 0].max() < HEIGHT - 2
    assert changed[:, 1].max() < WIDTH - 2


def test_samples_smooth_edges():
    bent = standing([0.2, 0.4, 0.6, 0.4, 0.2])
    colours = [len(np.unique(draw(bent, samples=samples).reshape(-1, 3), axis=0)) for samples in (0, 4)]
    assert colours[1] > 1.2 * colours[0]


def test_the_smallest_frame_with_an_overlay(episode):
    assert next(frames(episode, width=160, height=150, overlay=True)).shape == (150, 160, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0}, "width must be positive, got 0"),
        ({"fps": -1}, "fps must be positive, got -1"),
        ({"slow": 0.0}, "slow must be positive, got 0.0"),
        ({"camera": "side"}, "camera must be 'tracking' or 'top', got 'side'"),
        ({"samples": -1}, "samples must not be negative, got -1"),
        ({"names": ("one", "two")}, "names must be at most 1, as there are swimmers; got 2"),
        ({"width": 160, "height": 149, "overlay": True}, "must be at least 160 x 150 pixels, got 160 x 149"),
    ],
)
def test_frames_refuses_at_the_call(episode, options, message):
    with pytest.raises(ValueError, match=message):
        frames(episode, **options)


def test_an_abandoned_generator_leaves_nothing_at_exit(tmp_path, episode):
    episode.save(tmp_path / "episode.npz")
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-c",
            "from swimmer_mj.render.video import frames\n"
            "from swimmer_mj.trajectory import Trajectory\n"
            f"generator = frames(Trajectory.load({str(tmp_path / 'episode.npz')!r}), width=64, height=48)\n"
            "print(next(generator).shape)\n",
        ],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "(48, 64, 3)\n", "")


def read_back(path):
    """What ffmpeg says of a video, and its frames as one string of RGB bytes."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    return done.stderr.decode(), done.stdout


def test_the_video_has_the_frames_size_and_rate_declared(tmp_path, episode):
    drawn = list(frames(episode, width=162, height=122, fps=25))  # no multiples of 16
    assert write_video(tmp_path / "new" / "swim.mp4", iter(drawn), fps=25) == 75
    said, decoded = read_back(tmp_path / "new" / "swim.mp4")
    assert re.search(r"Duration: 00:00:03\.00,", said)
    assert re.search(r"Video: h264 .*\byuv420p\b.*\b162x122\b.*\b25 fps\b", said)
    video = np.frombuffer(decoded, np.uint8).reshape(75, 122, 162, 3)
    for k in (0, 40, 74):
        assert np.abs(video[k].astype(int) - drawn[k]).mean() < 6
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["swim.mp4"]


def test_a_gif_and_a_webp_have_the_frames_and_their_times(tmp_path, episode):
    drawn = list(frames(episode, width=162, height=121, fps=12))
    for suffix in (".gif", ".webp"):
        path = tmp_path / f"swim{suffix}"
        assert write_video(path, iter(drawn), fps=12) == 36
        with Image.open(path) as picture:
            assert (picture.size, picture.n_frames, picture.info["loop"]) == ((162, 121), 36, 0)
            durations = []
            for k in range(36):
                picture.seek(k)
                shown = np.asarray(picture.convert("RGB")).astype(int)
                durations.append(picture.info["duration"])
                if k in (0, 20, 35):
                    assert np.abs(shown - drawn[k]).mean() < 6, (suffix, k)
        assert sum(durations) == pytest.approx(3000, abs=60)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["swim.gif", "swim.webp"]


def test_a_gif_that_browsers_would_slow_down_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"a \.gif file can have up to 50 frames per second, got 60"):
        write_video(tmp_path / "swim.gif", [], fps=60)


@pytest.mark.parametrize("fps", [0, -1, math.nan])
def test_a_rate_that_is_not_positive_is_refused(tmp_path, fps):
    with pytest.raises(ValueError, match=f"fps must be positive, got {fps}"):
        write_video(tmp_path / "swim.mp4", [np.zeros((48, 64, 3), np.uint8)], fps=fps)


def test_a_video_that_fails_leaves_no_file(tmp_path):
    def failing():
        yield np.zeros((48, 64, 3), np.uint8)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_video(tmp_path / "swim.mp4", failing())
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def room():
    """Let what is started write files of so many bytes at most, as on a disk that is full then."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize(
    ("suffix", "size"),
    [(".mp4", (64, 64)), (".mkv", (64, 64)), (".gif", (64, 64)), (".webp", (64, 64)), (".mp4", (480, 640))],
)  # of large frames, ffmpeg ends before all are piped
def test_a_full_disk_is_told_in_one_line_and_leaves_no_file(tmp_path, room, capfd, suffix, size):
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (*size, 3), dtype=np.uint8) for _ in range(12)]
    whole = tmp_path / f"whole{suffix}"
    write_video(whole, noise)
    for bytes_there in (8000, whole.stat().st_size - 40):
        room(bytes_there)
        with pytest.raises(OSError, match=rf"frames of .*swim\{suffix}; is there room on the disk\?$"):
            write_video(tmp_path / f"swim{suffix}", noise)
    assert list(tmp_path.iterdir()) == [whole]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "shapes", "message"),
    [
        ("swim.mp4", [], "at least one frame"),
        ("swim.mp4", [(48, 63, 3)], "must be even, got 48 x 63"),
        ("swim.avi", [(48, 64, 3)], "must end with .mp4, .mkv, .mov, .gif or .webp, got '.*swim.avi'"),
        ("swim.mp4", [(48, 64, 3), (48, 66, 3)], r"frame 1 is uint8 \(48, 66, 3\), not uint8 \(48, 64, 3\)"),
    ],
)
def test_write_video_refuses(tmp_path, name, shapes, message):
    with pytest.raises(ValueError, match=message):
        write_video(tmp_path / name, [np.zeros(shape, np.uint8) for shape in shapes])
    assert list(tmp_path.iterdir()) == []
