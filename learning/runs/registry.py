"""Problems and methods by name, and as JSON: "swim", or "my_module:DoublePendulum" for one's own.

To add one to the package, add its line here. One's own needs no line: it is a frozen dataclass, in a module that Python
finds, whose fields are its settings (numbers, strings, tuples, None, and dataclasses of these).

A name of one's own is code. What somebody types, or imports, is meant to run; what a file says is not: so reading a
configuration imports no module, and a run of one's own problem or method needs its module to have been imported before
(on the command line, ``--trust MODULE``).
"""

from __future__ import annotations

import dataclasses
import sys
import types
from collections.abc import Callable, Sequence
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from swimmer_mj.own_code import import_own

__all__ = [
    "METHODS",
    "PROBLEMS",
    "find",
    "from_json",
    "problem_named",
    "require_imported",
    "setting",
    "to_json",
    "trust",
]

PROBLEMS = {
    "swim": "swimmer_mj.learning.problems.swim:Swimming",
    "pendulum": "swimmer_mj.learning.problems.pendulum:Pendulum",
    "cart-pole": "swimmer_mj.learning.problems.cart_pole:CartPole",
    "mujoco": "swimmer_mj.learning.problems.mujoco.task:MujocoTask",
}
TYPED = {"mujoco": "dm_control/DOMAIN/TASK, gymnasium/ID, FILE.xml"}
"""What is typed in place of a name: :func:`problem_named`."""
METHODS = {
    "td": "swimmer_mj.learning.td.method:TemporalDifferences",
    "value-gradient": "swimmer_mj.learning.value_gradient.method:ValueGradients",
}


def problem_named(name: str) -> tuple[str, dict[str, Any]]:
    """The problem that "dm_control/cartpole/swingup", "gymnasium/Swimmer-v5" or "arm.xml" is, and its options."""
    if isinstance(name, str) and (
        name.startswith(("dm_control/", "gymnasium/")) or name.lower().endswith(".xml")
    ):
        return "mujoco", {"environment": name}
    return name, {}


def find(name: str, known: dict[str, str], what: str, importing: bool = True) -> type[Any]:
    """The class of that name, of :data:`PROBLEMS` or :data:`METHODS`, or the one at "module:Class".

    Raises
    ------
    ValueError
        In one line: there is none, or it cannot be kept in config.json. ``what`` is "problem" or "method". Not
        ``importing``, also when the module has not been imported yet.
    """
    if not isinstance(name, str):
        raise ValueError(f"{what} must be named by a string, got {name!r}")
    module_name, colon, attribute = known.get(name, name).partition(":")
    if not (colon and module_name and attribute):
        names = ", ".join(TYPED.get(one, one) for one in known)
        raise ValueError(f"{what} must be one of {names}, or module:Class; got {name!r}")
    if not (importing or name in known):
        require_imported(module_name, f"{what} {name!r}")
    found: Any = import_own(module_name, f"{what} {name!r}")
    try:
        for part in attribute.split("."):
            found = getattr(found, part)
    except AttributeError as error:
        raise ValueError(f"{what} {name!r}: {error}") from error
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise ValueError(f"{what} {name!r} must be a dataclass, whose fields config.json keeps")
    return found


def require_imported(module: str, what: str) -> None:
    """Refuse ``what`` a file names, unless its ``module`` has been imported before."""
    if module not in sys.modules:
        raise ValueError(
            f"{what} is code that does not come with swimmer-mj, and reading a run does not run it; if you trust it, "
            f"add --trust {module}, in Python import it before"
        )


def trust(modules: Sequence[str]) -> None:
    """Import ``modules``, so that runs of their problems and methods can be read."""
    for module in modules:
        import_own(module, f"--trust {module}")


def to_json(thing: Any, known: dict[str, str]) -> dict[str, Any]:
    """Name and settings of a problem or a method."""
    kind = type(thing)
    if not dataclasses.is_dataclass(kind):
        raise ValueError(f"{kind.__name__} must be a dataclass, whose fields config.json keeps")
    name = next((name for name, place in known.items() if _is_at(kind, place)), None)
    name = name or f"{kind.__module__}:{kind.__qualname__}"
    return {"name": name, **dataclasses.asdict(thing)}


def _is_at(kind: type[Any], place: str) -> bool:
    """Whether ``kind`` is the class at "module:Class", or in a module of that package."""
    module, _, name = place.partition(":")
    return kind.__qualname__ == name and f"{kind.__module__}.".startswith(f"{module}.")


def from_json(values: dict[str, Any], known: dict[str, str], what: str) -> Any:
    """What :func:`to_json` wrote."""
    settings = {key: value for key, value in values.items() if key != "name"}
    kind = find(values["name"], known, what, importing=False)
    if not hasattr(kind, "initial_states" if what == "problem" else "start"):
        raise ValueError(f"{what} {values['name']!r} is no {what}")
    return _build(kind, settings)


def _build(kind: type[Any], values: dict[str, Any]) -> Any:
    """A dataclass from JSON values: lists become tuples, objects the dataclass that the field's type names."""
    if unknown := values.keys() - {field.name for field in dataclasses.fields(kind)}:
        raise ValueError(f"{kind.__name__} has no setting {min(unknown)!r}")
    return kind(**{name: setting(kind, name, value) for name, value in values.items()})


def setting(kind: Callable[..., Any], name: str, value: Any) -> Any:
    """The value of a field of the dataclass ``kind``, or of a function's argument, from a JSON ``value``.

    ValueError if it is of another type.
    """
    hint = get_type_hints(kind)[name]
    try:
        return _value(hint, value)
    except TypeError:
        wanted = hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")
        what = "true or false" if hint is bool else f"of type {wanted}"
        raise ValueError(f"{name} must be {what}, got {value!r}") from None


def _value(hint: Any, value: Any) -> Any:
    """``value`` as ``hint`` asks; TypeError if that cannot be."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        for option in inner:
            try:
                return _value(option, value)
            except TypeError:
                continue
        raise TypeError
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise TypeError
        assert isinstance(hint, type)
        return _build(hint, value)
    if isinstance(value, list | tuple):
        if hint in (bool, int, float, str, types.NoneType) or origin is Literal:
            raise TypeError
        of = inner[0] if origin in (tuple, Sequence) and inner and inner[-1:] != ((),) else None
        alike = of is not None and (origin is Sequence or inner[1:] == (...,))
        return tuple(_value(of if alike else None, one) for one in value)
    if isinstance(value, dict) and hint in (bool, int, float, str, types.NoneType):
        raise TypeError
    allowed = {
        bool: (bool,),
        int: (int,),
        float: (int, float),
        str: (str,),
        types.NoneType: (types.NoneType,),
    }
    if hint in allowed and type(value) not in allowed[hint]:
        raise TypeError
    if origin in (tuple, Sequence):
        raise TypeError  # of one value
    return value
