"""Problems and methods by name, and as JSON: "swim", or "my_module:DoublePendulum" for one's own.

To add one to the package, add its line here. One's own needs no line: it is a frozen dataclass, in a module that Python
finds, whose fields are its settings (numbers, strings, tuples, None, and dataclasses of these).
"""

from __future__ import annotations

import dataclasses
import importlib
import types
from typing import Any, Union, get_args, get_origin, get_type_hints

__all__ = ["METHODS", "PROBLEMS", "find", "from_json", "to_json"]

PROBLEMS = {
    "swim": "swimmer_mj.learning.problems.swim:Swimming",
    "pendulum": "swimmer_mj.learning.problems.pendulum:Pendulum",
    "cart-pole": "swimmer_mj.learning.problems.cart_pole:CartPole",
}
METHODS = {
    "td": "swimmer_mj.learning.td.method:TemporalDifferences",
    "value-gradient": "swimmer_mj.learning.value_gradient.method:ValueGradients",
}


def find(name: str, known: dict[str, str], what: str) -> type[Any]:
    """The class of that name, of :data:`PROBLEMS` or :data:`METHODS`, or the one at "module:Class".

    Raises
    ------
    ValueError
        In one line: there is none, or it cannot be kept in config.json. ``what`` is "problem" or "method".
    """
    module_name, colon, attribute = known.get(name, name).partition(":")
    if not (colon and module_name and attribute):
        raise ValueError(f"{what} must be one of {', '.join(known)}, or module:Class; got {name!r}")
    try:
        found = importlib.import_module(module_name)
        for part in attribute.split("."):
            found = getattr(found, part)
    except ModuleNotFoundError as error:
        raise ValueError(f"{what} {name!r}: {error}; is its folder on Python's path?") from error
    except AttributeError as error:
        raise ValueError(f"{what} {name!r}: {error}") from error
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise ValueError(f"{what} {name!r} must be a dataclass, whose fields config.json keeps")
    return found


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
    return _build(find(values["name"], known, what), settings)


def _build(kind: type[Any], values: dict[str, Any]) -> Any:
    """A dataclass from JSON values: lists become tuples, objects the dataclass that the field's type names."""
    hints = get_type_hints(kind)
    if unknown := values.keys() - {field.name for field in dataclasses.fields(kind)}:
        raise ValueError(f"{kind.__name__} has no setting {min(unknown)!r}")
    return kind(**{key: _value(hints[key], value) for key, value in values.items()})


def _value(hint: Any, value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_value(None, one) for one in value)
    if isinstance(value, dict):
        options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
        (kind,) = (option for option in options if dataclasses.is_dataclass(option))
        assert isinstance(kind, type)
        return _build(kind, value)
    return value
