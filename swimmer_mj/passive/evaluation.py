"""All laws in force evaluated on one model: what runs, compiled, in each evaluation of the forces.

Velocities and forces pass between a site and the model's degrees of freedom by MuJoCo's spatial vectors: ``cvel`` of
a body and ``cdof`` of a degree of freedom are (angular, linear) about the centre of mass of the body's tree.
"""

# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false, reportCallIssue=false
# (MuJoCo's bindings and numba carry no types.)
from __future__ import annotations

import math
from typing import Any

import mujoco
import numba
import numpy as np
from numba import njit, types

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import address_of, call, load, load_vector, pointer, store, store_vector
from swimmer_mj.compiled.vectors import stack_buffer
from swimmer_mj.passive.failures import NO_PARAMETERS, NOT_A_SITE, NOT_FINITE, STATE, WRONG_SHAPE, note
from swimmer_mj.passive.records import records
from swimmer_mj.passive.site import N_NUMBERS, Vector

__all__ = ["address", "evaluate"]

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_NUMERIC = int(mujoco.mjtObj.mjOBJ_NUMERIC)

_compiled = njit(
    error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)  # compiled code calls them


@_compiled
def _ends_with(m: Any, start: int, s: Any) -> bool:
    """Whether the name that starts at ``start`` ends with the law's."""
    end = start
    while load(np.uint8, m.names, end, m.nnames) != 0:
        end += 1
    n = s.n_name
    if end - start < n:
        return False
    c = 0
    while c < n and load(np.uint8, m.names, end - n + c, m.nnames) == load(np.uint8, s.name, c, n):
        c += 1
    return c == n


@_compiled
def _fault(m: Any, s: Any, j: int, end: int) -> int:
    """What is wrong with a site at the place ``j`` of a tuple's elements that ends before ``end``; 0 for nothing."""
    site = load(np.int32, m.tuple_objid, j, m.ntupledata)
    if load(np.int32, m.tuple_objtype, j, m.ntupledata) != _SITE or not 0 <= site < m.nsite:
        return NOT_A_SITE
    if s.shape >= 0 and load(np.int32, m.site_type, site, m.nsite) != s.shape:
        return WRONG_SHAPE
    if s.n_parameters > 1:
        if j + 1 == end or load(np.int32, m.tuple_objtype, j + 1, m.ntupledata) != _NUMERIC:
            return NO_PARAMETERS
        numeric = load(np.int32, m.tuple_objid, j + 1, m.ntupledata)
        if load(np.int32, m.numeric_size, numeric, m.nnumeric) != s.n_parameters:
            return NO_PARAMETERS
    return 0


@_compiled
def _parameters(m: Any, s: Any, j: int) -> int:
    """The address of the parameters of the site at the place ``j`` of the tuples' elements."""
    if s.n_parameters < 2:
        return m.tuple_objprm + 8 * j
    numeric = load(np.int32, m.tuple_objid, j + 1, m.ntupledata)
    return m.numeric_data + 8 * load(np.int32, m.numeric_adr, numeric, m.nnumeric)


@_compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
def _lever(m: Any, d: Any, site: int) -> Vector:
    """From the centre of mass of the site's tree to the site."""
    root = load(np.int32, m.body_rootid, load(np.int32, m.site_bodyid, site, m.nsite), m.nbody)
    x, c = load_vector(d.site_xpos, site, m.nsite), load_vector(d.subtree_com, root, m.nbody)
    return x[0] - c[0], x[1] - c[1], x[2] - c[2]


@_compiled
def _read_site(m: Any, d: Any, site: int, r: Vector, to: int) -> None:
    """Write the numbers of a :class:`~swimmer_mj.passive.site.Site` at the lever ``r`` to an address."""
    body = load(np.int32, m.site_bodyid, site, m.nsite)
    w, v = load_vector(d.cvel, 2 * body, 2 * m.nbody), load_vector(d.cvel, 2 * body + 1, 2 * m.nbody)
    turned = _cross(w, r)
    v = v[0] + turned[0], v[1] + turned[1], v[2] + turned[2]
    store_vector(to, 0, 7, load_vector(d.site_xpos, site, m.nsite))
    for j in range(3):
        for i in range(3):  # the rows of the matrix are columns here
            component = load(np.float64, d.site_xmat, 9 * site + 3 * i + j, 9 * m.nsite)
            store(np.float64, to, 3 + 3 * j + i, N_NUMBERS, component)
    store_vector(to, 4, 7, load_vector(m.site_size, site, m.nsite))
    store_vector(to, 5, 7, v)
    store_vector(to, 6, 7, w)
    store(np.float64, to, N_NUMBERS - 1, N_NUMBERS, d.time)


@_compiled
def _finite(numbers: int, n: int) -> bool:
    """Whether ``n`` numbers at an address are finite, and their sum is."""
    total = 0.0
    for i in range(n):
        total += load(np.float64, numbers, i, n)
    return math.isfinite(total)


