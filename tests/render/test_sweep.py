import pytest

from swimmer_mj.render.sweep import sweep_plot

NAMES = ("eta", "s_lambda", "s_gamma", "neurons", "trial_duration", "output_scaling", "damping", "length")


@pytest.mark.parametrize("count", [0, 1, 4, 8])
def test_the_picture_is_whole_however_many_settings_differ(check_whole, count):
    rows = [
        {"job": "", "seed": seed, **dict.fromkeys(NAMES[:count], 0.01234 + k), "trials": 1, "seconds": 1.0,
         "speed": 0.1 * k + 0.01 * seed, "last_speed": 0.0, "state": "diverged" if seed == 2 else "done"}
        for k in range(4)
        for seed in range(3)
    ]  # fmt: skip
    check_whole(sweep_plot(rows))
