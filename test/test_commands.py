"""What the executables do with arguments that are not for ROS."""

import os
import subprocess
import sys

import pytest

TIMEOUT = 60.0


def command(name, *arguments):
    code = f"import sys, pf_tracker_ros.commands as c; sys.exit(c.{name}())"
    return [sys.executable, "-c", code, *map(str, arguments)]


def run(name, *arguments):
    return subprocess.run(
        command(name, *arguments), capture_output=True, text=True, timeout=TIMEOUT, check=False
    )


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
    code = (
        "import sys, pf_tracker_ros.commands as c, pf_tracker_ros.evaluation.__main__ as e\n"
        "import cue; e.main = cue.main; sys.exit(c.evaluate())"
    )
    outcome = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path[1:]])},
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert outcome.returncode == 1
    place = f"{tmp_path / 'cue.py'}, line 3"
    assert outcome.stderr == (
        f"evaluate: error: {place}, has ended the process (SystemExit: 3); remove its package, or "
        "choose none of its parts\n"
    )
    assert run("evaluate", "--presets").returncode == 2


def test_the_console_reports_a_missing_package():
    code = (
        "import sys; sys.modules['aiohttp'] = None\n"
        "import pf_tracker_ros.commands as c; sys.exit(c.console())"
    )
    outcome = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=TIMEOUT, check=False
    )
    assert outcome.returncode == 2
    assert "console: error: the Python package aiohttp is missing" in outcome.stderr
    assert "apt" in outcome.stderr


@pytest.mark.parametrize("name", ["tracker", "localizer", "replay", "console"])
def test_without_ros_one_line_says_how_to_get_it(name):
    code = (
        "import importlib.util as u, sys\n"
        "find = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'rclpy' else find(name, *rest)\n"
        f"import pf_tracker_ros.commands as c; sys.exit(c.{name}())"
    )
    outcome = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=TIMEOUT, check=False
    )
    assert outcome.returncode == 2
    (line,) = outcome.stderr.splitlines()
    assert line.startswith(f"{name}: error: rclpy is not installed: ")


def test_replay_ends_if_the_path_cannot_be_played(ros_domain):
    outcome = run("replay", "nowhere.mcap")
    assert outcome.returncode == 2
    (line,) = outcome.stderr.splitlines()
    assert "not playing: there is no nowhere.mcap; accepted are" in line


def test_replay_takes_a_path(ros_domain, moving_square_sequence):
    outcome = run("replay", moving_square_sequence, "--ros-args", "-p", "rate:=100.0")
    assert outcome.returncode == 0, outcome.stderr
    assert "published 20 frames of moving_square" in outcome.stderr


def test_a_path_that_is_not_utf_8_is_refused():
    outcome = run("replay", os.fsdecode(b"v\xe4.mp4"))
    assert outcome.returncode == 2
    assert "is not UTF-8, as ROS requires; rename the file" in outcome.stderr