@_compiled
def _add_force(m: Any, d: Any, moving: int, r: Vector, force: Vector, moment: Vector) -> None:
    """Add a force at a site on the body ``moving``, and a moment, to ``qfrc_passive`` of all that moves it."""
    turning = _cross(r, force)
    M = moment[0] + turning[0], moment[1] + turning[1], moment[2] + turning[2]
    first, n = load(np.int32, m.body_dofadr, moving, m.nbody), load(np.int32, m.body_dofnum, moving, m.nbody)
    dof = first + n - 1
    while dof >= 0:
        w, v = load_vector(d.cdof, 2 * dof, 2 * m.nv), load_vector(d.cdof, 2 * dof + 1, 2 * m.nv)
        power = w[0] * M[0] + w[1] * M[1] + w[2] * M[2] + v[0] * force[0] + v[1] * force[1] + v[2] * force[2]
        store(np.float64, d.qfrc_passive, dof, m.nv, load(np.float64, d.qfrc_passive, dof, m.nv) + power)
        dof = load(np.int32, m.dof_parentid, dof, m.nv)


@_compiled
def _act(m: Any, d: Any, s: Any, j: int, moving: int, name: int, element: int) -> None:
    """Add the law's force on the site at the place ``j`` of the tuples' elements; no number if the law failed.

    If the state was no longer finite, what follows from it is no failure of the law.
    """
    site = load(np.int32, m.tuple_objid, j, m.ntupledata)
    numbers, result = address_of(stack_buffer(N_NUMBERS)), address_of(stack_buffer(6))
    r = _lever(m, d, site)
    _read_site(m, d, site, r, numbers)
    parameters = _parameters(m, s, j)
    kind = call(np.int64, s.law, (0, numbers, parameters, result))
    force, moment = load_vector(result, 0, 2), load_vector(result, 1, 2)
    if kind != 0:
        force = moment = (math.nan, math.nan, math.nan)
    elif not _finite(result, 6) and _finite(numbers, N_NUMBERS):
        kind = NOT_FINITE
    _add_force(m, d, moving, r, force, moment)
    if kind != 0:
        names = name, load(np.int32, m.name_siteadr, site, m.nsite)
        note(s, kind, element, m, names, numbers, parameters)


@_compiled
def _act_on_tuple(m: Any, d: Any, s: Any, i: int) -> None:
    """Add the forces on the sites of tuple ``i``; no number at all if it is no declaration of the law."""
    name = load(np.int32, m.name_tupleadr, i, m.ntuple)
    start = load(np.int32, m.tuple_adr, i, m.ntuple)
    end = start + load(np.int32, m.tuple_size, i, m.ntuple)
    step = 1 if s.n_parameters < 2 else 2
    for j in range(start, end, step):
        fault = _fault(m, s, j, end)
        if fault != 0:
            for dof in range(m.nv):
                store(np.float64, d.qfrc_passive, dof, m.nv, math.nan)
            note(s, fault, j - start, m, (name, m.nnames - 1), 0, 0)
            return
        body = load(np.int32, m.site_bodyid, load(np.int32, m.tuple_objid, j, m.ntupledata), m.nsite)
        moving = load(np.int32, m.body_weldid, body, m.nbody)
        if load(np.int32, m.body_dofnum, moving, m.nbody) > 0:  # else it is welded to the world
            _act(m, d, s, j, moving, name, j - start)


@entry_point(error_model="numpy", no_cpython_wrapper=True)
def evaluate(model: Any, data: Any, table: int) -> None:
    """Add the forces of all laws of a table to ``qfrc_passive``, after calling the callback that was there before.

    Parameters
    ----------
    model, data
        Pointers to records of mjModel and mjData.
    table : int
        Address of 64-bit integers: that of this function, which is not looked at, and of the callback to call before, 0
        for none; the number of laws; the addresses of their records :data:`~swimmer_mj.passive.failures.STATE`.
    """
    before, n = load(np.int64, table, 1, 3), load(np.int64, table, 2, 3)
    if before != 0:
        call(None, before, (model, data))
    m = numba.carray(model, 1)[0]
    if m.ntuple == 0:
        return
    d = numba.carray(data, 1)[0]
    for k in range(n):
        s = numba.carray(pointer(load(np.int64, table, 3 + k, 3 + n)), 1, STATE)[0]
        for i in range(m.ntuple):
            if _ends_with(m, load(np.int32, m.name_tupleadr, i, m.ntuple), s):
                _act_on_tuple(m, d, s, i)


def address() -> int:
    """The address of :func:`evaluate`, as a C function of three pointers; it is there until the process ends.

    Raises
    ------
    RuntimeError
        The installed MuJoCo's structs are not as its tables say.
    """
    pointers = [types.CPointer(numba.from_dtype(record)) for record in records()]
    return evaluate.address(*pointers, types.int64)
