"""What several folders of tests need: drawn images, regions, overlaps, results of commands."""

import csv
import resource
import subprocess
import sys
from contextlib import contextmanager

import cv2
import numpy as np

from pf_tracker_ros import Estimate
from pf_tracker_ros.boxes import bounding_box
from pf_tracker_ros.frames import Frame, Region

# Arguments of a command, where the tracker does not matter.
QUICK = ("--preset", "li2007", "--parameter", "particles=20")
# The program `track` where no ROS can be imported.
TRACK_WITHOUT_ROS = """
import sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rclpy", "sensor_msgs", "std_msgs", "geometry_msgs"}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, NoRos())
from pf_tracker_ros.recordings.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def run_command(main, arguments, capsys):
    """Runs a command in this process; its exit code, output and errors."""
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as ended:
        code = ended.code
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def run_python(code, *arguments, check=False, **options):
    """Runs code in a process of its own, to its end."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    options = {"capture_output": True, "text": True, "timeout": 120, **options}
    return subprocess.run(command, check=check, **options)


def read_boxes(folder):
    """The rows of `boxes.csv`."""
    with (folder / "boxes.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def texture(seed, height, width, low=0, high=256, *, cell=6):
    """(height, width, 3) uint8: cells of random values, smoothed."""
    shape = (height // cell + 1, width // cell + 1, 3)
    noise = np.random.default_rng(seed).integers(low, high, shape)
    return cv2.resize(noise.astype(np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


def grain(seed, height, width, low=0, high=255, *, scale=2.5, channels=3):
    """(height, width, channels) float64: Gaussian noise smoothed over some pixels."""
    noise = np.random.default_rng(seed).normal(size=(height, width, channels))
    smooth = cv2.GaussianBlur(noise, (0, 0), scale).reshape(noise.shape)
    return cv2.normalize(smooth, None, low, high, cv2.NORM_MINMAX).reshape(noise.shape)


def two_walkers(height, width, rows, right, count=16):
    """Images and (count, 2) boxes of two colored walkers on a ground, who approach each other."""
    rng = np.random.default_rng(4)
    ground = rng.integers(90, 150, (height, width, 3)).astype(np.uint8)
    sprites = [rng.integers(0, 120, (40, 24, 3)).astype(np.uint8) for _ in range(2)]
    sprites[0][..., 2] = 240
    sprites[1][..., 0] = 240
    images, boxes = [], []
    for frame in range(count):
        image = ground.copy()
        corners = [(30 + 3 * frame, rows[0]), (right - 3 * frame, rows[1])]
        for (x, y), sprite in zip(corners, sprites, strict=True):
            image[y : y + 40, x : x + 24] = sprite
        images.append(image)
        boxes.append([(float(x), float(y), 24.0, 40.0) for x, y in corners])
    return images, boxes


def make_estimate(box=(1.0, 2.0, 3.0, 4.0), state="tracking", confidence=0.5, **fields):
    """An estimate with a particle for each weight, by default one, and with other fields."""
    weights = fields.get("weights", np.ones(1))
    usual = {
        "box_covariance": np.eye(4),
        "particles": np.zeros((len(weights), 4)),
        "particle_boxes": np.tile(box, (len(weights), 1)),
        "weights": weights,
        "effective_sample_size": 1.0,
        "cue_weights": {},
    }
    return Estimate(box=box, state=state, confidence=confidence, **(usual | fields))


def region_of(image, boxes):
    """The region of an image that covers some boxes."""
    return Region(Frame(image), np.atleast_2d(boxes))


def overlap(one, other):
    """Intersection over union of two boxes."""
    one, other = np.asarray(one, float), np.asarray(other, float)
    sides = np.minimum(one[:2] + one[2:], other[:2] + other[2:]) - np.maximum(one[:2], other[:2])
    shared = np.maximum(sides, 0.0).prod()
    return shared / (one[2:].prod() + other[2:].prod() - shared)


def one_sentence(errors):
    """The only line of what `track` printed on standard error."""
    (line,) = errors.splitlines()
    assert line.startswith("track: error: ")
    return line


@contextmanager
def full_disk(size):
    """Files that this process writes within the block have at most so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def box_of(message):
    """The bounding box of a PolygonStamped."""
    return bounding_box([(point.x, point.y) for point in message.polygon.points])


def block_means(image, reduction):
    """The image reduced by a whole factor, the last row and column repeated to fill a block.

    Blocks larger than 8 x 8 are sampled by 4 x 4 pixels, spread evenly.
    """
    missing = [(0, -length % reduction) for length in image.shape[:2]]
    padded = np.pad(image, missing + [(0, 0)] * (image.ndim - 2), mode="edge").astype(float)
    if reduction > 8:
        starts = ((np.arange(4) + 0.5) * reduction / 4).astype(int)
        for axis in (0, 1):
            blocks = np.arange(0, padded.shape[axis], reduction)
            padded = padded.take(np.add.outer(blocks, starts).ravel(), axis=axis)
        reduction = 4
    height, width = padded.shape[:2]
    blocks = padded.reshape(
        height // reduction, reduction, width // reduction, reduction, *image.shape[2:]
    )
    return blocks.mean(axis=(1, 3))
