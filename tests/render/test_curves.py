import dataclasses

import numpy as np
import pytest
from matplotlib.image import imread

from swimmer_mj import SwimmerParameters
from swimmer_mj.render.curves import METRICS, learning_curve, read_metrics, rollout_plot
from swimmer_mj.render.figures import save_figure
from swimmer_mj.trajectory import Trajectory

ROWS = np.array(
    [
        # trial, seconds, mean_value, mean_squared_hamiltonian, speed
        [0, 0.1, -0.2, 0.9, 0.01],
        [2000, 4.2, 0.4, 0.5, 0.62],
        [4000, 8.3, 0.9, 0.2, 1.31],
        [6000, 12.4, 1.0, 0.1, 1.12],
    ]
)


@pytest.fixture
def metrics(tmp_path):
    """Write rows to a metrics.csv."""

    def write(rows=ROWS, header=METRICS, end="", name="metrics.csv"):
        lines = [",".join(header), *(",".join(str(value) for value in row) for row in rows)]
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n" + end)
        return path

    return write


def assert_png(figure, path):
    save_figure(figure, path, dpi=80)
    pixels = imread(path)[..., :3]
    width, height = figure.get_size_inches()
    assert pixels.shape == (int(80 * height), int(80 * width), 3)
    assert (pixels.min(axis=-1) < 0.5).mean() > 0.01
    edges = [pixels[:2].reshape(-1, 3), pixels[-2:].reshape(-1, 3), pixels[:, :2].reshape(-1, 3)]
    np.testing.assert_array_equal(np.concatenate([*edges, pixels[:, -2:].reshape(-1, 3)]), 1.0)


def test_read_metrics_returns_the_columns(metrics):
    columns = read_metrics(metrics())
    assert tuple(columns) == METRICS
    np.testing.assert_array_equal(np.array(list(columns.values())).T, ROWS)


def test_read_metrics_finds_columns_by_name(metrics):
    order = ["speed", "note", *METRICS[:4]]
    rows = np.column_stack([ROWS[:, 4], np.zeros(4), ROWS[:, :4]])
    np.testing.assert_array_equal(read_metrics(metrics(rows, order))["speed"], ROWS[:, 4])


def test_a_line_still_being_written_is_left_out(metrics):
    assert read_metrics(metrics(end="8000,16.5,1.0"))["trial"].size == 4


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ({"rows": [], "header": METRICS[:4]}, "metrics.csv lacks the column 'speed'"),
        ({"rows": []}, "metrics.csv has no rows"),
        ({"end": "8000,16.5,1.0\n"}, "metrics.csv, line 6: "),
        (
            {"end": "8000,16.5,1.0,fast,0.1\n"},
            "metrics.csv, line 6: could not convert string to float: 'fast'",
        ),
    ],
)
def test_read_metrics_refuses(metrics, written, message):
    with pytest.raises(ValueError, match=message):
        read_metrics(metrics(**written))


def test_learning_curve_draws_each_run_against_trials(metrics, tmp_path):
    slower = ROWS * [1, 1, 0.5, 2.0, 0.5]
    runs = [("seed 0", metrics()), ("seed 1", metrics(slower, name="slower.csv"))]
    figure = learning_curve(runs, reference_speed=0.61)
    value, hamiltonian, speed = figure.axes
    for axes, column in ((value, 2), (hamiltonian, 3), (speed, 4)):
        curves = [line for line in axes.lines if len(line.get_xdata()) == 4]
        for line, rows in zip(curves, (ROWS, slower), strict=True):
            np.testing.assert_array_equal(line.get_xydata(), rows[:, [0, column]])
    assert [text.get_text() for text in value.get_legend().get_texts()] == ["seed 0", "seed 1"]
    assert [axes.get_ylabel().split("(")[-1] for axes in figure.axes] == ["m)", "m$^2$/s$^2$)", "m/s)"]
    assert_png(figure, tmp_path / "curve.png")


