"""A live localizer, and a scene whose boxes, depth and odometry are worked out by hand."""

import math
from array import array
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from nodes import SpunNode, overrides, set_stamp, stamp_of
from sensor_msgs.msg import CameraInfo, Image, Imu

from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

WIDTH, HEIGHT, FOCAL = 640, 480, 500.0
CX, CY = 319.5, 239.5
CAMERA_HEIGHT, TARGET_HEIGHT, TARGET_WIDTH = 1.5, 1.75, 0.5
FRAME, START = 40_000_000, 1_700_000_000_000_000_000
OPTICAL = "camera_optical_frame"


def box_at(forward, left):
    """The box of a target in front of a level camera: by similar triangles, in whole pixels' edges.

    Pixel centers are whole numbers, so an edge is half a pixel further.
    """
    scale = FOCAL / forward
    foot = CY + scale * CAMERA_HEIGHT + 0.5
    middle = CX - scale * left + 0.5
    height, width = scale * TARGET_HEIGHT, scale * TARGET_WIDTH
    return (middle - width / 2, foot - height, width, height)


def target_values(id=1, box=(0, 0, 1, 1), state="tracking", confidence=0.9, label="person"):
    covariance = {"covariance_xx": 1.0, "covariance_yy": 1.0}
    covariance |= {"covariance_ww": 4.0, "covariance_hh": 4.0}
    sides = dict(zip(("box_x", "box_y", "box_width", "box_height"), box, strict=True))
    common = {"id": id, "label": label, "state": state, "confidence": confidence}
    return common | sides | covariance


def status_message(stamp, targets, selected=1, **values):
    """A status as the tracker publishes it, built without the project's own code."""
    own = {"frame": "tracked", "state": "tracking", "selected": selected}
    own |= {"image_width": WIDTH, "image_height": HEIGHT} | values
    message = DiagnosticArray()
    set_stamp(message.header, stamp)
    message.header.frame_id = OPTICAL
    for name, one in [("/pf_tracker", own), *((f"target {t['id']}", t) for t in targets)]:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in one.items()]
        message.status.append(DiagnosticStatus(name=name, values=pairs))
    return message


def camera_info(width=WIDTH, height=HEIGHT, focal=FOCAL):
    k = [focal, 0.0, CX, 0.0, focal, CY, 0.0, 0.0, 1.0 if focal else 0.0]
    return CameraInfo(width=width, height=height, distortion_model="plumb_bob", d=[0.0] * 5, k=k)


def depth_message(stamp, depth, encoding=""):
    encoding = encoding or ("16UC1" if depth.dtype == np.uint16 else "32FC1")
    message = Image(height=depth.shape[0], width=depth.shape[1], encoding=encoding)
    message.step = depth[0].nbytes
    message.data = array("B", depth.tobytes())
    set_stamp(message.header, stamp)
    return message


def odometry_message(stamp, x=0.0, y=0.0, yaw=0.0, frame="odom"):
    message = Odometry()
    set_stamp(message.header, stamp)
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    turn = message.pose.pose.orientation
    turn.z, turn.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


def imu_message(stamp, up, frame=OPTICAL):
    message = Imu()
    set_stamp(message.header, stamp)
    message.header.frame_id = frame
    acceleration = message.linear_acceleration
    acceleration.x, acceleration.y, acceleration.z = (9.81 * value for value in up)
    return message


@pytest.fixture(scope="session")
def given():
    """The scene's numbers, and the functions that make messages."""
    return SimpleNamespace(
        width=WIDTH,
        height=HEIGHT,
        start=START,
        frame=FRAME,
        optical=OPTICAL,
        camera_height=CAMERA_HEIGHT,
        box_at=box_at,
        target=target_values,
        status=status_message,
        camera_info=camera_info,
        depth=depth_message,
        gray=lambda stamp, image: depth_message(stamp, image, "mono8"),
        odometry=odometry_message,
        imu=imu_message,
        stamp_of=lambda message: stamp_of(message.header),
    )


