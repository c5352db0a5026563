"""`pf_tracker_ros.__version__` is the manifest's, however the package came here."""

import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

from common import run_python

import pf_tracker_ros

REPOSITORY = Path(__file__).resolve().parents[2]
VERSION = ElementTree.parse(REPOSITORY / "package.xml").findtext("version")
SHOW = "import pf_tracker_ros; print(pf_tracker_ros.__version__)"


def test_the_version_is_that_of_the_manifest():
    assert pf_tracker_ros.__version__ == VERSION
    assert {"Estimate", "Tracker", "__version__"} <= set(pf_tracker_ros.__all__)
    assert not hasattr(pf_tracker_ros, "version")


def test_the_version_of_sources_that_are_not_installed_is_theirs(tmp_path):
    (tmp_path / "package.xml").write_text("<package><version>7.8.9</version></package>")
    (tmp_path / "pf_tracker_ros").mkdir()
    shutil.copy(REPOSITORY / "pf_tracker_ros" / "__init__.py", tmp_path / "pf_tracker_ros")
    # Without the site's folders there is no metadata of any installation.
    outcome = subprocess.run(
        [sys.executable, "-S", "-c", SHOW],
        cwd=tmp_path,
        env={},
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome.stdout.strip() == "7.8.9", outcome.stderr


def test_an_import_and_the_version_load_neither_numpy_nor_opencv():
    """The executables take care of signals before the slow imports."""
    program = f"{SHOW}; import sys; print(sorted({{'numpy', 'cv2'}} & sys.modules.keys()))"
    outcome = run_python(program, check=True)
    assert outcome.stdout.splitlines()[1] == "[]"