def test_learners_of_two_methods_are_drawn_against_time(metrics):
    figure = learning_curve([("a", metrics()), ("b", metrics(name="b.csv"))], against="seconds")
    for axes in figure.axes:
        np.testing.assert_array_equal(axes.lines[0].get_xdata(), ROWS[:, 1])
    assert figure.axes[2].get_xlabel() == "learning  (s)"


def test_the_squared_hamiltonian_is_labelled_in_plain_numbers(metrics):
    figure = learning_curve([("a", metrics())])
    figure.draw_without_rendering()
    axis = figure.axes[1].yaxis
    assert {"0.1", "0.2", "0.5"} <= {tick.label1.get_text() for tick in axis.get_major_ticks()}
    assert not any(tick.label1.get_text() for tick in axis.get_minor_ticks())


def test_learning_curve_marks_the_best_evaluation_and_the_reference(metrics):
    speed = learning_curve([("seed 0", metrics())], reference_speed=0.61).axes[2]
    (star,) = [line for line in speed.lines if line.get_marker() == "*"]
    np.testing.assert_array_equal(star.get_xydata(), [[4000, 1.31]])
    (reference,) = [line for line in speed.lines if list(line.get_ydata()) == [0.61, 0.61]]
    assert reference.get_label() == "open-loop wave, 0.61 m/s"
    unmarked = learning_curve([("seed 0", metrics())]).axes[2]
    assert len(unmarked.lines) == len(speed.lines) - 1


def test_learning_curve_of_a_single_evaluation_without_a_speed(metrics, tmp_path):
    row = [[0, 0.1, 0.0, 0.0, np.nan]]
    figure = learning_curve([("seed 0", metrics(row))])
    assert_png(figure, tmp_path / "curve.png")


def test_learning_curve_needs_a_run():
    with pytest.raises(ValueError, match="at least one run"):
        learning_curve([])


def test_rollout_plot_shows_the_episode(episode, tmp_path):
    figure = rollout_plot(episode)
    angle, torque, speed, value, hamiltonian = figure.axes
    drawn = np.array([line.get_ydata() for line in angle.lines]).T
    np.testing.assert_allclose(drawn, np.degrees(episode.states[:, 2:7]))
    np.testing.assert_allclose(speed.lines[0].get_ydata(), episode.speeds())
    np.testing.assert_allclose(speed.lines[1].get_ydata(), episode.speed())
    np.testing.assert_array_equal(value.lines[0].get_ydata(), episode.values)
    np.testing.assert_array_equal(hamiltonian.lines[0].get_ydata(), episode.hamiltonians)
    assert [label.get_text() for label in torque.get_yticklabels()] == [
        "$u_{1}$",
        "$u_{2}$",
        "$u_{3}$",
        "$u_{4}$",
    ]
    assert_png(figure, tmp_path / "rollout.png")


def test_many_links_leave_room_for_the_panels(chain, tmp_path):
    figure = rollout_plot(chain(16))
    assert_png(figure, tmp_path / "rollout.png")
    assert all(axes.get_position().width > 0.7 for axes in figure.axes)


def test_a_torque_of_one_control_step_is_drawn(episode):
    controls = np.zeros((300, 4))
    controls[120, 2] = 5.0
    torque = rollout_plot(dataclasses.replace(episode, controls=controls)).axes[1]
    heights = {patch.get_data().values.max() for patch in torque.patches}
    assert -2 + 0.42 in heights


def test_rollout_plot_without_values_or_joints(tmp_path):
    parameters, times = SwimmerParameters(1), 0.1 * np.arange(11)
    unknown = np.full(11, np.nan)
    lone = Trajectory(parameters, times, np.ones((11, 6)), np.empty((10, 0)), np.zeros(11), unknown, unknown)
    figure = rollout_plot(lone)
    assert figure.axes[1].get_ylabel() == "no joints"
    assert figure.axes[3].get_ylabel() == ""
    assert_png(figure, tmp_path / "rollout.png")
