"""Imports have no cycles, and no layer of the package imports one below it in the list."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"
LAYERS = (
    *({"parameters", "registry", "foreign_code", "signals"},),
    *({"boxes", "stamps", "plurals", "messages", "values"},),
    *({"opencv", "progress", "ros_domains", "atomic_files", "command_lines"},),
    *({name} for name in ("filter", "world", "background", "frames", "footage", "yaml_files")),
    *({name} for name in ("networks", "appearances", "cues", "tracking", "targets")),
    *({"node_parameters", "parameter_files"}, {"formats"}, {"decoding", "overlay"}),
    *({"topics", "world_messages"}, {"localization"}, {"evaluation"}, {"pages"}),
    *({"recordings"}, {"tuning"}, {"node"}, {"testing"}, {"commands", "launching"}),
)
PLACES = {name: place for place, names in enumerate(LAYERS) for name in names}


def modules(folder, package=PACKAGE):
    """Name to path of every module of a package in a folder, or of all in the folder."""
    return {
        ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (folder / package).rglob("*.py")
    }


def imported(statement, known):
    """Names of the known modules that a statement imports."""
    if isinstance(statement, ast.Import):
        names = [alias.name for alias in statement.names]
    elif isinstance(statement, ast.ImportFrom) and not statement.level:
        named = [f"{statement.module}.{alias.name}" for alias in statement.names]
        names = [one if one in known else str(statement.module) for one in named]
    else:
        names = []
    return known.keys() & names


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


def test_every_module_is_in_a_layer_without_cycles_and_imports_of_lower_ones():
    assert {name.split(".")[1] for name in modules(REPOSITORY) if "." in name} == PLACES.keys()
    assert import_cycle(REPOSITORY) == []
    assert list(downward_imports(REPOSITORY)) == []


def test_the_benchmarks_import_each_other_in_one_direction():
    """Also within functions, and for type checkers alone."""
    known = modules(REPOSITORY / "benchmarks", "")
    needed = {
        name: {
            one
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            for one in imported(node, known)
        }
        for name, path in known.items()
    }
    assert needed["umbrellas"] >= {"tables", "scenes.scene"}
    TopologicalSorter(needed).prepare()


def test_cycles_and_downward_imports_are_found(tmp_path):
    """Imports that come later or are for types only make no cycle."""
    (tmp_path / PACKAGE).mkdir()
    for name, text in {
        "__init__": "",
        "boxes": "try:\n    from pf_tracker_ros.stamps import x\nexcept ImportError:\n    x = 1\n",
        "stamps": "import pf_tracker_ros.plurals\nimport pf_tracker_ros.values\n",
        "plurals": "from pf_tracker_ros import boxes\n",
        "values": "if TYPE_CHECKING:\n    from pf_tracker_ros.stamps import x\n",
        "registry": "def later():\n    from pf_tracker_ros.boxes import x\n",
    }.items():
        (tmp_path / PACKAGE / f"{name}.py").write_text(text)
    assert {*import_cycle(tmp_path)} == {
        f"{PACKAGE}.{name}" for name in ("boxes", "stamps", "plurals")
    }
    assert list(downward_imports(tmp_path)) == [f"{PACKAGE}.registry imports {PACKAGE}.boxes"]
