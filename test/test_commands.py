"""What the executables do with arguments that are not for ROS."""

import os
import sys

import pytest
from common import run_python


def run(name, *arguments, before="", **options):
    """Runs a command after some code in its process."""
    code = f"import sys\n{before}\nimport pf_tracker_ros.commands as c; sys.exit(c.{name}())"
    return run_python(code, *arguments, **options)


@pytest.mark.parametrize("name", ["tracker", "localizer", "replay", "console"])
def test_help_tells_what_it_is_and_how_ros_gives_it_parameters(name):
    outcome = run(name, "--help")
    assert outcome.returncode == 0
    assert outcome.stdout.startswith(f"usage: {name} ")
    assert "--ros-args" in outcome.stdout
    assert "-p " in outcome.stdout


@pytest.mark.parametrize(
    ("name", "arguments", "cure"),
    [
        ("tracker", ["--preset", "li2007"], "tracker --ros-args -p preset:=li2007 ("),
        ("tracker", ["--preset=li2007"], "tracker --ros-args -p preset:=li2007 ("),
        ("tracker", ["preset:=li2007"], "tracker --ros-args -p NAME:=VALUE ("),
        ("tracker", ["drive.mcap"], "unknown argument drive.mcap;"),
        ("console", ["a.mcap", "b.mcap", "--loop"], "console --ros-args -p loop:=VALUE ("),
        ("console", ["a.mcap", "-r", "image:=/b"], "console --ros-args -r image:=/b ("),
        ("console", ["--port=80"], "console --ros-args -p port:=80 ("),
        ("replay", ["a.mcap", "--loop"], "replay --ros-args -p loop:=VALUE ("),
        ("replay", ["a.mcap", "b.mcap"], "unknown argument b.mcap;"),
        ("replay", ["--rate=2", "--ros-args", "-p", "x:=1"], "-p rate:=2 ("),
        ("replay", ["--ros-args", "-p", "loop:=true", "--", "--rate=2"], "-p rate:=2 ("),
    ],
)
def test_an_unknown_argument_is_refused_with_its_ros_form(name, arguments, cure):
    outcome = run(name, *arguments)
    assert outcome.returncode == 2
    assert outcome.stdout == ""
    (line,) = outcome.stderr.splitlines()
    assert line.startswith(f"{name}: error: ")
    assert cure in line


def test_another_package_that_ends_a_command_is_named(tmp_path):
    """As a cue may, in any of its methods."""
    (tmp_path / "cue.py").write_text("import sys\ndef main():\n    sys.exit(3)\n")
    path = os.pathsep.join([str(tmp_path), *sys.path[1:]])
    outcome = run(
        "evaluate",
        before="import pf_tracker_ros.evaluation.__main__ as e, cue; e.main = cue.main",
        env={**os.environ, "PYTHONPATH": path},
    )
    assert outcome.returncode == 1
    assert outcome.stderr == (
        f"evaluate: error: {tmp_path / 'cue.py'}, line 3, has ended the process (SystemExit: 3); "
        "remove its package, or choose none of its parts\n"
    )
    assert run("evaluate", "--presets").returncode == 2


def test_the_console_reports_a_missing_package():
    outcome = run("console", before="sys.modules['aiohttp'] = None")
    assert outcome.returncode == 2
    assert "console: error: the Python package aiohttp is missing" in outcome.stderr
    assert "apt" in outcome.stderr


NO_RCLPY = """
import importlib.util as u
find = u.find_spec
u.find_spec = lambda name, *rest: None if name == "rclpy" else find(name, *rest)
"""


@pytest.mark.parametrize("name", ["tracker", "localizer", "replay", "console"])
def test_without_ros_one_line_says_how_to_get_it(name):
    outcome = run(name, before=NO_RCLPY)
    assert outcome.returncode == 2
    (line,) = outcome.stderr.splitlines()
    assert line.startswith(f"{name}: error: rclpy is not installed: ")


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("nowhere.mcap", "not playing: there is no nowhere.mcap; accepted are"),
        (os.fsdecode(b"v\xe4.mp4"), "is not UTF-8, as ROS requires; rename the file"),
    ],
)
@pytest.mark.usefixtures("ros_domain")
def test_replay_ends_if_the_path_cannot_be_played(path, reason):
    outcome = run("replay", path)
    assert outcome.returncode == 2
    (line,) = outcome.stderr.splitlines()
    assert reason in line


def test_replay_takes_a_path(ros_domain, moving_square_sequence):
    outcome = run("replay", moving_square_sequence, "--ros-args", "-p", "rate:=100.0")
    assert outcome.returncode == 0, outcome.stderr
    assert "published 20 frames of moving_square" in outcome.stderr
