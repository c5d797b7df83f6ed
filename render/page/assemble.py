"""The page as one file: sources, MuJoCo and policies inlined."""

from __future__ import annotations

import base64
import gzip
import importlib.resources
import json
import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

from swimmer_mj.files import replacing

__all__ = ["MAX_BYTES", "page", "write_page"]

MAX_BYTES = 6_000_000
"""Of the whole file."""
MODULES = (
    "bytes.js", "network.js", "value.js", "held.js", "kinematics.js", "swimmer.js", "arena.js", "water.js", "view.js",
    "camera.js", "plots.js", "pointer.js", "panel.js", "main.js",
)  # fmt: skip
"""Sources, each after those that it imports."""

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+\.js)";\n', re.MULTILINE)


def page(policies: Sequence[Mapping[str, Any]], chosen: str | None = None) -> str:
    """The HTML.

    Parameters
    ----------
    policies : sequence of mappings
        What :func:`swimmer_mj.render.page.policies.describe` says of each; names must differ.
    chosen : str, optional
        Name of the policy that is on at first; by default the first.
    """
    names = [policy["name"] for policy in policies]
    if not names or len({*names}) < len(names):
        raise ValueError(f"the page needs policies with names that differ, got {names}")
    chosen = names[0] if chosen is None else chosen
    if chosen not in names:
        raise ValueError(f"there is no policy {chosen!r} on the page; there are {', '.join(names)}")
    source = importlib.resources.files("swimmer_mj.render.page").joinpath("source")
    mujoco = importlib.resources.files("swimmer_mj.render.page").joinpath("mujoco")
    glue = gzip.decompress(mujoco.joinpath("mujoco.js.gz").read_bytes()).decode()
    parts = {
        "style": source.joinpath("page.css").read_text(encoding="utf-8"),
        "content": json.dumps({"policies": list(policies), "chosen": chosen}).replace("<", "\\u003c"),
        "wasm": base64.b64encode(mujoco.joinpath("mujoco.wasm.gz").read_bytes()).decode(),
        "mujoco": _script_text(
            glue.replace("export default loadMujoco;", "globalThis.loadMujoco = loadMujoco;")
        ),
        "program": _script_text(
            bundle({name: source.joinpath(name).read_text(encoding="utf-8") for name in MODULES})
        ),
    }
    html = source.joinpath("page.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], html)


def write_page(
    path: str | os.PathLike[str], policies: Sequence[Mapping[str, Any]], chosen: str | None = None
) -> int:
    """Write :func:`page` to ``path``; its size in bytes."""
    content = page(policies, chosen).encode()
    if len(content) > MAX_BYTES:
        raise ValueError(
            f"the page would have {len(content):,} bytes, and {MAX_BYTES:,} are allowed; give it fewer or smaller "
            "policies"
        )
    with replacing(path) as partial:
        partial.write_bytes(content)
    return len(content)


def bundle(modules: Mapping[str, str]) -> str:
    """One module of several: their texts in order, without imports and exports.

    ``file://`` pages cannot import each other's files, so that all share one scope: a name stands for one thing in all
    of them. A module may import by name from modules before it, and no name may be defined twice.
    """
    exported: dict[str, set[str]] = {}
    text = []
    for name, code in modules.items():
        for names, origin in _IMPORT.findall(code):
            asked = {one.strip() for one in names.split(",") if one.strip()}
            if missing := asked - exported.get(origin, set()):
                raise ValueError(
                    f"{name} imports {min(missing)} from {origin}, which does not export it before"
                )
        exported[name] = {
            *re.findall(r"^export (?:async )?(?:const|class|function) (\w+)", code, re.MULTILINE)
        }
        body = re.sub(
            r"^export (?=async |const |class |function )", "", _IMPORT.sub("", code), flags=re.MULTILINE
        )
        if left := re.search(r"^(?:import|export)\b.*", body, re.MULTILINE):
            raise ValueError(f"{name}: only named imports and exports can be bundled, got {left[0]!r}")
        text.append(f"// {name}\n{body}")
    return "\n".join(text)


def _script_text(text: str) -> str:
    """JavaScript such that it can stand in a script element; it only differs within strings and comments."""
    return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")
