"""The one direction of imports: models <- swimmer_mj <- learning <- render (docs/decisions/0001)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = ["models", "swimmer_mj", "learning", "render"]
LOOKS_UP = {*(ROOT / "swimmer_mj" / "cli").glob("*.py")}  # the command line: it imports inside its commands
FILES = [path for layer in LAYERS for path in sorted((ROOT / layer).glob("**/*.py"))]


def imports(path):
    """Names of the modules that ``path`` imports anywhere, and whether at import time."""
    tree = ast.parse(path.read_text())
    inside = {id(node) for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for node in ast.walk(f)}
    inside |= {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, id(node) not in inside) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from ((f"{node.module}.{alias.name}", id(node) not in inside) for alias in node.names)


def layer_of(module):
    parts = module.split(".")
    if parts[0] != "swimmer_mj":
        return None
    return parts[1] if len(parts) > 1 and parts[1] in LAYERS[2:] + LAYERS[:1] else "swimmer_mj"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    own = LAYERS.index(path.relative_to(ROOT).parts[0])
    for module, at_import in imports(path):
        assert module.split(".")[0] not in ("models", "learning", "render"), (
            f"{module}: write swimmer_mj.{module}"
        )
        layer = layer_of(module)
        if layer is not None and LAYERS.index(layer) > own:
            assert path in LOOKS_UP, f"{path} imports {module}, which stands to its right"
            assert not at_import, f"{path} imports {module} at import time"
        if module.split(".")[0] == "torch":
            assert own >= LAYERS.index("learning") or path in LOOKS_UP, f"{path} imports torch"
        if module.split(".")[0] in ("mujoco", "dm_control"):
            assert path.name not in ("analytic.py", "state.py", "parameters.py")
        if path.parts[-2] == "models":
            pytest.fail(f"models imports nothing, but {path} imports {module}")


# Inside learning/: each folder may import from itself and from those before it; methods know nothing of each other.
FLOORS = [
    ["problems"],
    ["networks"],
    ["method"],
    ["td", "value_gradient"],
    ["runs"],
    ["experiments", "pretrained"],
]
FLOOR = {name: i for i, names in enumerate(FLOORS) for name in names}


INSIDE = sorted((ROOT / "learning").glob("*/**/*.py"))


@pytest.mark.parametrize("path", INSIDE, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_inside_learning_point_one_way(path):
    own = path.relative_to(ROOT / "learning").parts[0]
    for module, _ in imports(path):
        if module.startswith("swimmer_mj.learning."):
            other = module.split(".")[2]
            assert other == own or FLOOR[other] < FLOOR[own], (
                f"{path} imports {module}, which is not below it"
            )


@pytest.mark.parametrize(
    "path", sorted((ROOT / "swimmer_mj" / "compiled").glob("*.py")), ids=lambda path: path.name
)
def test_compiled_code_stands_below_everything(path):
    for module, _ in imports(path):
        own = module.startswith(("swimmer_mj.compiled", "swimmer_mj.files."))
        assert own or not module.startswith("swimmer_mj."), module


PROBLEM_NAMES = {"Swimming", "Pendulum", "CartPole", "DifferentiableProblem", "TorchProblem"}
METHOD_NAMES = {"TemporalDifferences", "ValueGradients"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nobody_asks_for_the_type_of_a_problem_or_a_method(path):
    """A problem may ask whether it is of a subclass; everybody else asks for forms."""
    for node in ast.walk(ast.parse(path.read_text())):
        text = ast.unparse(node)
        asks = (isinstance(node, ast.Call) and text.startswith("isinstance(")) or (
            isinstance(node, ast.Compare) and text.startswith("type(")
        )
        if asks and not text.startswith("type(self)"):
            named = {name.id for name in ast.walk(node) if isinstance(name, ast.Name)}
            assert not named & (PROBLEM_NAMES | METHOD_NAMES), f"{path}: {text}"


def test_there_are_files_to_look_at():
    assert len(FILES) > 20
    path = ROOT / "learning" / "td" / "fused.py"
    assert ("swimmer_mj.learning.networks.networks.Cascade", True) in set(imports(path))
