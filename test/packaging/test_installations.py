"""Installed in any of the three ways, the package is whole and its executables work."""

import os
from importlib import util
from pathlib import Path

import pytest
import rclpy
from nodes import SpunNode
from rclpy.context import Context
from rclpy.parameter_client import AsyncParameterClient

from pf_tracker_ros import __version__

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"

pytestmark = pytest.mark.skipif(
    util.find_spec("ros_wheels_bootstrapper") is None,
    reason="the installations are made of the ROS wheels that make installs",
)


@pytest.fixture
def remote_parameters(ros_domain):
    """Asks a node in the test's domain for the values of its parameters."""
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = SpunNode("client", context)

    def ask(name, parameters):
        client = AsyncParameterClient(node, name)
        assert client.wait_for_services(timeout_sec=60.0), f"no answer from {name}"
        # An answer that is sent before the node knows this client as well is lost.
        for _ in range(30):
            future = client.get_parameters(parameters)
            node.spinner.spin_until_future_complete(future, timeout_sec=2.0)
            if future.done():
                return future.result().values
        raise AssertionError(f"no answer from {name}")

    yield ask
    node.close()
    context.try_shutdown()


def files_of(folder, *patterns):
    return {str(path.relative_to(folder)) for pattern in patterns for path in folder.rglob(pattern)}


def test_the_package_is_whole(installation):
    code = f"import {PACKAGE} as p; print(p.__path__[0], p.__version__)"
    installed, version = installation.evaluate(code).split()
    assert version == __version__
    assert Path(installed).is_relative_to(installation.prefix)
    patterns = ("*.py", "py.typed", "*.jinja")
    assert files_of(Path(installed), *patterns) == files_of(REPOSITORY / PACKAGE, *patterns)
    for folder, pattern in (("config", "*.yaml"), ("config", "*.xml"), ("launch", "*.launch.py")):
        expected = files_of(REPOSITORY / folder, pattern)
        assert expected
        assert files_of(installation.share / folder, pattern) == expected
    assert (installation.share / "package.xml").is_file()
    index = installation.prefix / "share/ament_index/resource_index/packages"
    assert (index / PACKAGE).exists()
    for executable, option in (("evaluate", "--preset"), ("track", "--box")):
        outcome = installation.call(executable, "--help")
        assert outcome.returncode == 0, outcome.stderr
        assert option in outcome.stdout


def test_tracker_starts_with_an_installed_preset_answers_and_ends_with_ctrl_c(
    installation, remote_parameters, interrupt
):
    preset = installation.share / "config" / "li2007.yaml"
    with installation.started("tracker", "--ros-args", "--params-file", preset) as process:
        (value,) = remote_parameters("pf_tracker", ["preset"])
        assert value.string_value == "li2007"
        assert interrupt(process) == 0


def test_replay_plays_a_sequence_to_its_end(installation, ros_domain, moving_square_sequence):
    source = f"source:={moving_square_sequence}"
    outcome = installation.call("replay", "--ros-args", "-p", source, "-p", "rate:=100.0")
    assert outcome.returncode == 0, outcome.stderr
    assert "published 20 frames" in outcome.stderr


def test_the_commands_take_a_sequence(colcon_installation, moving_square_sequence, tmp_path):
    given = ("evaluate", moving_square_sequence, "--seeds", "1", "--output", tmp_path / "r.json")
    outcome = colcon_installation.call(*given)
    assert outcome.returncode == 0, outcome.stderr
    assert "moving_square" in (tmp_path / "r.json").read_text()
    outcome = colcon_installation.call("track", moving_square_sequence, "--output", tmp_path)
    assert outcome.returncode == 0, outcome.stderr
    assert len((tmp_path / "boxes.csv").read_text().splitlines()) == 21


def test_symlink_install_runs_the_source(colcon, sourced, workspace, colcon_installation):
    bases = ("--build-base", "build_symlink", "--install-base", "install_symlink")
    colcon("build", "--symlink-install", *bases)
    prefix = workspace / "install_symlink" / PACKAGE
    assert os.access(prefix / "lib" / PACKAGE / "tracker", os.X_OK)
    assert (prefix / "share" / PACKAGE / "config" / "default.yaml").is_file()
    symlinked = type(colcon_installation)(
        prefix, prefix / "lib" / PACKAGE, colcon_installation.python, sourced("install_symlink")
    )
    installed = symlinked.evaluate(f"import {PACKAGE}; print({PACKAGE}.__path__[0])")
    assert Path(installed).resolve() == workspace / "src" / PACKAGE / PACKAGE
    assert symlinked.evaluate(f"import {PACKAGE}; print({PACKAGE}.__version__)") == __version__


def test_colcon_test_runs_pytest(colcon, workspace, colcon_installation):
    colcon("test", "--pytest-args", "test/packaging/test_manifest.py", "-k", "version")
    summary = colcon("test-result", "--verbose")
    assert " 0 errors, 0 failures, 0 skipped" in summary
    assert "Summary: 0 tests" not in summary


def test_neither_ros_nor_opencv_is_required_without_its_extra(requires, without_extra):
    taken = [item["metadata"]["name"] for item in without_extra.report["install"]]
    assert taken == [PACKAGE]
    assert not [name for name in requires() if name.startswith(("ros", "rclpy", "opencv"))]
    for extra, names in {
        "ros": ("ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "rosbags", "opencv"),
        "bags": ("rosbags",),
        "opencv": ("opencv-python-headless",),
    }.items():
        for name in names:
            assert [text for text in requires(extra) if text.startswith(name)]
    code = f"from {PACKAGE} import Tracker; print(Tracker.from_preset('default').started)"
    assert without_extra.installation.evaluate(code) == "False"


def test_without_an_opencv_the_library_says_how_to_get_one(without_opencv):
    code = """
import pf_tracker_ros
for source in ("pf_tracker_ros", "pf_tracker_ros.targets.tracker"):
    try:
        exec(f"from {source} import Tracker")
    except ImportError as error:
        print(error.name, error)
print(pf_tracker_ros.__version__)
"""
    *said, version = without_opencv.evaluate(code).splitlines()
    assert len(said) == 2
    for line in said:
        assert line.startswith("cv2 OpenCV is missing: pip install opencv-python-headless")
        assert "apt install python3-opencv" in line
    assert version == __version__


@pytest.mark.parametrize("executable", ["evaluate", "track", "tracker", "replay"])
def test_without_an_opencv_the_executables_say_how_to_get_one(without_opencv, executable):
    outcome = without_opencv.call(executable)
    assert outcome.returncode == 2
    assert outcome.stderr.startswith(f"{executable}: error: OpenCV is missing: pip install")
    assert len(outcome.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("executable", "extra", "options"),
    [
        ("evaluate", "evaluation", ["."]),
        ("track", "recordings", [".", "--output", "out"]),
        ("tracker", "ros", []),
        ("replay", "ros", []),
    ],
)
def test_executables_name_what_is_missing(without_extra, executable, extra, options):
    outcome = without_extra.installation.call(executable, *options)
    assert outcome.returncode == 2
    last_line = outcome.stderr.strip().splitlines()[-1]
    assert ("rclpy" if extra == "ros" else "rich") in last_line
    assert f"[{extra}]" in last_line
    assert "Traceback" not in outcome.stderr
