"""Broken packages of others are named with a reason, and everything else works."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

TIMEOUT = 120.0
ROOT = Path(__file__).resolve().parents[2]
CODE = """
import dataclasses, sys
import numpy as np
from pf_tracker_ros import Detections
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

@dataclasses.dataclass(frozen=True)
class Parameters:
    level: int = declared({default}, {description}, minimum=0, maximum={maximum})

@DETECTORS.register("broken", Parameters)
class Broken:
    def __init__(self, parameters):
        {constructor}

    def detect(self, image, interval=0.04):
        {detect}
"""
USUAL = {
    "default": "1",
    "description": "'A level.'",
    "maximum": "9",
    "constructor": "pass",
    "detect": "return Detections([])",
}
# In a process of its own: the tracker tracks, the detector is refused or runs.
PROGRAM = """
import json
import numpy as np
from pf_tracker_ros import MultiTracker, Tracker
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, DetectorThread

image = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
tracker = Tracker.from_preset("default", parameters={"particles": 20})
tracker.start(image, (20, 20, 30, 30))
tracker.update(image)
node = build(NodeParameters, {"built_in_detector": "broken"})
try:
    detector = DETECTORS.make("broken", node.detector_parameters["broken"])
except ValueError as error:
    print(json.dumps(["refused", str(error)]))
else:
    thread = DetectorThread(detector, 5.0)
    thread.offer(image, 0)
    try:
        print(json.dumps(["ran", repr(thread.take(wait=True))]))
    except Exception as error:
        print(json.dumps([type(error).__name__, str(error)]))
    thread.close()
"""
WHO = "the detector 'broken' of broken-things (broken_things:Broken) cannot be used: "


@pytest.fixture
def install(tmp_path):
    """Installs a package with a detector; returns its folder."""

    def install(code, name="broken-things", points=None):
        (tmp_path / "broken_things.py").write_text(code)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        points = points or b"[pf_tracker_ros.detectors]\nbroken = broken_things:Broken\n"
        (info / "entry_points.txt").write_bytes(points)
        return tmp_path

    return install


def run(folder, command, stdin=None):
    path = os.pathsep.join(map(str, (folder, ROOT)))
    return subprocess.run(
        [sys.executable, *command],
        env={**os.environ, "PYTHONPATH": path},
        input=stdin,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )


def outcome(folder):
    done = run(folder, ["-c", PROGRAM])
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


BROKEN_IMPORTS = [
    ("import sys\nsys.exit(3)", "SystemExit: 3"),
    ("raise KeyboardInterrupt", "KeyboardInterrupt:"),
    ("raise BaseException('x' * 100_000)", f"BaseException: {'x' * 485}..."),
    (CODE.format(**{**USUAL, "default": "17"}), "ParameterError: parameter 'level' is 17; allowed"),
    (CODE.format(**{**USUAL, "default": "True"}), "ParameterError: parameter 'level' is True"),
    (CODE.format(**{**USUAL, "description": "None"}), "TypeError: 'level' is described by None"),
    (CODE.format(**{**USUAL, "maximum": "1 << 70"}), "TypeError: the range of 'level' is not"),
    (CODE.format(**USUAL).replace("level: int", "level: bytes"), "TypeError: the type of 'level'"),
]


@pytest.mark.parametrize(("code", "reason"), BROKEN_IMPORTS)
def test_a_broken_import_is_named_and_the_rest_works(install, code, reason):
    (kind, message), log = outcome(install(code))
    assert kind == "refused"
    assert message.startswith(WHO + reason)
    assert log.splitlines() == [message]


@pytest.mark.parametrize(
    "points",
    [
        b"[pf_tracker_ros.detectors]\nbroken\n",
        b"[console_scripts]\nbroken\n",
        b"[pf_tracker_ros.detectors]\nbr\xf6ken = broken_things:Broken\n",
    ],
)
def test_a_damaged_list_of_entry_points_is_named(install, points):
    folder = install(CODE.format(**USUAL), "broken-things", points)
    install(CODE.format(**USUAL), "whole-things")
    (kind, _), log = outcome(folder)
    assert kind == "ran"
    (line,) = log.splitlines()
    assert line.startswith("the entry points of the package broken-things cannot be read")
    assert line.endswith("install it again, or remove it")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, ["ran", "None"]),
        ({"constructor": "sys.exit(3)"}, ["refused", f"{WHO}SystemExit: 3"]),
        ({"constructor": "raise OSError('no GPU')"}, ["refused", f"{WHO}OSError: no GPU"]),
        ({"detect": "sys.exit(3)"}, ["ForeignError", "SystemExit: 3"]),
        (
            {"detect": "return 'a person'"},
            [
                "ForeignError",
                "TypeError: it returned 'a person'; allowed: Detections or None",
            ],
        ),
        ({"detect": "raise OSError('x' * 100_000)"}, ["ForeignError", f"OSError: {'x' * 491}..."]),
    ],
)
def test_a_detector_that_fails_is_refused_with_its_error(install, changed, expected):
    found, _ = outcome(install(CODE.format(**{**USUAL, **changed})))
    if not changed:
        assert found[0] == "ran"
    else:
        assert found == expected


NODE = """
import json, sys
import rclpy
from rclpy.parameter import Parameter
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
rclpy.init()
node = TrackerNode([])
refused = node.set_parameters([Parameter("built_in_detector", value="broken")])[0].reason
print(json.dumps([node.get_parameter("autostart").value, node.lifecycle_state, refused]))
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.parametrize(("code", "reason"), [BROKEN_IMPORTS[0], *BROKEN_IMPORTS[3:]])
def test_the_node_runs_beside_a_broken_package(install, code, reason, ros_domain):
    pytest.importorskip("rclpy")
    done = run(install(code), ["-c", NODE])
    assert done.returncode == 0, done.stderr
    autostart, state, refused = json.loads(done.stdout)
    assert (autostart, state) == (True, "active")
    assert WHO + reason in refused


def test_ctrl_c_during_an_import_ends_the_command(install):
    """It is the user's own, not an error of the package."""
    code = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)"
    done = run(install(code), ["-c", PROGRAM])
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")
