"""The viscous friction of A.2 as a passive force of MuJoCo, compiled.

    with viscous_friction():
        mujoco.mj_step(model, data)

Inside the scope, every model that declares the friction (:mod:`swimmer_mj.mjcf`) feels it in each
evaluation of its forces: ``mj_step``, ``mj_forward``, ``mj_inverse``, ``mujoco.rollout``, ``mujoco.batch``,
from any number of threads and without the GIL. No other model feels anything. After the last scope,
MuJoCo's callback is what it was before.

A rod of length l with unit vector t along it, velocity v of its centre and angular velocity w feels, as the
integral of A.2's dF = -k (v . n) n dlambda over its length,

    F = -k l (v - (v . t) t)                at its centre
    M = -k l^3 / 12 (w - (w . t) t)

which in the plane is F_i = -k l_i (G'_i . n_i) n_i and M_i = -k theta'_i l_i^3 / 12. MuJoCo's callback is
one for the whole process, hence a count of its holders here. MuJoCo calls no passive callback on a model
that disables both its springs and its dampers.

The compiled code reads MuJoCo's structs directly. Where their fields lie differs between versions of
MuJoCo: it is worked out from the installed version's own tables (``mujoco.introspect``) and checked against
what its Python bindings report, before the callback is first installed.
"""

# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false, reportCallIssue=false
# (MuJoCo's bindings and numba carry no types.)
from __future__ import annotations

import ctypes
import functools
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numba
import numpy as np
from llvmlite import ir
from mujoco.introspect import ast_nodes, structs
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from swimmer_mj.mjcf import FRICTION_TUPLE, mjcf
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["acquire", "hold", "release", "viscous_friction"]

_VALUE_TYPES: dict[str, Any] = {
    "int": ctypes.c_int,
    "mjtBool": ctypes.c_bool,
    "mjtByte": ctypes.c_ubyte,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "float": ctypes.c_float,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
}

_MODEL_SIZES = ("nbody", "nsite", "nv", "ntuple", "ntupledata", "nnames")
_MODEL_ARRAYS = (
    "body_rootid",
    "body_weldid",
    "body_dofnum",
    "body_dofadr",
    "dof_parentid",
    "site_type",
    "site_bodyid",
    "site_size",
    "tuple_adr",
    "tuple_size",
    "tuple_objtype",
    "tuple_objid",
    "tuple_objprm",
    "name_tupleadr",
    "names_map",
    "names",  # last: it is read through only when its neighbours in the struct have been found in place
)
_DATA_ARRAYS = ("site_xpos", "site_xmat", "subtree_com", "cdof", "cvel", "qfrc_passive")


def _c_type(declaration: Any) -> Any:
    """The ctypes type of a C type of MuJoCo's introspection tables."""
    match declaration:
        case ast_nodes.PointerType():
            return ctypes.c_void_p
        case ast_nodes.ArrayType():
            c_type = _c_type(declaration.inner_type)
            for extent in reversed(declaration.extents):
                c_type = c_type * extent
            return c_type
        case ast_nodes.ValueType() if declaration.name in structs.STRUCTS:
            return _c_struct(structs.STRUCTS[declaration.name])
        case ast_nodes.ValueType() if declaration.name in _VALUE_TYPES:
            return _VALUE_TYPES[declaration.name]
        case ast_nodes.AnonymousStructDecl() if not isinstance(declaration, ast_nodes.AnonymousUnionDecl):
            return _c_struct(declaration)
    raise RuntimeError(f"MuJoCo {mujoco.__version__} has a struct field of unknown type: {declaration}")


def _c_struct(declaration: Any) -> type[ctypes.Structure]:
    """A struct of MuJoCo's introspection tables, laid out as the C compiler does."""
    fields = [(field.name, _c_type(field.type)) for field in declaration.fields]
    return type("Struct", (ctypes.Structure,), {"_fields_": fields})


def _record(name: str, fields: tuple[str, ...]) -> np.dtype:
    """The C struct ``name`` as a NumPy record of some of its fields; pointers are addresses."""
    struct = _c_struct(structs.STRUCTS[name])
    return np.dtype(
        {
            "names": fields,
            "formats": [np.int64] * len(fields),
            "offsets": [getattr(struct, field).offset for field in fields],
            "itemsize": ctypes.sizeof(struct),
        }
    )


def _check(record: np.dtype, view: Any, address: int) -> None:
    """Raise RuntimeError unless the fields of ``record`` at ``address`` are those the bindings report."""
    fields = np.frombuffer(ctypes.string_at(address, record.itemsize), record)[0]
    for name in record.names or ():
        value = getattr(view, name)
        if isinstance(value, bytes):  # names, of which the bindings give a copy: a pointer to follow
            expected, found = value, ctypes.string_at(int(fields[name]), len(value))
        else:
            expected, found = value if isinstance(value, int) else value.ctypes.data, fields[name]
        if found != expected:
            raise RuntimeError(
                f"the viscous friction cannot be used with MuJoCo {mujoco.__version__}: "
                f"{type(view).__name__}.{name} is not where its introspection tables place it"
            )


