"""What several tests of the tracker's node need: quick parameters, parts of its messages."""

import importlib.util
import time
from pathlib import Path

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

DEADLINE = 60.0

# Parameters, where the tracker does not matter.
QUICK = {"preset": "li2007", "particles": 20, "image_reliability": "reliable"}
# With a box in each frame.
NEVER_OCCLUDED = {**QUICK, "track__wrong_box_cost": 0.0}


def overrides(values):
    """Parameters by name; double underscores stand for dots."""
    return [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]


def ids(status):
    """The ids of the targets in a status."""
    return [int(one.values["id"]) for one in status.targets]


def corners(message):
    """The corners of a published box, clockwise from the upper left."""
    return [(point.x, point.y) for point in message.polygon.points]


def corner(message):
    """The upper left corner of a published box."""
    return corners(message)[0]


def corners_of(box):
    """The corners of a box as they are published."""
    x, y, width, height = box
    points = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    return [tuple(float(np.float32(value)) for value in point) for point in points]


def box_in(row):
    """The box in a row of `boxes.csv`."""
    return tuple(float(row[name]) for name in ("x", "y", "width", "height"))


def moving_block(number):
    """(150, 200, 3) uint8: a block that moves over a still ground."""
    noise = np.random.default_rng(0).integers(172, 188, (150, 200, 1))
    image = np.repeat(noise, 3, axis=2).astype(np.uint8)
    left = 10 + number % 140
    image[60:101, left : left + 26] = (20, 20, 60)
    return image


def load_example(name):
    """The module of an example."""
    path = Path(__file__).resolve().parents[2] / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stamp_of(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def set_stamp(header, stamp):
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, 10**9)


class SpunNode(Node):
    """A node that the test spins while it waits."""

    def __init__(self, name, context, **options):
        super().__init__(name, context=context, **options)
        self.spinner = SingleThreadedExecutor(context=context)
        self.spinner.add_node(self)

    def wait_for(self, condition, what="", deadline=DEADLINE):
        """Spin until `condition()` is true and return it; fail after the deadline."""
        end = time.monotonic() + deadline
        while not (result := condition()):
            assert time.monotonic() < end, f"no {what} within {deadline} s"
            self.spinner.spin_once(timeout_sec=0.02)
        return result

    def close(self):
        self.spinner.shutdown()
        self.destroy_node()
