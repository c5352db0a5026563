"""Fixtures for all tests: real and drawn sequences, bags, a ROS domain of one's own."""

import errno
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import pf_tracker_ros
from pf_tracker_ros.footage import video_decoding
from pf_tracker_ros.ros_domains import unused_domain

pytest_plugins = ["pf_tracker_ros.testing"]

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGES = Path(pf_tracker_ros.__file__).parents[1]
# What is slow and rarely breaks: `make test` leaves these folders and files, and all that runs in a
# browser, to `make test-all`. `.ci/run` names the parts that they test.
SLOW = (
    "benchmarks",
    "decoding/test_hostile_compressed_images.py",
    "demo",
    "evaluation/test_accuracy.py",
    "evaluation/test_interruption.py",
    "extending/test_own_package.py",
    "node/console/test_recording.py",
    "node/console/test_tuning_page.py",
    "packaging/ros2",
    "packaging/test_installations.py",
    "packaging/test_site.py",
    "recordings/test_archive.py",
    "recordings/test_archive_commands.py",
    "recordings/test_ray.py",
    "recordings/test_several_archives.py",
    "recordings/test_stores.py",
    "test_tunables.py",
    "tracking/test_gray_recovery.py",
    "tools/test_make_vision_msgs.py",
    "tracking/test_honesty.py",
    "tuning",
)
# A long run of the properties is made by hand, with as many random cases each as this says; else
# they are the same ones in each run. How long a case takes is the machine's matter.
CASES = int(os.environ.get("PF_TRACKER_CASES", "0"))
_CASES = {"max_examples": CASES} if CASES else {"derandomize": True}
settings.register_profile(
    "properties", deadline=None, suppress_health_check=[HealthCheck.too_slow], **_CASES
)
settings.load_profile("properties")
# What a shell starts in the background ignores Ctrl-C, and so would what the tests interrupt.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Each of the many processes that the tests start would compile the package anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_collection_modifyitems(items):
    """Mark what is slow."""
    slow = [REPOSITORY / "test" / path for path in SLOW]
    for item in items:
        runs_browser = not {"browser", "browse"}.isdisjoint(item.fixturenames)
        if runs_browser or any(item.path.is_relative_to(path) for path in slow):
            item.add_marker("slow")


BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PAGE_DEADLINE = 60_000.0

# OpenCV waits for a camera that sends of itself, so no server is needed.
RTSP_LISTEN = "rtsp_flags;listen|rtsp_transport;tcp|listen_timeout;30"
RTSP_SEND = """
import sys, time, av
from fractions import Fraction
import numpy as np
deadline = time.monotonic() + 30
while True:
    try:
        stream = av.open(sys.argv[1], "w", format="rtsp", options={"rtsp_transport": "tcp"})
        video = stream.add_stream("mpeg4", 25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        stream.start_encoding()
        break
    except OSError:
        if time.monotonic() > deadline:
            raise
        time.sleep(0.05)
noise = np.random.default_rng(0).integers(0, 255, (12, 16, 3), np.uint8)
noise = noise.repeat(4, axis=0).repeat(4, axis=1)
for number in range(int(sys.argv[2])):
    frame = av.VideoFrame.from_ndarray(noise, format="bgr24")
    frame.pts, frame.time_base = number, Fraction(1, 25)
    stream.mux(video.encode(frame))
    time.sleep(0.04)
stream.close()
"""


@pytest.fixture
def make_unreadable(monkeypatch):
    """A function that makes a folder which may not be read, even by those who may read all."""
    exists = Path.exists
    folders = set()

    def refuse(self, *arguments):
        if self.parent in folders:
            raise PermissionError(errno.EACCES, "Permission denied")
        return exists(self, *arguments)

    def make(folder):
        folder.mkdir()
        folders.add(folder)

    monkeypatch.setattr(Path, "exists", refuse)
    return make


@pytest.fixture(scope="session")
def sequences_directory():
    """The folder of real sequences, which is not part of the repository; skips where absent."""
    given = os.environ.get("PF_TRACKER_SEQUENCES")
    directory = Path(given) if given else REPOSITORY.parent / "shared" / "sequences"
    if not directory.is_dir():
        pytest.skip(f"no real sequences in {directory}; PF_TRACKER_SEQUENCES names their folder")
    return directory.resolve()


@dataclass(frozen=True)
class DrawnSequence:
    """Frames drawn for a test, with the exact box in each.

    Attributes:
        images: (frames, H, W, 3) uint8 BGR.
        boxes: (frames, 4) x, y, width, height, whole pixels.
    """

    images: np.ndarray
    boxes: np.ndarray