def _records() -> tuple[np.dtype, np.dtype]:
    """Describe mjModel and mjData of the installed MuJoCo as records, checked on a swimmer."""
    model_record = _record("mjModel", _MODEL_SIZES + _MODEL_ARRAYS)
    data_record = _record("mjData", _DATA_ARRAYS)
    model = mujoco.MjModel.from_xml_string(mjcf(SwimmerParameters(n_links=3)))
    data = mujoco.MjData(model)
    _check(model_record, model, model._address)
    _check(data_record, data, data._address)
    return model_record, data_record


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:
    """An integer address as a void pointer, for :func:`numba.carray`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), codegen


@intrinsic
def _call(typing_context: Any, address: Any, model: Any, data: Any) -> Any:
    """Call the C function ``void (void*, void*)`` at an integer address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        function = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, cgutils.voidptr_t])
        pointers = [builder.bitcast(pointer, cgutils.voidptr_t) for pointer in args[1:]]
        builder.call(builder.inttoptr(args[0], function.as_pointer()), pointers)
        return context.get_dummy_value()

    return types.void(types.int64, model, data), codegen


@functools.cache
def _compiled() -> tuple[Any, np.ndarray[Any, np.dtype[np.int64]]]:
    """The friction as a C function of (const mjModel*, mjData*), compiled for the installed MuJoCo.

    With it comes the place, shape (1,), of the address of the C function to call before; 0 for none.
    """
    model_record, data_record = _records()
    before = np.zeros(1, dtype=np.int64)
    place_of_before = before.ctypes.data
    friction_name = np.frombuffer(FRICTION_TUPLE.encode(), dtype=np.uint8)
    n_name = len(friction_name)
    site_object = int(mujoco.mjtObj.mjOBJ_SITE)
    capsule = int(mujoco.mjtGeom.mjGEOM_CAPSULE)

    model_pointer = types.CPointer(numba.from_dtype(model_record))
    data_pointer = types.CPointer(numba.from_dtype(data_record))

    @numba.cfunc(types.void(model_pointer, data_pointer), error_model="numpy")
    def friction(model: Any, data: Any) -> None:
        called_before = numba.carray(_pointer(place_of_before), 1, np.int64)[0]
        if called_before != 0:
            _call(called_before, model, data)
        m = numba.carray(model, 1)[0]
        if m.ntuple == 0:
            return
        d = numba.carray(data, 1)[0]
        names = numba.carray(_pointer(m.names), m.nnames, np.uint8)
        name_tupleadr = numba.carray(_pointer(m.name_tupleadr), m.ntuple, np.int32)
        tuple_adr = numba.carray(_pointer(m.tuple_adr), m.ntuple, np.int32)
        tuple_size = numba.carray(_pointer(m.tuple_size), m.ntuple, np.int32)
        tuple_objtype = numba.carray(_pointer(m.tuple_objtype), m.ntupledata, np.int32)
        tuple_objid = numba.carray(_pointer(m.tuple_objid), m.ntupledata, np.int32)
        tuple_objprm = numba.carray(_pointer(m.tuple_objprm), m.ntupledata, np.float64)
        site_type = numba.carray(_pointer(m.site_type), m.nsite, np.int32)
        site_bodyid = numba.carray(_pointer(m.site_bodyid), m.nsite, np.int32)
        site_size = numba.carray(_pointer(m.site_size), (m.nsite, 3), np.float64)
        body_rootid = numba.carray(_pointer(m.body_rootid), m.nbody, np.int32)
        body_weldid = numba.carray(_pointer(m.body_weldid), m.nbody, np.int32)
        body_dofnum = numba.carray(_pointer(m.body_dofnum), m.nbody, np.int32)
        body_dofadr = numba.carray(_pointer(m.body_dofadr), m.nbody, np.int32)
        dof_parentid = numba.carray(_pointer(m.dof_parentid), m.nv, np.int32)
        site_xpos = numba.carray(_pointer(d.site_xpos), (m.nsite, 3), np.float64)
        site_xmat = numba.carray(_pointer(d.site_xmat), (m.nsite, 9), np.float64)
        subtree_com = numba.carray(_pointer(d.subtree_com), (m.nbody, 3), np.float64)
        cdof = numba.carray(_pointer(d.cdof), (m.nv, 6), np.float64)
        cvel = numba.carray(_pointer(d.cvel), (m.nbody, 6), np.float64)
        qfrc_passive = numba.carray(_pointer(d.qfrc_passive), m.nv, np.float64)

        for i in range(m.ntuple):
            end = int(name_tupleadr[i])
            while names[end] != 0:
                end += 1
            declared = end - name_tupleadr[i] >= n_name
            for c in range(n_name):
                declared = declared and names[end - n_name + c] == friction_name[c]
            if not declared:
                continue
            for j in range(tuple_adr[i], tuple_adr[i] + tuple_size[i]):
                site = tuple_objid[j]
                if tuple_objtype[j] != site_object or site_type[site] != capsule:
                    continue
                body = site_bodyid[site]
                moving = body_weldid[body]  # 0: the rod is welded to the world
                if body_dofnum[moving] == 0:
                    continue
                k, l = tuple_objprm[j], 2 * site_size[site, 1]
                root = body_rootid[body]
                tx, ty, tz = site_xmat[site, 2], site_xmat[site, 5], site_xmat[site, 8]
                # MuJoCo's cvel and cdof are spatial vectors (angular, linear) about the tree's centre of mass
                rx = site_xpos[site, 0] - subtree_com[root, 0]
                ry = site_xpos[site, 1] - subtree_com[root, 1]
                rz = site_xpos[site, 2] - subtree_com[root, 2]
                wx, wy, wz = cvel[body, 0], cvel[body, 1], cvel[body, 2]
                vx = cvel[body, 3] + wy * rz - wz * ry
                vy = cvel[body, 4] + wz * rx - wx * rz
                vz = cvel[body, 5] + wx * ry - wy * rx

                along = vx * tx + vy * ty + vz * tz
                Fx = -k * l * (vx - along * tx)
                Fy = -k * l * (vy - along * ty)
                Fz = -k * l * (vz - along * tz)
                about = wx * tx + wy * ty + wz * tz
                moment = -k * l**3 / 12
                Mx = moment * (wx - about * tx) + ry * Fz - rz * Fy
                My = moment * (wy - about * ty) + rz * Fx - rx * Fz
                Mz = moment * (wz - about * tz) + rx * Fy - ry * Fx

                dof = body_dofadr[moving] + body_dofnum[moving] - 1
                while dof >= 0:
                    qfrc_passive[dof] += (
                        cdof[dof, 0] * Mx
                        + cdof[dof, 1] * My
                        + cdof[dof, 2] * Mz
                        + cdof[dof, 3] * Fx
                        + cdof[dof, 4] * Fy
                        + cdof[dof, 5] * Fz
                    )
                    dof = dof_parentid[dof]

    return friction, before


