"""The real `ros2` command line, as a user types it; tests that need it are skipped without it."""

import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from importlib import util
from pathlib import Path

import cv2
import numpy as np
import pytest

PACKAGE = "pf_tracker_ros"


class Shell:
    """Runs commands as a user types them, with the package built by colcon and sourced.

    Attributes:
        folder: Where the commands run.
    """

    def __init__(self, setup, folder):
        self.folder = folder
        self._setup = setup

    def run(self, command):
        """Run a command to its end."""
        return subprocess.run(
            self._words(command),
            env=_not_of_this_process(),
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    def wait_for_node(self, name, deadline=40.0):
        """Wait until the daemon of the command line knows a node, as it does after some seconds."""
        end = time.monotonic() + deadline
        while name not in self.run("ros2 node list").stdout.split():
            assert time.monotonic() < end, f"no node {name} within {deadline} s"

    def run_until_answered(self, command, deadline=40.0):
        """Run a command that asks a node; one that has just begun may not see its services yet."""
        end = time.monotonic() + deadline
        while (asked := self.run(command)).returncode != 0 or not asked.stdout.strip():
            assert time.monotonic() < end, asked.stderr
        return asked.stdout

    @contextlib.contextmanager
    def started(self, command):
        """A command that goes on, ended with the block as Ctrl-C does."""
        running = Running(
            subprocess.Popen(
                self._words(command),
                env={**_not_of_this_process(), "PYTHONUNBUFFERED": "1"},
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,
            )
        )
        try:
            yield running
        finally:
            running.end()
            # pytest shows it if the test fails.
            print(f"$ {command}\n{running.output}")

    def _words(self, command):
        executables = self._setup.parent / PACKAGE / "lib" / PACKAGE
        return ["bash", "-c", f"source {self._setup} && PATH=$PATH:{executables} && {command}"]


class Running:
    """A command that was started, and all that it has printed so far."""

    def __init__(self, process):
        self._process = process
        self._lines = []
        self._printed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def output(self):
        return "".join(self._lines)

    def wait_for(self, text, deadline=40.0):
        """Wait until it has printed a text."""
        end = time.monotonic() + deadline
        with self._printed:
            while text not in self.output:
                assert self._printed.wait(end - time.monotonic()), f"no {text!r} in {self.output}"

    def end(self):
        """End it if it has not ended, as Ctrl-C does in a terminal; its exit code."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGINT)
        return self.wait(30.0)

    def wait(self, timeout):
        """Its exit code, once it has ended; it is killed if it does not."""
        try:
            return self._process.wait(timeout)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._reader.join(10.0)

    def _read(self):
        for line in self._process.stdout:
            with self._printed:
                self._lines.append(line)
                self._printed.notify_all()


def _not_of_this_process():
    """This process' variables without the marks of the ROS wheels, which are for it alone."""
    marks = ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH")
    wheels = util.find_spec("ros_wheels_bootstrapper") is not None
    return {k: v for k, v in os.environ.items() if not (wheels and k in marks)}


@pytest.fixture(scope="session")
def built(workspace, colcon):
    """The workspace's setup.bash after `colcon build`."""
    colcon("build")
    return workspace / "install" / "setup.bash"


@pytest.fixture
def shell(built, ros_domain, tmp_path):
    """A `Shell` in a folder and a ROS domain of its own; needs the real `ros2` command."""
    if shutil.which("ros2") is None:
        pytest.skip("no ros2 command: it comes with a ROS from apt, and PyPI has none")
    opened = Shell(built, tmp_path)
    yield opened
    # The commands start it, one for each domain.
    opened.run("ros2 daemon stop")


@pytest.fixture
def heard(ros_domain):
    """Waits for a message on a topic, and returns it."""
    rclpy = pytest.importorskip("rclpy")
    from nodes import SpunNode

    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = SpunNode("listener", context)

    def wait(message_type, topic):
        found = []
        subscription = node.create_subscription(message_type, topic, found.append, 10)
        node.wait_for(lambda: found, f"message on {topic}")
        node.destroy_subscription(subscription)
        return found[0]

    yield wait
    node.close()
    context.try_shutdown()


@pytest.fixture
def record_drive(tmp_path):
    """A function that records 4 s at 25 Hz, a textured box going right from (42, 188, 44, 132).

    It takes the name of the file or folder, and returns its path; the topic is /camera/image_raw.
    """
    pytest.importorskip("rosbags")
    from pf_tracker_ros.footage import BagWriter

    def record(name):
        with BagWriter(tmp_path / name) as bag:
            bag.add_topic("/camera/image_raw", "sensor_msgs/msg/Image")
            for index, image in enumerate(_drive()):
                bag.write_image("/camera/image_raw", 10**9 + index * 40_000_000, image)
        return tmp_path / name

    return record


@pytest.fixture
def drive(record_drive):
    """The path of such a recording, `drive.mcap`."""
    return record_drive("drive.mcap")


def _drive():
    generator = np.random.default_rng(5)
    ground = cv2.resize(generator.integers(40, 90, (12, 16, 3), dtype=np.uint8), (640, 480))
    target = cv2.resize(generator.integers(0, 255, (17, 6, 3), dtype=np.uint8), (44, 132))
    for index in range(100):
        image = ground.copy()
        left = 42 + 2 * index
        image[188 : 188 + 132, left : left + 44] = target
        yield image


@pytest.fixture
def console_port():
    """Keeps the console's default port to one test at a time; others run in parallel."""
    with (Path(tempfile.gettempdir()) / "pf_tracker_ros_console_port.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield 8642
