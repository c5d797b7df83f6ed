"""MuJoCo's structs are where its tables say, or nothing runs."""

import ctypes

import mujoco
import numpy as np
import pytest

from swimmer_mj.dynamics import MujocoSwimmer
from swimmer_mj.environments.simulation import Simulation
from swimmer_mj.parameters import PAPER
from swimmer_mj.passive import evaluation, laws, records
from swimmer_mj.passive.callback import SharedCallback
from swimmer_mj.viscous import viscous_friction


@pytest.fixture
def shift(monkeypatch):
    """A function that puts one field more in front of a struct, as another version of MuJoCo may have it."""
    layout = records._c_struct

    def shift(name):
        def shifted(declaration):
            struct = layout(declaration)
            if getattr(declaration, "name", "") != name:
                return struct
            fields = [("new", ctypes.c_void_p), *struct._fields_]
            return type("Struct", (ctypes.Structure,), {"_fields_": fields})

        monkeypatch.setattr(records, "_c_struct", shifted)
        monkeypatch.setattr(evaluation, "records", records.records.__wrapped__)
        monkeypatch.setattr(laws, "_shared", SharedCallback())  # that knows nothing from earlier tests

    return shift


@pytest.mark.parametrize(("struct", "field"), [("mjModel", "MjModel.nbody"), ("mjData", "MjData.time")])
def test_a_wrong_mujoco_is_refused_before_anything_is_stepped(shift, struct, field):
    shift(struct)
    message = rf"cannot be used with MuJoCo {mujoco.__version__}: {field} is not where"
    with pytest.raises(RuntimeError, match=message):
        Simulation(PAPER)
    with pytest.raises(RuntimeError, match=message), viscous_friction():
        pytest.fail("the scope was entered")
    assert mujoco.get_mjcb_passive() is None
    MujocoSwimmer(PAPER, "actuators").derivative(np.zeros(14), np.ones(4))  # needs no struct
