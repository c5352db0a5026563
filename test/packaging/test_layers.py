"""Imports of the package have no cycles, and no layer imports one below it in the list."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"
# Each layer may import itself and those above it; docs/architecture.md lists their contents.
LAYERS = (
    {"parameters", "registry", "foreign_code", "signals"},
    {"boxes", "stamps", "plurals", "messages", "values"},
    {
        "opencv",
        "progress",
        "ros_domains",
        "atomic_files",
        "command_lines",
    },
    {"filter"},
    {"world"},
    {"background"},
    {"frames"},
    {"footage"},
    {"yaml_files"},
    {"networks"},
    {"appearances"},
    {"cues"},
    {"tracking"},
    {"targets"},
    {"node_parameters", "parameter_files"},
    {"formats"},
    {"decoding", "overlay"},
    {"topics", "world_messages"},
    {"localization"},
    {"evaluation"},
    {"pages"},
    {"recordings"},
    {"tuning"},
    {"node"},
    {"testing"},
    {"commands", "launching"},
)
PLACES = {name: place for place, names in enumerate(LAYERS) for name in names}


def modules(folder):
    """Name to path of every module of the package in a repository folder."""
    return {
        ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (folder / PACKAGE).rglob("*.py")
    }


def imported(statement, known):
    """Names of the package's modules that a statement imports."""
    if isinstance(statement, ast.Import):
        names = [alias.name for alias in statement.names]
    elif isinstance(statement, ast.ImportFrom) and not statement.level:
        named = [f"{statement.module}.{alias.name}" for alias in statement.names]
        names = [one if one in known else str(statement.module) for one in named]
    else:
        names = []
    return {name for name in names if name.partition(".")[0] == PACKAGE}


def executed(body):
    """Statements that run when the module is imported: none in functions or for type checkers."""
    for statement in body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            yield from executed(statement.orelse)
            continue
        yield statement
        for name in ("body", "orelse", "finalbody"):
            yield from executed(getattr(statement, name, ()))
        for handler in getattr(statement, "handlers", ()):
            yield from executed(handler.body)


def import_cycle(folder):
    """Modules of an import cycle, each of which imports the next; empty without a cycle."""
    known = modules(folder)
    needed = {
        name: {
            one
            for statement in executed(ast.parse(path.read_text(encoding="utf-8")).body)
            for one in imported(statement, known)
        }
        - {name}
        for name, path in known.items()
    }
    try:
        TopologicalSorter(needed).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def downward_imports(folder):
    """All imports of modules in a lower layer, also those in functions.

    The package's own `__init__` is in no layer.
    """
    known = modules(folder)
    for name, path in known.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for other in imported(node, known):
                own, its = (one.split(".")[1:2] for one in (name, other))
                if own and its and PLACES[its[0]] > PLACES[own[0]]:
                    yield f"{name} imports {other}"


def test_every_module_is_in_a_layer():
    assert {name.split(".")[1] for name in modules(REPOSITORY) if "." in name} == PLACES.keys()


def test_there_is_no_import_cycle():
    assert import_cycle(REPOSITORY) == []


def test_no_layer_imports_one_below_it():
    assert list(downward_imports(REPOSITORY)) == []


@pytest.fixture
def package(tmp_path):
    """A function that writes modules, given by name and text, and returns the repository folder."""

    def write(**texts):
        for name, text in texts.items():
            path = tmp_path / PACKAGE / f"{name}.py"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        return tmp_path

    return write


def test_cycles_and_downward_imports_are_found(package):
    folder = package(
        __init__="",
        boxes="try:\n    from pf_tracker_ros.stamps import x\nexcept ImportError:\n    x = 1\n",
        stamps="import pf_tracker_ros.plurals\n",
        plurals="from pf_tracker_ros import boxes\n",
        registry="def later():\n    from pf_tracker_ros.boxes import x\n",
    )
    assert {*import_cycle(folder)} == {
        f"{PACKAGE}.{name}" for name in ("boxes", "stamps", "plurals")
    }
    assert list(downward_imports(folder)) == [f"{PACKAGE}.registry imports {PACKAGE}.boxes"]


def test_later_and_type_only_imports_make_no_cycle(package):
    checked = "if TYPE_CHECKING:\n    from pf_tracker_ros.boxes import x\n"
    folder = package(
        __init__="",
        boxes="import pf_tracker_ros.stamps\nimport pf_tracker_ros.plurals\n",
        stamps="def later():\n    from pf_tracker_ros.boxes import x\n",
        plurals=checked,
    )
    assert import_cycle(folder) == []