class _SharedCallback:
    """The holders of MuJoCo's passive callback: installed for the first, restored after the last."""

    def __init__(self) -> None:
        # Re-entrant, because a garbage collection inside acquire() may run a holder's release().
        self._lock = threading.RLock()
        self._holders = 0
        self._installed: Callable[..., None] | None = None
        self._previous: Callable[..., None] | None = None
        # A process forked by another thread inside acquire() would find the lock taken for ever.
        os.register_at_fork(
            before=self._lock.acquire, after_in_parent=self._lock.release, after_in_child=self._lock.release
        )

    def acquire(self) -> None:
        with self._lock:
            friction, before = _compiled()  # before anything changes: it may raise
            self._holders += 1  # first: no release() in a garbage collection from here on is the last one
            current = mujoco.get_mjcb_passive()
            if self._installed is not None and current is not self._installed:
                self.release()
                raise RuntimeError(
                    "MuJoCo's passive callback was replaced while the viscous friction was in force; "
                    "set your own callback first, and the friction will call it"
                )
            if self._installed is None:
                before[0], installed = 0, friction.ctypes
                if isinstance(current, ctypes._CFuncPtr):
                    before[0] = ctypes.cast(current, ctypes.c_void_p).value or 0
                elif current is not None:
                    installed = _after(current, friction)
                mujoco.set_mjcb_passive(installed)
                self._previous, self._installed = current, installed

    def release(self) -> None:
        with self._lock:
            if self._holders == 0:
                raise RuntimeError("the viscous friction was released more often than acquired")
            self._holders -= 1
            if self._holders == 0 and self._installed is not None:
                if mujoco.get_mjcb_passive() is self._installed:  # else it is no longer ours to restore
                    mujoco.set_mjcb_passive(self._previous)
                self._installed = self._previous = None


def _after(callback: Callable[..., None], friction: Any) -> Callable[[Any, Any], None]:
    """A callback that calls one from Python and then the friction; as slow as any from Python."""
    add_friction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(friction.address)

    def both(model: Any, data: Any) -> None:
        callback(model, data)
        add_friction(model._address, data._address)

    return both


_shared = _SharedCallback()  # one, as MuJoCo's callback is


def acquire() -> None:
    """Put the friction in force until :func:`release`; calls may nest and come from any thread.

    A passive callback found installed keeps running, before the friction. If it is compiled (a ctypes
    function), the two are joined in C. If it is Python's, they are joined in Python: as slow as it was before,
    and as before ``mujoco.batch`` refuses it and no model compiles meanwhile.

    Raises
    ------
    RuntimeError
        The installed MuJoCo's structs are not as its tables say, or another callback has meanwhile taken
        the friction's place.
    """
    _shared.acquire()


def release() -> None:
    """Undo one :func:`acquire`; the last one restores the callback that was found at the first."""
    _shared.release()


@contextmanager
def viscous_friction() -> Iterator[None]:
    """The friction in force inside a ``with`` block, also when it is left by an exception."""
    acquire()
    try:
        yield
    finally:
        release()


def hold(owner: object) -> weakref.finalize:
    """Keep the friction in force while ``owner`` lives.

    Returns
    -------
    weakref.finalize
        Call it to release sooner; further calls do nothing.
    """
    acquire()
    return weakref.finalize(owner, release)
