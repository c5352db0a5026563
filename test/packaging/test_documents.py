"""The documents name files, classes, functions and parameters that there are."""

import ast
import re
from pathlib import Path

import cv2
import pytest

from pf_tracker_ros.node.tracker.node_parameters import NodeParameters
from pf_tracker_ros.parameters import all_declarations, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
PAPERS = (ROOT / "docs" / "papers.md").read_text()


def names_in(source):
    """Every function and class of a file, methods and attributes also as Class.name."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        if isinstance(node, ast.ClassDef):
            for member in ast.walk(node):
                if isinstance(member, ast.FunctionDef):
                    yield member.name
                    yield f"{node.name}.{member.name}"
                elif isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name):
                    yield f"{node.name}.{member.target.id}"


@pytest.fixture(scope="module")
def names():
    found = set()
    for folder in ("pf_tracker_ros", "benchmarks"):
        for path in (ROOT / folder).rglob("*.py"):
            found.update(names_in(path.read_text()))
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files_and_headings(document):
    for target in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
        if target.startswith("http"):
            continue
        path, _, heading = target.partition("#")
        linked = (document.parent / path).resolve() if path else document
        assert linked.exists(), target
        if heading:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(), re.MULTILINE)
            anchors = {re.sub(r"[^\w -]", "", one).lower().replace(" ", "-") for one in headings}
            assert heading in anchors, target


def test_the_classes_and_methods_named_in_the_papers_are_there(names):
    named = set(re.findall(r"`([A-Z][a-z]\w*(?:\.\w+)?)`", PAPERS))
    assert len(named) > 30
    assert [name for name in sorted(named - names) if not hasattr(cv2, name)] == []


def test_the_parameters_named_in_the_papers_are_there():
    known = {*all_declarations(TrackerParameters), *declarations(NodeParameters)}
    groups = {name.partition(".")[0] for name in known if "." in name}
    named = {
        name
        for name in re.findall(r"`([a-z_]+\.[a-z_]+)`", PAPERS)
        if name.partition(".")[0] in groups
    }
    assert len(named) > 10
    assert sorted(named - known) == []
