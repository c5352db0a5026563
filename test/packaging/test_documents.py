"""The documents name files, classes, functions and parameters that there are."""

import ast
import re
import subprocess
from pathlib import Path

import cv2
import pytest
import yaml

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
README = (ROOT / "README.md").read_text()
LIBRARY = (ROOT / "docs" / "library.md").read_text()
EXAMPLES = re.findall(r"^```python\n(.*?)^```", README + LIBRARY, re.MULTILINE | re.DOTALL)
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
    named = set(re.findall(r"`((?:[A-Z][a-z]|_)\w*(?:\.\w+)?)`", PAPERS))
    assert len(named) > 30
    assert [name for name in sorted(named - names) if not hasattr(cv2, name)] == []


def parameters_in(text):
    """Parameters in backticks, as `group.name` or `group.name: 0.5`; and all that there are."""
    known = {*declarations(TrackerParameters), *declarations(NodeParameters)}
    groups = {name.partition(".")[0] for name in known if "." in name}
    named = re.findall(r"`([a-z_]+\.[a-z_]+)(?::?=[^`]*|: [^`]*)?`", text)
    named = {name for name in named if name.partition(".")[0] in groups}
    return {name for name in named if not name.endswith(".py")}, known


@pytest.mark.parametrize(
    "document",
    [one for one in DOCUMENTS if one.name not in ("benchmarks.md", "experiments.md")],
    ids=lambda one: one.name,
)
def test_the_parameters_that_a_document_names_are_there(document):
    named, known = parameters_in(document.read_text())
    # Declared as soon as another package brings features.
    conditional = {"correlation_response.features", "coarse_correlation_response.features"}
    assert sorted(named - known - conditional) == []
    assert document.name != "papers.md" or len(named) > 10


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_the_examples_of_the_library_run_as_they_are_written(
    number, moving_square_sequence, write_video, monkeypatch, capfd
):
    assert len(EXAMPLES) == 3
    if "MultiTracker" in EXAMPLES[number]:
        pytest.importorskip("scipy", reason="needs the extra 'targets'")
    # In place of the reader's video.
    monkeypatch.chdir(moving_square_sequence)
    (clip,) = re.findall(r'VideoCapture\("(\S+\.mp4)"\)', EXAMPLES[number])
    path = Path(clip)
    path.parent.mkdir(parents=True, exist_ok=True)
    images = [cv2.imread(str(one)) for one in sorted(Path("img").iterdir())]
    images = [cv2.resize(image, (640, 480)) for image in images]
    write_video(path, images, codec="mp4v")
    exec(EXAMPLES[number], {})
    printed = capfd.readouterr()
    assert printed.err == ""
    assert len(printed.out.splitlines()) >= len(images) - 1


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_tables_have_whole_rows_and_code_blocks_can_be_parsed(document):
    text, cells = document.read_text(), [0, 0]
    # Three screens.
    assert document.name != "README.md" or len(text.splitlines()) <= 120
    for line in text.replace(r"\|", "").splitlines():
        cells = [cells[1], line.count("|") if line.lstrip().startswith("|") else 0]
        assert 0 in cells or cells[0] == cells[1], line
    blocks = re.findall(r"^ *```(python|yaml|sh)\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    for language, block in blocks:
        if language == "python":
            ast.parse(block)
        elif language == "yaml":
            list(yaml.safe_load_all(block))
        else:
            checked = subprocess.run(
                ["bash", "-n"], input=block, capture_output=True, text=True, check=False
            )
            assert checked.returncode == 0, checked.stderr
