"""The benchmarks' modules build on each other in one direction."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def module_name(path):
    *folders, last = path.relative_to(BENCHMARKS).with_suffix("").parts
    return ".".join(folders if last == "__init__" else [*folders, last])


def imported(path):
    """What a file imports, also for type checkers alone and within functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # Each name may be a module of a package.
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
            yield node.module


def test_no_modules_import_each_other():
    files = {module_name(path): path for path in BENCHMARKS.rglob("*.py")}
    imports = {name: files.keys() & set(imported(path)) for name, path in files.items()}
    assert imports["umbrellas"] >= {"tables", "scenes.scene"}
    TopologicalSorter(imports).prepare()
