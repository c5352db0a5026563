"""A public name has one meaning."""

import ast
from collections import defaultdict
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = REPOSITORY / "pf_tracker_ros"
SOURCES = sorted(PACKAGE.rglob("*.py"))
# Entry points and parsers of several commands; `T` and the like are type variables.
SHARED = {"main", "parser"}


def public_names(tree):
    """The public names that a module defines at its top, without type variables."""
    for statement in tree.body:
        call = getattr(getattr(statement, "value", None), "func", None)
        targets = [*getattr(statement, "targets", ()), getattr(statement, "target", None)]
        if getattr(call, "id", "") != "TypeVar":
            found = [
                getattr(statement, "name", None),
                *(getattr(one, "id", None) for one in targets),
            ]
            yield from (name for name in found if name and not name.startswith("_"))


def places(sources):
    """Public name to the modules that define it, where there are several."""
    found = defaultdict(list)
    for module, text in sources.items():
        for name in public_names(ast.parse(text)):
            found[name].append(module)
    return {name: where for name, where in found.items() if len(where) > 1}


def test_a_public_name_is_defined_in_one_place():
    sources = {path: path.read_text() for path in SOURCES}
    assert places(sources).keys() == SHARED
    again = "class Track: ...\n_x = 1\nT = TypeVar('T')"
    assert places({"a": again, "b": again.replace("class Track: ...", "Track = int")}) == {
        "Track": ["a", "b"]
    }