@pytest.fixture(scope="session")
def moving_square():
    """A checkered red square of 24 px that goes down and right over a smooth green ground."""
    generator = np.random.default_rng(7)
    height, width, size, count = 120, 160, 24, 20
    ground = np.empty((height, width, 3), np.uint8)
    ground[:] = (60, 120, 40)
    coarse = generator.integers(0, 80, (height // 20, width // 20, 3), dtype=np.uint8)
    ground += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
    rows, columns = np.indices((size, size)) // 6
    square = np.where(((rows + columns) % 2 == 0)[..., None], (40, 40, 220), (30, 180, 240))
    images, boxes = [], []
    for index in range(count):
        x, y = 20 + 4 * index, 30 + 2 * index
        image = ground.copy()
        image[y : y + size, x : x + size] = square
        images.append(image)
        boxes.append((x, y, size, size))
    images, boxes = np.array(images), np.array(boxes, np.float64)
    for array in (images, boxes):
        array.flags.writeable = False
    return DrawnSequence(images, boxes)


@pytest.fixture(scope="session")
def write_sequence_in():
    """A function that writes images and boxes as a sequence folder in another; returns its path."""

    def write(parent, name, images, boxes):
        folder = parent / name
        (folder / "img").mkdir(parents=True)
        for number, image in enumerate(images, start=1):
            # PNG keeps every pixel: results do not hang on a JPEG library.
            assert cv2.imwrite(str(folder / "img" / f"{number:04d}.png"), image)
        lines = [",".join(f"{value:g}" for value in box) + "\n" for box in boxes]
        (folder / "groundtruth.txt").write_text("".join(lines))
        height, width = images[0].shape[:2]
        meta = {"name": name, "width": width, "height": height, "frames": len(images)}
        (folder / "meta.json").write_text(json.dumps(meta))
        return folder

    return write


@pytest.fixture
def write_sequence(write_sequence_in, tmp_path):
    """A function that writes images and boxes as a sequence folder and returns its path."""

    def write(name, images, boxes, parent=tmp_path):
        return write_sequence_in(parent, name, images, boxes)

    return write


@pytest.fixture
def moving_square_sequence(write_sequence, moving_square):
    """The moving square as a sequence folder."""
    return write_sequence("moving_square", moving_square.images, moving_square.boxes)


@pytest.fixture(scope="session")
def other_values():
    """A function that gives other values of a declared parameter that are allowed by themselves."""

    def others(declaration, value):
        if declaration.type == tuple[str, ...]:
            choices = declaration.choices or ("anything",)
            found = [(*value, choice) for choice in choices if choice not in value]
        elif declaration.choices:
            found = declaration.choices
        elif declaration.type is bool:
            found = [not value]
        elif declaration.type is str:
            found = ["anything"]
        elif declaration.type in (int, float):
            step = (value - declaration.minimum, declaration.maximum - value)
            near = [value + min(1, step[1]) / 2, value - min(1, step[0]) / 2]
            found = [*near, declaration.minimum, declaration.maximum]
            found = [declaration.type(number) for number in found]
        else:
            found = [tuple((number + declaration.maximum) / 2 for number in value)]
        return [other for other in found if other != value]

    return others


@pytest.fixture(scope="session")
def typestore():
    """The message types of rosbags, which a ROS from apt does not have: skips without it."""
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="session")
def make_stamped(typestore):
    """Serialize a message with a header, without the code under test."""
    types = typestore.types

    def make(message_type, stamp, *, little_endian=True, **fields):
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="lens")
        message = types[message_type](header=header, **fields)
        return bytes(typestore.serialize_cdr(message, message_type, little_endian=little_endian))

    return make


@pytest.fixture(scope="session")
def make_image_message(make_stamped):
    """Serialize a BGR image as a sensor_msgs/Image."""

    def make(stamp, image):
        height, width = image.shape[:2]
        return make_stamped(
            "sensor_msgs/msg/Image", stamp, height=height, width=width, encoding="bgr8",
            is_bigendian=0, step=3 * width, data=image.reshape(-1),
        )  # fmt: skip

    return make


@pytest.fixture
def start_module(tmp_path):
    """Starts a module of the package in the test's folder; it is killed after the test."""
    processes = []

    def start(module, *arguments, stdout=subprocess.PIPE, **environment):
        process = subprocess.Popen(
            [sys.executable, "-m", f"pf_tracker_ros.{module}", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(PACKAGES), **environment},
            stdout=stdout,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def walk(moving_square):
    """A function that gives the moving square there and back for a number of frames."""

    def make(count):
        order = np.resize(np.r_[np.arange(20), np.arange(18, 0, -1)], count)
        return moving_square.images[order], moving_square.boxes[order]

    return make


@pytest.fixture(scope="session")
def make_polygon(typestore):
    """A polygon with corners (x, y), a field for `make_stamped`."""
    types = typestore.types

    def make(*corners):
        points = [types["geometry_msgs/msg/Point32"](x=x, y=y, z=0.0) for x, y in corners]
        return types["geometry_msgs/msg/Polygon"](points=points)

    return make


@pytest.fixture(scope="session")
def write_bag(typestore):
    """Write (topic, type, log time, message) rows into a bag of the given kind; returns its path.

    A row without a message makes its topic known and no more.
    """

    def write(path, rows, storage="MCAP", compression="NONE", types=typestore):
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for topic, message_type, log_time, message in rows:
                if (topic, message_type) not in connections:
                    connections[topic, message_type] = writer.add_connection(
                        topic, message_type, typestore=types
                    )
                if message is not None:
                    writer.write(connections[topic, message_type], log_time, message)
        return path

    return write


@pytest.fixture(scope="session")
def write_video():
    """Write images as a video by OpenCV, lossless unless another codec is given; its path."""

    def write(path, images, rate=25.0, codec="FFV1"):
        height, width = images[0].shape[:2]
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, (width, height))
        assert writer.isOpened()
        for image in images:
            writer.write(image)
        writer.release()
        return path

    return write


