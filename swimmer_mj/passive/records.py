"""MuJoCo's structs as compiled code sees them: records whose fields lie where the installed version has them.

Where the fields of mjModel and mjData lie differs between versions of MuJoCo. It is worked out from the installed
version's own tables (``mujoco.introspect``) and checked against what its Python bindings report.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import ctypes
import functools
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import ast_nodes, structs

__all__ = ["records"]

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

_MODEL_FIELDS = (
    "nbody",
    "nsite",
    "nv",
    "nnumeric",
    "nnumericdata",
    "ntuple",
    "ntupledata",
    "nnames",
    "body_rootid",
    "body_weldid",
    "body_dofnum",
    "body_dofadr",
    "dof_parentid",
    "site_type",
    "site_bodyid",
    "site_size",
    "numeric_adr",
    "numeric_size",
    "numeric_data",
    "tuple_adr",
    "tuple_size",
    "tuple_objtype",
    "tuple_objid",
    "tuple_objprm",
    "name_siteadr",
    "name_tupleadr",
    "names_map",
    "names",  # last: it is read through only when its neighbours in the struct have been found in place
)
_DATA_FIELDS = ("time", "site_xpos", "site_xmat", "subtree_com", "cdof", "cvel", "qfrc_passive")

# No two of its sizes are equal, so that none can be taken for another.
_SAMPLE = """
<mujoco>
  <worldbody>
    <body><freejoint/><geom size="1"/><body/><body/><body/><site name="a"/><site name="b"/><site/></body>
  </worldbody>
  <custom>
    <numeric name="a" data="1 2 3"/>
    <numeric name="b" data="1 2 3 4"/>
    <tuple name="a">
      <element objtype="site" objname="a"/>
      <element objtype="numeric" objname="a"/>
      <element objtype="site" objname="b"/>
      <element objtype="numeric" objname="b"/>
    </tuple>
  </custom>
</mujoco>
"""


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
    struct: Any = _c_struct(structs.STRUCTS[name])
    numbers = {field for field, c_type in struct._fields_ if c_type is ctypes.c_double}
    return np.dtype(
        {
            "names": fields,
            "formats": [np.float64 if field in numbers else np.int64 for field in fields],
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
            expected = value if isinstance(value, int | float) else value.ctypes.data
            found = fields[name]
        if found != expected:
            raise RuntimeError(
                f"compiled passive forces cannot be used with MuJoCo {mujoco.__version__}: "
                f"{type(view).__name__}.{name} is not where its introspection tables place it"
            )


@functools.cache
def records() -> tuple[np.dtype, np.dtype]:
    """What compiled passive forces read of mjModel and mjData, as records of the installed MuJoCo.

    Raises
    ------
    RuntimeError
        Its structs are not as its tables say.
    """
    model_record = _record("mjModel", _MODEL_FIELDS)
    data_record = _record("mjData", _DATA_FIELDS)
    model = mujoco.MjModel.from_xml_string(_SAMPLE)
    data = mujoco.MjData(model)
    data.time = 1.5
    _check(model_record, model, model._address)
    _check(data_record, data, data._address)
    return model_record, data_record
