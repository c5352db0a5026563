"""Broken packages of others are named with a reason, and everything else works."""

import json

import pytest

CODE = """
import dataclasses, sys
import numpy as np
from pf_tracker_ros import Detections
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

@dataclasses.dataclass(frozen=True)
class Parameters:
    level: int = declared({default}, {description}, minimum=0, maximum={maximum})

@DETECTORS.register("{name}", Parameters)
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
# In a process of its own: the tracker tracks, each detector is refused or runs.
PROGRAM = """
import json, sys
import numpy as np
from pf_tracker_ros import MultiTracker, Tracker
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, DetectorThread

image = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
tracker = Tracker.from_preset("default", parameters={"particles": 20})
tracker.start(image, (20, 20, 30, 30))
tracker.update(image)
results = []
for name in sys.argv[1:]:
    node = build(NodeParameters, {"built_in_detector": name})
    try:
        detector = DETECTORS.make(name, node.detector_parameters[name])
    except ValueError as error:
        results.append(["refused", str(error)])
    else:
        thread = DetectorThread(detector, 5.0)
        thread.offer(image, 0)
        try:
            results.append(["ran", repr(thread.take(wait=True))])
        except Exception as error:
            results.append([type(error).__name__, str(error)])
        thread.close()
print(json.dumps(results))
"""


def refusal_of(name):
    """The begin of an error about a detector."""
    return f"the detector '{name}' of broken-things (things_{name}:Broken) cannot be used: "


@pytest.fixture
def install(tmp_path):
    """Installs a package of detectors, given as name to code; returns its folder."""

    def install(codes, package="broken-things", points=None):
        lines = ["[pf_tracker_ros.detectors]"]
        for name, code in codes.items():
            (tmp_path / f"things_{name}.py").write_text(code)
            lines.append(f"{name} = things_{name}:Broken")
        info = tmp_path / f"{package}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_bytes(points or "\n".join(lines).encode())
        return tmp_path

    return install


def code_of(name, **changed):
    return CODE.format(**{**USUAL, "name": name, **changed})


@pytest.fixture
def outcomes(install, run_beside):
    """What becomes of the detectors of a package, and the log."""

    def run(codes, **package):
        done = run_beside([install(codes, **package)], PROGRAM, *codes)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout), done.stderr

    return run


# Name to code and reason.
BROKEN_IMPORTS = {
    "exit": ("import sys\nsys.exit(3)", "SystemExit: 3"),
    "interrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt:"),
    "long": ("raise BaseException('x' * 100_000)", f"BaseException: {'x' * 485}..."),
    "range": (
        code_of("range", default="17"),
        "ParameterError: parameter 'level' is 17; allowed",
    ),
    "flag": (code_of("flag", default="True"), "ParameterError: parameter 'level' is True"),
    "text": (code_of("text", description="None"), "TypeError: 'level' is described by None"),
    "limit": (code_of("limit", maximum="1 << 70"), "TypeError: the range of 'level' is not"),
    "type": (
        code_of("type").replace("level: int", "level: bytes"),
        "TypeError: the type of 'level'",
    ),
}


def test_a_broken_import_is_named_and_the_rest_works(outcomes):
    found, log = outcomes({name: code for name, (code, _) in BROKEN_IMPORTS.items()})
    for (kind, message), (name, (_, reason)) in zip(found, BROKEN_IMPORTS.items(), strict=True):
        assert kind == "refused"
        assert message.startswith(refusal_of(name) + reason)
    assert sorted(log.splitlines()) == sorted(message for _, message in found)


def test_a_damaged_list_of_entry_points_is_named(install, outcomes):
    damaged = {
        "a": b"[pf_tracker_ros.detectors]\nbroken\n",
        "b": b"[console_scripts]\nbroken\n",
        "c": b"[pf_tracker_ros.detectors]\nbr\xf6ken = things_whole:Broken\n",
    }
    for name, points in damaged.items():
        install({}, f"broken-{name}", points)
    ((kind, _),), log = outcomes({"whole": code_of("whole")}, package="whole-things")
    assert kind == "ran"
    for line, name in zip(sorted(log.splitlines()), damaged, strict=True):
        assert line.startswith(f"the entry points of the package broken-{name} cannot be read")
        assert line.endswith("install it again, or remove it")


# Name to changed code and outcome.
FAILING = {
    "whole": ({}, ["ran", "None"]),
    "exits": (
        {"constructor": "sys.exit(3)"},
        ["refused", f"{refusal_of('exits')}SystemExit: 3"],
    ),
    "fails": (
        {"constructor": "raise OSError('no GPU')"},
        ["refused", f"{refusal_of('fails')}OSError: no GPU"],
    ),
    "ends": ({"detect": "sys.exit(3)"}, ["ForeignError", "SystemExit: 3"]),
    "talks": (
        {"detect": "return 'a person'"},
        ["ForeignError", "TypeError: it returned 'a person'; allowed: Detections or None"],
    ),
    "long": (
        {"detect": "raise OSError('x' * 100_000)"},
        ["ForeignError", f"OSError: {'x' * 491}..."],
    ),
}


def test_a_detector_that_fails_is_refused_with_its_error(outcomes):
    found, _ = outcomes({name: code_of(name, **changed) for name, (changed, _) in FAILING.items()})
    assert found[0][0] == "ran"
    assert found[1:] == [expected for _, expected in FAILING.values()][1:]


def test_ctrl_c_during_an_import_ends_the_command(install, run_beside):
    """It is the user's own, not an error of the package."""
    code = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)"
    done = run_beside([install({"slow": code})], PROGRAM, "slow")
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")
