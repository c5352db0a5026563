"""Footage of several drawn targets, with exact detections."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from common import overlap, texture

from pf_tracker_ros import Detections, MultiTracker

WIDTH, HEIGHT = 320, 200
SIZE = np.array([24.0, 40.0])
INTERVAL = 0.1


@dataclass(frozen=True)
class Drawn:
    """Frames with the true boxes of their targets.

    Attributes:
        images: (H, W, 3) uint8 BGR each.
        boxes: (frames, targets, 4), NaN for targets outside of the image.
    """

    images: list
    boxes: np.ndarray

    def detections(self, frame, targets=None, age=0.0, labels=None):
        """Exact detections of all targets in a frame, or of some."""
        boxes = self.boxes[frame] if targets is None else self.boxes[frame][list(targets)]
        boxes = boxes[np.isfinite(boxes).all(axis=1)]
        return Detections(boxes, np.full(len(boxes), 0.95), labels, age)


def draw_paths(paths, colors=None, textures=(10, 11, 12)):
    """Sprites of 24 x 40 px with their centers on paths, a later one in front.

    A path is (x, y), each an array or one number; NaN where the sprite is not there.
    """
    ground = texture(1, HEIGHT, WIDTH, 100, 150)
    sprites = [
        cv2.addWeighted(
            texture(textures[number], int(SIZE[1]), int(SIZE[0]), 0, 250),
            0.5,
            np.full((int(SIZE[1]), int(SIZE[0]), 3), color, np.uint8),
            0.5,
            0.0,
        )
        for number, color in enumerate(colors or [(20, 20, 230), (230, 40, 20), (20, 220, 30)])
    ]
    paths = np.array([np.stack(np.broadcast_arrays(x, y), 1) for x, y in paths], float)
    images = []
    boxes = np.full((paths.shape[1], len(paths), 4), np.nan)
    for frame in range(paths.shape[1]):
        image = ground.copy()
        for number, sprite in zip(range(len(paths)), sprites, strict=False):
            center = paths[number, frame]
            if not np.isfinite(center).all():
                continue
            x, y = np.rint(center - SIZE / 2).astype(int)
            left, top = max(x, 0), max(y, 0)
            right, bottom = min(x + int(SIZE[0]), WIDTH), min(y + int(SIZE[1]), HEIGHT)
            if right > left and bottom > top:
                image[top:bottom, left:right] = sprite[top - y : bottom - y, left - x : right - x]
                boxes[frame, number] = (x, y, *SIZE)
        images.append(image)
    return Drawn(images, boxes)


@pytest.fixture(scope="session")
def draw():
    return draw_paths


@pytest.fixture(scope="session")
def walkers():
    """Three distant targets that walk for 30 frames."""
    steps = np.arange(30)
    return draw_paths([(40 + 3 * steps, 50), (280 - 3 * steps, 100), (60 + 2 * steps, 160)])


@pytest.fixture(scope="session")
def crossing():
    """Two targets that cross; the second occludes the first for some frames."""
    steps = np.arange(40)
    return draw_paths([(60 + 4 * steps, 90), (240 - 4 * steps, 100)])


@pytest.fixture(scope="session")
def passage():
    """A target that passes behind a standing one."""
    return draw_paths([(60 + 4 * np.arange(36), 90), (np.full(36, 140), 96)])


@pytest.fixture(scope="session")
def turned_passage(passage):
    """The same, cropped by a camera that turns during the occlusion."""
    offsets = np.clip(8 * (np.arange(36) - 15), 0, 96)
    boxes = passage.boxes.copy()
    boxes[..., 0] -= offsets[:, None]
    seen = zip(passage.images, offsets, strict=True)
    return Drawn([image[:, left : left + 224].copy() for image, left in seen], boxes)


@pytest.fixture(scope="session")
def lookalikes():
    """A target that passes behind its twin, by what that does: it stands, or approaches."""
    steps = np.arange(40)

    def drawn(start, speed, of_other):
        paths = [(start + speed * steps, 90), (150 - of_other * (steps - 20), 94)]
        return draw_paths(paths, colors=[(20, 20, 230)] * 2, textures=(10, 10))

    return {"stands": drawn(80, 4, 0), "approaches": drawn(110, 2, 2)}


@pytest.fixture(scope="session")
def pair():
    """A target that stops behind another one."""
    gap = np.maximum(40 - 5 * np.arange(24), 6)
    return draw_paths([(160 - gap, 90), (np.full(24, 160), 94)])


@pytest.fixture(scope="session")
def leaving_pair():
    """A target that leaves the image, and another one that overtakes it in front."""
    steps = np.arange(50)
    x = 200 + 4 * steps
    paths = [(x, 90), (x + np.minimum(4 * steps, 32) - 40, 92)]
    return draw_paths(paths, colors=[(20, 20, 230), (220, 60, 20)])


@pytest.fixture(scope="session")
def vanisher():
    """A standing target that vanishes; another one walks past its place much later."""
    steps = np.arange(70)
    return draw_paths([(np.where(steps < 8, 160, np.nan), 104), (300 - 4 * steps, 98)])


@pytest.fixture(scope="session")
def leaver():
    """A target that leaves on the right and returns there, and one that stays."""
    steps = np.arange(50)
    x = np.where(steps < 30, 240 + 6 * steps, 240 + 6 * (54 - steps))
    return draw_paths([(np.where(x > WIDTH + 4, np.nan, x), 90), (np.full(50, 60), 120)])


@pytest.fixture(scope="session")
def approacher():
    """A target in the colors of the background that grows by 1.3 % per frame."""
    ground = texture(1, HEIGHT, WIDTH, 100, 150)
    sprite = texture(10, int(SIZE[1]), int(SIZE[0]), 100, 150)
    images, boxes = [], []
    for step in range(41):
        width, height = np.rint(SIZE * 1.013**step).astype(int)
        x, y = 160 - width // 2, 100 - height // 2
        image = ground.copy()
        image[y : y + height, x : x + width] = cv2.resize(sprite, (int(width), int(height)))
        images.append(image)
        boxes.append([(x, y, width, height)])
    return Drawn(images, np.array(boxes, dtype=float))


@pytest.fixture(scope="session")
def returner():
    """A target that is absent for 3 s, then stands elsewhere."""
    steps = np.arange(120)
    x = np.select([steps < 10, steps < 40], [60, np.nan], 250)
    return draw_paths([(x, np.where(steps < 40, 90, 120))])


@pytest.fixture(scope="session")
def jumper():
    """A standing target that jumps between two frames."""
    return draw_paths([(np.where(np.arange(60) < 12, 80, 150), 90)])


@pytest.fixture(scope="session")
def twins():
    """Two distant targets that look alike."""
    paths = [(np.full(70, x), 90) for x in (60, 250)]
    return draw_paths(paths, colors=[(20, 20, 230)] * 2, textures=(10, 10))


@pytest.fixture
def make_tracker():
    def make(seed=0, **parameters):
        named = {name.replace("__", "."): value for name, value in parameters.items()}
        return MultiTracker.from_preset("default", seed, named)

    return make


@pytest.fixture(scope="session")
def start_earlier():
    """Starts a target on an earlier frame, by its age in seconds."""

    def start(tracker, box, age=0.0, label=""):
        stamp = tracker._stamp - round(age * 1e9)
        return tracker._manager.start(tuple(box), stamp, label).id

    return start


@pytest.fixture(scope="session")
def run():
    """Targets after each of some frames, every few of them with detections of all or some."""

    def run(tracker, drawn, numbers=None, *, every=0, targets=None, labels=None):
        outputs = []
        for number in range(len(drawn.images)) if numbers is None else numbers:
            is_detected = every and number % every == 0
            detections = drawn.detections(number, targets, labels=labels) if is_detected else None
            outputs.append(tracker.update(drawn.images[number], INTERVAL, detections))
        return outputs

    return run


@pytest.fixture(scope="session")
def iou():
    return overlap


@pytest.fixture(scope="session")
def as_told():
    """All output values of targets, to compare their bits."""

    def values(targets):
        return [
            (one.id, one.label, one.age, one.unconfirmed_for)
            + (one.estimate.box, one.estimate.state, one.estimate.weights.tobytes())
            for one in targets
        ]

    return values
