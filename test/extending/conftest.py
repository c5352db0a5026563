"""Runs code in processes with one more file in a package's folder."""

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from common import overlap

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TIMEOUT = 120.0

# The folder is added to the package's path before any import, so the package itself discovers
# the file.
PRELUDE = """
import importlib.machinery, json, sys
import numpy as np

ADDED = {{"{package}": "{folder}"}}

class WithFolder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name not in ADDED:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        spec.submodule_search_locations.append(ADDED[name])
        return spec

sys.meta_path.insert(0, WithFolder)

import pf_tracker_ros
from pf_tracker_ros import Tracker
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

def refusal(function, *arguments, **keywords):
    try:
        function(*arguments, **keywords)
    except ParameterError as error:
        return str(error)

SEQUENCE = "{sequence}"

def follow(tracker, start=0):
    with np.load(SEQUENCE) as sequence:
        images, boxes = sequence["images"], sequence["boxes"]
    tracker.start(images[start], boxes[start])
    return [tracker.update(image).box for image in images[start + 1:]]

import contextlib, io

for line in sys.stdin:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(json.loads(line), dict(globals()))
    print(json.dumps(printed.getvalue()), flush=True)
"""


@pytest.fixture(scope="session")
def extended(tmp_path_factory, moving_square):
    """A function that runs code in another process and returns the JSON that it prints.

    `examples`, if given, is a folder added to the package. Each has a process of its own.
    """
    sequence = tmp_path_factory.mktemp("extended") / "moving_square.npz"
    np.savez(sequence, images=moving_square.images, boxes=moving_square.boxes)
    processes = {}

    def start(package, examples):
        prelude = PRELUDE.format(package=package, folder=HERE / examples, sequence=sequence)
        return stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", prelude],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )

    def run(code, package="", examples=""):
        if examples not in processes:
            processes[examples] = start(package, examples)
        process = processes[examples]
        process.stdin.write(json.dumps(code) + "\n")
        process.stdin.flush()
        printed = process.stdout.readline()
        assert printed, "the process has ended with an error"
        return json.loads(json.loads(printed))

    with ExitStack() as stack:
        yield run


@pytest.fixture
def least_overlap(moving_square):
    """A function that computes the least intersection over union of boxes with the true ones."""
    return lambda boxes: min(map(overlap, boxes, moving_square.boxes[1:]))


@pytest.fixture(scope="session")
def run_beside():
    """Runs Python in a process that finds packages in some folders."""

    def run(folders, code, *arguments):
        path = [*folders, ROOT, ROOT / "test" / "helpers"]
        return subprocess.run(
            [sys.executable, "-c", code, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path))},
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )

    return run
