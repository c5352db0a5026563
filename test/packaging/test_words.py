"""A public name has one meaning."""

import ast
from collections import defaultdict
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = REPOSITORY / "pf_tracker_ros"
SOURCES = sorted(PACKAGE.rglob("*.py"))
# Entry points and parsers of several commands; `T` and the like are type variables.
SHARED = {"main", "parser"}


def is_type_variable(statement):
    value = getattr(statement, "value", None)
    return isinstance(value, ast.Call) and getattr(value.func, "id", "") == "TypeVar"


def public_names(tree):
    """The public names that a module defines at its top."""
    for statement in tree.body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            names = [statement.name]
        elif isinstance(statement, ast.Assign) and not is_type_variable(statement):
            names = [target.id for target in statement.targets if isinstance(target, ast.Name)]
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            names = [statement.target.id]
        else:
            names = []
        yield from (name for name in names if not name.startswith("_"))


def places(sources):
    """Public name to the modules that define it."""
    found = defaultdict(list)
    for module, text in sources.items():
        for name in public_names(ast.parse(text)):
            found[name].append(module)
    return found


def read(paths):
    return {str(path.relative_to(REPOSITORY)): path.read_text() for path in paths}


def test_a_public_name_is_defined_in_one_place():
    found = places(read(SOURCES))
    assert {name: where for name, where in found.items() if len(where) > 1} == {
        name: found[name] for name in SHARED
    }


def test_a_second_definition_is_found():
    sources = {
        "a": "class Track: ...\n_x = 1\nT = TypeVar('T')",
        "b": "def f(): ...\nTrack = int\n_x = 2\nT = TypeVar('T')",
    }
    assert {name: at for name, at in places(sources).items() if len(at) > 1} == {
        "Track": ["a", "b"]
    }