@dataclass
class Status:
    """A status of the localizer: sentence, level and values, and those of each target by id."""

    stamp: int
    name: str
    message: str
    level: bytes
    values: dict
    targets: dict = field(default_factory=dict)


def parsed(message):
    own = message.status[0]
    values = [{item.key: item.value for item in one.values} for one in message.status]
    by_id = {int(one["id"]): one for one in values[1:]}
    return Status(stamp_of(message.header), own.name, own.message, own.level, values[0], by_id)


class Scene(SpunNode):
    """Publishes what a tracker and sensors would, and stores what the localizer publishes."""

    def __init__(self, graph):
        super().__init__("scene", graph.context())
        self._graph = graph
        self.statuses, self.poses, self.health = [], [], []
        self._tracker = self.create_publisher(DiagnosticArray, "pf_tracker/status", 10)
        self._senders = {}
        self.add_sensor(CameraInfo, "camera_info")
        self.listen(PoseStamped, "localizer/pose", self.poses.append)
        self.listen(DiagnosticArray, "localizer/status", lambda m: self.statuses.append(parsed(m)))

    def listen(self, message_type, topic, receive):
        self.create_subscription(message_type, topic, receive, 100)

    def listen_to_health(self):
        """Store the reports on /diagnostics."""
        self.listen(DiagnosticArray, "/diagnostics", lambda m: self.health.append(parsed(m)))

    def add_sensor(self, message_type, topic):
        self._senders[topic] = self.create_publisher(message_type, topic, 10)

    def meet(self, localizer):
        """Wait until all endpoints of both are connected."""
        self._graph.introduce(self, localizer)
        self._inputs = localizer._inputs

    def send(self, topic, message):
        """Publish a sensor's message, and wait until the localizer has it."""
        inputs = (*self._inputs.sensors, self._inputs.probability)
        (arrivals,) = [one.arrivals for one in inputs if one.topic == f"/{topic}"]
        before = arrivals.count
        self._senders[topic].publish(message)
        self.wait_for(lambda: arrivals.count > before, topic)

    def calibrate(self, info=None):
        """Send a calibration."""
        self.send("camera_info", info or camera_info())

    def publish(self, stamp, targets, selected=1, **values):
        """Send a frame of the tracker."""
        self.publish_message(status_message(stamp, targets, selected, **values))

    def publish_message(self, message):
        """Send a message in place of the tracker's status."""
        self._tracker.publish(message)

    def show(self, stamp, targets, selected=1, **values):
        """Send a frame of the tracker, and return the localizer's status for it."""
        before = len(self.statuses)
        self.publish(stamp, targets, selected, **values)

        def found():
            return [one for one in self.statuses[before:] if one.stamp == stamp]

        return self.wait_for(found, f"status for {stamp}")[0]

    def show_all(self, given, count, where, start=0, **options):
        """Show a target 1 at `where(index)`, forward and left in meters; returns the statuses."""
        statuses = []
        for index in range(start, start + count):
            target = given.target(box=given.box_at(*where(index)))
            statuses.append(self.show(START + index * FRAME, [target], **options))
        return statuses


@pytest.fixture
def make_localizer(graph):
    """A function that starts a localizer in a thread, with parameters by name."""

    def make(**parameters):
        node = LocalizerNode(context=graph.context(), parameter_overrides=overrides(parameters))
        graph.run(node)
        return node

    return make


@pytest.fixture
def scene(graph):
    """A scene."""
    scene = Scene(graph)
    yield scene
    scene.close()


@pytest.fixture
def start(scene, make_localizer):
    """A function that starts a localizer with sensors (type, topic), without predictions."""

    def start_one(*sensors, calibrated=True, **parameters):
        for message_type, topic in sensors:
            scene.add_sensor(message_type, topic)
        localizer = make_localizer(**{"camera__height": 1.5, "coast": 0.0, **parameters})
        scene.meet(localizer)
        if calibrated:
            scene.calibrate()
        return localizer

    return start_one
