"""The documentation is built without a warning, opens from disk alone, and is complete."""

import doctest
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="needs the extra 'docs'")
pytest.importorskip("myst_parser", reason="needs the extra 'docs'")
pytest.importorskip("furo", reason="needs the extra 'docs'")

ROOT = Path(__file__).resolve().parents[2]
# Modules whose public names are the library.
LIBRARY = ["pf_tracker_ros", "pf_tracker_ros.world"]
PUBLIC = [
    (module, name)
    for module in LIBRARY
    for name in import_module(module).__all__
    if name != "__version__"
]
CALLABLE = [
    (module, name) for module, name in PUBLIC if callable(getattr(import_module(module), name))
]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built pages."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [*command, ROOT / "docs", folder, "-d", folder.parent / "doctrees"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder


def loaded_by(page):
    """The addresses that a page makes a browser load."""
    tags = re.findall(r"<(\w+)\s([^>]*)>", page.read_text(encoding="utf-8"))
    for tag, attributes in tags:
        name = {"link": "href", "object": "data"}.get(tag, "src")
        if tag != "a":
            yield from re.findall(rf'(?:^|\s){name}="([^"]+)"', attributes)


def test_the_pages_load_only_files_beside_them(site):
    pages = {path.stem for path in (ROOT / "docs").iterdir() if path.suffix in (".md", ".rst")}
    assert {"index"} <= pages <= {path.stem for path in site.glob("*.html")}
    loaded = {(page, one) for page in site.glob("*.html") for one in loaded_by(page)}
    assert len(loaded) > 100
    for page, address in loaded:
        path = address.partition("?")[0].partition("#")[0]
        if path and not path.startswith("data:"):
            assert (page.parent / path).is_file(), f"{page.name} loads {address}"
    for sheet in site.rglob("*.css"):
        addresses = re.findall(r"(?:url\(|@import)\s*['\"]?([^'\")\s]+)", sheet.read_text())
        assert [one for one in addresses if re.match(r"(https?:)?//", one)] == [], sheet.name


@pytest.mark.parametrize(
    ("words", "best"),
    [
        ("follow person", "follow_a_person"),
        ("docker", "docker"),
        ("usb camera", "usb_camera"),
        ("parameters", "parameters"),
        ("install", "first_steps"),
    ],
)
def test_the_search_finds_the_page_that_is_named_first(site, browser, words, best):
    page = browser.new_page()
    page.goto(f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
    results = page.locator("#search-results li > a")
    results.first.wait_for()
    assert re.search(r"(\w+)\.html", results.first.get_attribute("href"))[1] == best
    page.close()


def test_links_to_other_repositories_files_name_files_of_this_one(site):
    blob = "/pf_tracker_ros/blob/main/"
    text = "".join(page.read_text() for page in site.glob("*.html"))
    linked = set(re.findall(rf'href="https://github\.com/[^"]*{re.escape(blob)}([^"#]+)', text))
    assert len(linked) > 20
    assert [path for path in sorted(linked) if not (ROOT / path).exists()] == []


def test_every_public_name_is_in_the_reference(site):
    text = "".join(page.read_text() for page in site.glob("*.html"))
    assert [one for one in PUBLIC if f'id="{".".join(one)}"' not in text] == []
    assert "`pf_tracker_ros.__version__`" in (ROOT / "docs" / "library.md").read_text()


@pytest.mark.parametrize(("module", "name"), CALLABLE)
def test_a_public_name_has_an_example_that_gives_what_it_shows(module, name):
    if name in ("MultiTracker", "TrackedTarget"):
        pytest.importorskip("scipy", reason="needs the extra 'targets'")
    public = getattr(import_module(module), name)
    (example,) = doctest.DocTestFinder(recurse=False).find(public, name, globs={})
    assert example.examples
    report = []
    doctest.DocTestRunner(verbose=False).run(example, out=report.append)
    assert report == []


def test_every_executable_has_its_help_in_the_reference(site):
    named = re.findall(r"\{command-help\} (\w+)", (ROOT / "docs" / "commands.md").read_text())
    (declared,) = re.findall(
        r'"console_scripts": \[(.*?)\]', (ROOT / "setup.py").read_text(), re.DOTALL
    )
    scripts = re.findall(r'"(\w+) = ', declared)
    assert sorted(named) == sorted(scripts)
    page = (site / "commands.html").read_text()
    for name in named:
        assert f"usage: {name} [-h]" in page
