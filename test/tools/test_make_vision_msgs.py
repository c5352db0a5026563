"""The messages of detectors, made for the ROS of PyPI, in a real node."""

import json
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
NODE_TEST = "test/node/tracker/test_multi_target_detections.py"
# Of vision_msgs 4.1.1: Fast DDS of other machines compares them.
HASHES = {
    "Detection2DArray": "RIHS01_214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968",
    "Detection3DArray": "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
}

pytestmark = [
    pytest.mark.skipif(find_spec("vision_msgs") is not None, reason="vision_msgs is installed"),
    pytest.mark.skipif(find_spec("rosidl_generator_py") is None, reason="needs ROS from PyPI"),
]


@pytest.fixture
def tool(monkeypatch):
    """The module of the tool."""
    monkeypatch.syspath_prepend(TOOLS)
    import make_vision_msgs

    return make_vision_msgs


def test_the_types_are_those_of_other_machines(tool, tmp_path):
    tool.generate(tmp_path)
    for name, expected in HASHES.items():
        path = tmp_path / tool.STRUCTURES / "vision_msgs" / "msg" / f"{name}.json"
        hashes = {one["type_name"]: one["hash_string"] for one in json.loads(path.read_text())[
            "type_hashes"
        ]}  # fmt: skip
        assert hashes[f"vision_msgs/msg/{name}"] == expected


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_a_tracker_takes_the_made_messages_of_a_detector(tmp_path):
    command = [sys.executable, TOOLS / "make_vision_msgs.py", "--target", tmp_path]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (made.returncode, made.stderr) == (0, "")
    assert made.stdout == f"vision_msgs is installed in {tmp_path}\n"
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (again.returncode, again.stderr) == (1, "error: vision_msgs is installed already\n")
    repository = TOOLS.parent
    path = f"{repository}{os.pathsep}{tmp_path}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", NODE_TEST]
    command += ["-k", "start_targets", "-W", "ignore::DeprecationWarning"]
    tested = subprocess.run(
        command,
        cwd=repository,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert tested.returncode == 0, tested.stdout
    assert " skipped" not in tested.stdout


def test_what_is_missing_is_named(tool, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(tool.BuildError, match=r"run `apt install g\+\+`"):
        tool.check(tmp_path)
    monkeypatch.setattr(
        tool, "find_spec", lambda name: None if name == "catkin_pkg" else find_spec(name)
    )
    with pytest.raises(tool.BuildError, match=r"-m pip install catkin-pkg`"):
        tool.check(tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    with pytest.raises(tool.BuildError, match="this environment has no ROS from PyPI"):
        tool.check(tmp_path)
