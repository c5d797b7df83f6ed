import math
from pathlib import Path

import pytest

from swimmer_mj.cli.shots import PICTURES, Shot, Steering, parse_steering, place_of, places_in


def test_steering_goes_from_direction_to_direction_and_stays_with_the_last():
    steering = parse_steering("0,90, -180@2s")
    assert steering == Steering((0.0, math.pi / 2, -math.pi), 2.0)
    assert steering.duration == 6.0
    times = (0.0, 1.99, 2.0, 3.9, 4.0, 100.0)
    assert [round(math.degrees(steering(time))) for time in times] == [0, 0, 90, 90, -180, -180]
    assert parse_steering("45@.5") == Steering((math.pi / 4,), 0.5)
    fine = parse_steering("0,1,2,3@0.1")
    assert [round(math.degrees(fine(k / 100))) for k in (9, 10, 19, 20, 29, 30)] == [0, 1, 1, 2, 2, 3]


@pytest.mark.parametrize(
    "text", ["", "0,90", "0,90@", "@2s", "0;90@2", "0,,90@2", "north@2s", "0@nan", "0@2m"]
)
def test_what_is_no_steering_is_refused(text):
    with pytest.raises(
        ValueError, match=r"--steer must be directions in degrees .* such as 0,90,180@2s, got"
    ) as error:
        parse_steering(text)
    assert repr(text) in str(error.value)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"duration": 3.0, "steering": Steering((0.0, 1.0), 2.0)}, "--steer takes 4 s, --duration is 3 s"),
        ({"at": 13.5}, "--at must be between 0 and 13 s, the episode, got 13.5"),
        ({"at": math.nan}, "--at must be between 0 and 13 s"),
        ({"fps": 1000}, "--fps at most 240, got 13.0 and 1000"),
    ],
)
def test_a_shot_that_cannot_be_is_refused(options, complaint):
    with pytest.raises(ValueError, match=complaint):
        Shot(**options)


def test_a_steering_of_no_time_is_refused():
    with pytest.raises(ValueError, match=r"--steer must hold each direction for 0.01 to 3600 s, got 0 s"):
        parse_steering("0,90@0")


def test_sizes_and_slow_motion():
    shot = Shot(size="1920x1080", slow=True)
    assert (shot.width, shot.height, shot.samples, shot.slowness) == (1920, 1080, 4, 4.0)
    assert (Shot().width, Shot().height, Shot().samples, Shot().slowness) == (640, 480, 0, 1.0)


@pytest.mark.parametrize(
    ("name", "picture", "place"),
    [
        ("a.gif", None, "video"),
        ("a.webp", None, "video"),
        ("a.mov", "video", "video"),
        ("a.svg", None, "film-strip"),
        ("a.pdf", "gait", "gait"),
        ("folder", None, None),
        ("folder.d", None, None),
        ("of-version-0.2", None, None),
    ],
)
def test_a_suffix_says_what_is_drawn(name, picture, place):
    assert place_of(Path(name), picture, 30) == (None if place is None else {place: Path(name)})


def test_a_directory_may_be_called_anything(tmp_path):
    for name in ("runs.pdf", "runs.old"):
        (tmp_path / name).mkdir()
        assert place_of(tmp_path / name, None, 30) is None
    assert places_in(tmp_path) == {name: tmp_path / file for name, file in PICTURES.items()}
    assert places_in(tmp_path, "gait") == {"gait": tmp_path / "gait.png"}


@pytest.mark.parametrize(
    ("name", "picture", "fps", "complaint"),
    [
        ("a.gif", None, 60, "--fps must be at most 50 for a GIF"),
        ("a.mp4", "gait", 30, r"a gait is written as \.png, \.svg, \.pdf, got a\.mp4"),
        ("a.png", "video", 30, r"a video is written as \.mp4, \.mkv, \.mov, \.gif, \.webp, got a\.png"),
        (
            "a.avi",
            None,
            30,
            r"written as \.mp4, .* \.pdf, got a\.avi; if that is to be a directory, make it before",
        ),
        ("a.jpg", "gait", 30, r"written as \.mp4, .* \.pdf, got a\.jpg"),
        ("a.GIF", None, 30, r"the suffix of a picture is written \.gif, got a\.GIF"),
    ],
)
def test_suffixes_that_do_not_fit_are_refused(name, picture, fps, complaint):
    with pytest.raises(ValueError, match=complaint):
        place_of(Path(name), picture, fps)
