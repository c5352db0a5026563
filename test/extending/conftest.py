"""Packages with parts of every kind, installed by pip, and code that runs beside them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from common import run_python

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TIMEOUT = 120.0
PRELUDE = """
import json, sys
import numpy as np

def refusal(function, *arguments, **keywords):
    try:
        function(*arguments, **keywords)
    except ValueError as error:
        return str(error)
"""
# A bright square that moves over a dark image.
SCENE = """
from common import overlap
from pf_tracker_ros import MultiTracker, Tracker
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

boxes = [(20.0 + 2 * n, 30.0 + n, 24.0, 24.0) for n in range(20)]
images = []
for x, y, width, height in np.array(boxes, int):
    image = np.random.default_rng(0).integers(30, 90, (120, 160, 3)).astype(np.uint8)
    image[y:y + height, x:x + width] = (90, 230, 230)
    image[y + 8:y + 16, x + 8:x + 16] = (200, 230, 210)
    images.append(image)

def follow(**parameters):
    tracker = Tracker.from_preset(parameters.pop("preset", "default"), parameters={
        name.replace("__", "."): value for name, value in parameters.items()
    })
    tracker.start(images[0], boxes[0])
    return [tracker.update(image).box for image in images[1:]]

def least_overlap(found):
    return min(map(overlap, found, boxes[-len(found):]))
"""


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """Installs a package's folder; returns the folder in which it is found."""

    def install(package):
        folder = tmp_path_factory.mktemp("installed")
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
        command += ["--no-build-isolation", "--disable-pip-version-check", "--target", folder]
        done = subprocess.run(
            [*command, package], capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
        assert done.returncode == 0, done.stderr
        return folder

    return install


@pytest.fixture(scope="session")
def parts(installed, tmp_path_factory):
    """The folder in which a package with a part of every kind is installed."""
    package = tmp_path_factory.mktemp("package") / "parts"
    shutil.copytree(HERE / "own_package", package)
    for example in ("cues/brightness.py", "filter/random_walk.py", "features/cell_means.py"):
        shutil.copy(HERE / example, package / "parts_of_mine")
    return installed(package)


@pytest.fixture(scope="session")
def run_beside():
    """Runs Python in a process that finds packages in some folders."""

    def run(folders, code, *arguments):
        path = [*folders, ROOT, ROOT / "test" / "helpers"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path))}
        return run_python(code, *arguments, env=environment)

    return run


@pytest.fixture
def run(run_beside):
    """Runs code with packages in some folders; returns the JSON that it prints, and its log."""

    def start(code, *folders, prelude=PRELUDE + SCENE):
        done = run_beside(folders, prelude + code)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout), done.stderr

    return start


@pytest.fixture
def extended(run, parts):
    """Runs code with the parts; returns the JSON that it prints."""
    return lambda code: run(code, parts)[0]
