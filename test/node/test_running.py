"""A node as a process: garbage is collected between callbacks, never within one."""

import subprocess
import sys

SCRIPT = """
import gc
import weakref

import rclpy
from rclpy.node import Node

from pf_tracker_ros.node.running import run


class Circle:
    def __init__(self):
        self.itself = self


class Probe(Node):
    def __init__(self):
        super().__init__("probe")
        self.inside, self.within = False, 0
        self.first = None
        gc.callbacks.append(self.count)
        self.create_timer(0.01, self.work)

    def count(self, phase, info):
        self.within += self.inside

    def work(self):
        self.inside = True
        circles = [Circle() for _ in range(20_000)]
        if self.first is None:
            self.first = weakref.ref(circles[0])
        del circles
        self.inside = False
        if self.first() is None:
            print("collected within callbacks:", self.within)
            rclpy.try_shutdown()


run(Probe, [])
"""


def test_garbage_is_collected_between_callbacks(ros_domain):
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout == "collected within callbacks: 0\n"
