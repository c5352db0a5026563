"""Settings of Sphinx for `make docs` and for rosdoc2, which runs this file in a copy of `docs/`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

# The package of this repository, whether or not another one is installed.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pf_tracker_ros import __version__

project = "pf_tracker_ros"
author = "pf_tracker_ros maintainers"
copyright = f"{author}, Apache License 2.0"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
# What rosdoc2 adds to its copy: files of the repository, whose links lead from there.
exclude_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.rst", "__*"]

myst_heading_anchors = 4
highlight_language = "none"
# They would turn the two hyphens of an option into a dash.
smartquotes = False
# Docstrings have code in single backticks, as in Markdown.
default_role = "code"

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
# Attributes as a list, not as entries that those of a dataclass would repeat.
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"pf_tracker_ros {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_search_scorer = str(Path(__file__).with_name("search_scorer.js"))
html_show_sphinx = False

# Not the tag of the release, which lacks what was added since.
_SOURCES = "https://github.com/pf-tracker-ros/pf_tracker_ros/blob/main/"
_HELP_WIDTH = "88"
_HELP_TIMEOUT = 60.0


class CommandHelp(SphinxDirective):
    """What an executable of the package prints for `--help`: `{command-help} track`."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Run the executable's entry point in a process of its own.

        Raises:
            ExtensionError: By `self.error`, if it fails.
        """
        name = self.arguments[0]
        code = f"import sys; from pf_tracker_ros.commands import {name}; sys.exit({name}())"
        done = subprocess.run(
            [sys.executable, "-c", code, "--help"],
            env={**os.environ, "COLUMNS": _HELP_WIDTH, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            timeout=_HELP_TIMEOUT,
            check=False,
        )
        if done.returncode:
            raise self.error(f"`{name} --help` failed: {done.stderr}")
        return [nodes.literal_block(done.stdout, done.stdout, language="none")]


def link_to_sources(app: Sphinx, page: str, text: list[str]) -> None:
    """Turn links to files outside of `docs/` into links to the repository."""
    text[0] = re.sub(r"\]\(\.\./", f"]({_SOURCES}", text[0])


def setup(app: Sphinx) -> None:
    """Register what this file adds to Sphinx."""
    app.add_directive("command-help", CommandHelp)
    app.connect("source-read", link_to_sources)