@pytest.fixture(scope="session")
def write_clip():
    """Write images at times, multiples of 40 ms, as a video by PyAV; returns its path."""
    av = pytest.importorskip("av")

    def write(path, images, times, codec="mpeg4", *, codec_options=None, container_options=None):
        height, width = images[0].shape[:2]
        with av.open(str(path), "w", options=container_options or {}) as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height = width, height
            formats = {"ffv1": "bgr0", "mjpeg": "yuvj420p"}
            stream.pix_fmt = formats.get(codec, "yuv420p")
            stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
            stream.bit_rate = 4_000_000
            stream.options = codec_options or {}
            for image, time in zip(images, times, strict=True):
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
                frame.pts, frame.time_base = time // 40, Fraction(1, 25)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return path

    return write


@pytest.fixture(params=["PyAV", "OpenCV"])
def video_decoder(request, monkeypatch):
    """Decode videos by PyAV, or by OpenCV as without PyAV."""
    if request.param == "PyAV":
        pytest.importorskip("av")
    else:
        monkeypatch.setattr(video_decoding, "has_pyav", lambda: False)
    return request.param


@pytest.fixture(scope="session")
def domain_numbers():
    """Candidates for domains, without end: each test tries the number after the last one taken.

    Participants of a test that has just ended may still be heard for a moment; the next test must
    not listen where they were. Processes side by side begin far apart.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    first = 50 * worker % 100
    return itertools.cycle((*range(first + 1, 101), *range(1, first + 1)))


@pytest.fixture
def ros_domain(domain_numbers, monkeypatch, tmp_path):
    """A ROS domain in which nobody else on this machine is, kept on the loopback; its number.

    Valid for nodes in this process and in processes that the test starts.
    """
    pytest.importorskip("rclpy", reason="needs ROS 2")
    with unused_domain(itertools.islice(domain_numbers, 100)) as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        for name in ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"):
            monkeypatch.delenv(name, raising=False)
        yield domain


@pytest.fixture(scope="session")
def noise():
    """A function that makes images of textured noise."""

    def make(height=48, width=64, channels=3, seed=0, kind=np.uint8):
        shape = (height, width, channels) if channels > 1 else (height, width)
        return np.random.default_rng(seed).integers(
            0, np.iinfo(kind).max, shape, dtype=kind, endpoint=True
        )

    return make


def chromium_or_skip():
    """Path of a Chromium from the machine's packages; skips the test where there is none."""
    found = [path for name in BROWSERS if (path := shutil.which(name))]
    if not found:
        pytest.skip("no Chromium to show the page in; install one: apt install chromium")
    return found[0]


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium from the machine's packages; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra 'test'")
    path = chromium_or_skip()
    playwright.expect.set_options(timeout=PAGE_DEADLINE)
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=BROWSER_FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def browse(browser, tmp_path):
    """Opens a page of a width in Chromium; returns what a script in it reports."""

    def open_(page, script, width):
        shown = browser.new_page(viewport={"width": width, "height": 900})
        complaints = []
        shown.on("console", lambda message: complaints.append(message.text))
        # The page forbids itself all requests: what it tried all the same is told as well.
        shown.add_init_script(
            "window.errors = []; addEventListener('error', (event) => errors.push(event.message));"
            "addEventListener('securitypolicyviolation', (event) => errors.push(event.blockedURI))"
        )
        (tmp_path / "page.html").write_text(page)
        try:
            shown.goto((tmp_path / "page.html").as_uri())
            said = shown.evaluate(f"() => {{{script}}}")
        finally:
            shown.close()
        assert complaints == []
        return said

    return open_


@pytest.fixture
def public_folder():
    """An empty folder that every user may look into."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.fixture
def ordinary_user():
    """A block as a user who may not read and write everywhere, for tests that root runs."""

    @contextmanager
    def block():
        is_root = os.geteuid() == 0
        if is_root:
            os.seteuid(65534)
        try:
            yield
        finally:
            if is_root:
                os.seteuid(0)

    return block


@pytest.fixture
def start_alarm():
    """A function that lets the test fail unless it ends, or starts anew, within some seconds."""

    def give_up(number, frame):
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, give_up)
    yield signal.alarm
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def send_stream(monkeypatch):
    """A function that starts to send pictures; returns the address of the camera."""
    pytest.importorskip("av")
    monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", RTSP_LISTEN)
    processes = []

    def send(pictures):
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        address = f"rtsp://127.0.0.1:{port}/live"
        processes.append(
            subprocess.Popen([sys.executable, "-c", RTSP_SEND, address, str(pictures)])
        )
        return address.replace("//", "//user:secret@")

    yield send
    for process in processes:
        process.kill()
        process.wait()
