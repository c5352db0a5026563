"""The arguments of a constructor are told of in one place: the docstring of its class.

The classes that docs/library.md documents tell of all of them. Others may leave the list out where
names and types say enough, but a list is complete.
"""

import ast
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDERS = ("pf_tracker_ros", "benchmarks")
LIBRARY = (REPOSITORY / "docs" / "library.md").read_text(encoding="utf-8")
DOCUMENTED = set(re.findall(r"autoclass:: [\w.]+\.(\w+)", LIBRARY))


def constructors(path):
    """The classes of a file that have a constructor of their own, each with it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            for member in node.body:
                if isinstance(member, ast.FunctionDef) and member.name == "__init__":
                    yield node, member


def names_of_arguments(constructor):
    arguments = constructor.args
    yield from (each.arg for each in [*arguments.posonlyargs, *arguments.args][1:])
    yield from (each.arg for each in arguments.kwonlyargs)
    yield from (f"*{each.arg}" for each in [arguments.vararg] if each)
    yield from (f"**{each.arg}" for each in [arguments.kwarg] if each)


def faults(path, documented=DOCUMENTED):
    for owner, constructor in constructors(path):
        if ast.get_docstring(constructor):
            yield f"{owner.name}.__init__ has a docstring of its own"
        _, has_list, told = (ast.get_docstring(owner) or "").partition("\nArgs:\n")
        if has_list or owner.name in documented:
            names = [line.partition(":")[0].strip() for line in told.splitlines()]
            for name in names_of_arguments(constructor):
                if name not in names:
                    yield f"the docstring of {owner.name} does not tell of {name}"


FILES = [
    str(path.relative_to(REPOSITORY))
    for folder in FOLDERS
    for path in sorted((REPOSITORY / folder).rglob("*.py"))
    if any(constructors(path))
]


@pytest.mark.parametrize("file", FILES)
def test_the_class_tells_of_its_constructor(file):
    assert list(faults(REPOSITORY / file)) == []


def test_the_documented_classes_are_found():
    assert {"Tracker", "MultiTracker", "Detections", "Estimate", "CameraModel"} <= DOCUMENTED


def test_what_is_looked_for_is_found(tmp_path):
    path = tmp_path / "odd.py"
    path.write_text(
        "class Odd:\n"
        "    'An odd one.\\n\\nArgs:\\n    told: A number.\\n'\n"
        "    def __init__(self, told, silent=0, *, least=0, **options):\n"
        "        'Make it.'\n"
        "class Plain:\n"
        "    'A plain one.'\n"
        "    def __init__(self, silent):\n"
        "        pass\n"
    )
    assert list(faults(path)) == [
        "Odd.__init__ has a docstring of its own",
        "the docstring of Odd does not tell of silent",
        "the docstring of Odd does not tell of least",
        "the docstring of Odd does not tell of **options",
    ]
    assert list(faults(path, {"Plain"}))[-1] == "the docstring of Plain does not tell of silent"
