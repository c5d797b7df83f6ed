"""Value gradients run on any torch device: here one that is made in Python, so that no GPU is needed."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch.utils.backend_registration as registration


@pytest.mark.skipif(
    not hasattr(registration, "_setup_privateuseone_for_python_backend"),
    reason="this torch cannot have a device in Python",
)
def test_a_learner_on_another_device_learns_the_same():
    program = Path(__file__).with_name("second_device.py")
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "the same within rounding\n"
