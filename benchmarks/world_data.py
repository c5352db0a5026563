"""Recordings with known positions in meters, for the benchmark of positions.

- KITTI tracking labels as tables: a first line `# fx ... fy ... cx ... cy ... offset_x ...`, then
  the columns frame, id, class, truncated, occluded, x, y, width, height (pixels), height_m and so
  on, X, Y, Z (meters, of the lower center, z forward).
- PETS 2009, S2.L1: MOT's `gt.txt` with x and y on the ground in columns 8 and 9 and `det.txt`, and
  the published Tsai calibration of the view (`View_001.xml`).
- Frames of a depth camera: NAME.jpg, NAME_depth.png (millimeters) and NAME_mask.jpg.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.world import CameraModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LabeledBoxes:
    """Boxes with their targets' positions before one camera.

    Attributes:
        name: Of the sequence.
        camera: Of all boxes.
        boxes: (N, 4), pixels.
        positions: (N, 3) lower centers in camera coordinates, meters.
        is_whole: (N,) whether all of the target is visible and inside the image.
        at_border: (N,) whether the box reaches the border of the image.
    """

    name: str
    camera: CameraModel
    boxes: Array
    positions: Array
    is_whole: NDArray[np.bool_]
    at_border: NDArray[np.bool_]


def read_kitti(path: Path) -> LabeledBoxes:
    """The labels of one sequence. The image ends where the farthest box does.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no such table.
    """
    first, *lines = path.read_text(encoding="utf-8").splitlines()
    words = first.lstrip("# ").split()
    numbers = dict(zip(words[::2], map(float, words[1::2]), strict=True))
    rows = list(csv.DictReader(lines))
    try:
        boxes = _columns(rows, "x", "y", "width", "height")
        positions = _columns(rows, "X", "Y", "Z")
        hidden = _columns(rows, "truncated", "occluded")
        fx, fy, cx, cy, offset = (numbers[name] for name in ("fx", "fy", "cx", "cy", "offset_x"))
    except KeyError as error:
        raise ValueError(f"{path} has no column or number {error}") from error
    positions[:, 0] += offset
    ends = boxes[:, :2] + boxes[:, 2:]
    # Boxes end at the last pixel of the image, counted from 0.
    width, height = (int(end) for end in np.maximum(np.rint(ends.max(axis=0)) + 1.0, (1224, 370)))
    at_border = (boxes[:, :2] < 2.0).any(axis=1) | (ends > (width - 2.0, height - 2.0)).any(axis=1)
    is_whole = ~at_border & (hidden == 0.0).all(axis=1)
    camera = CameraModel(fx, fy, cx, cy, width, height)
    return LabeledBoxes(path.stem, camera, boxes, positions, is_whole, at_border)


def _columns(rows: list[dict[str, str]], *names: str) -> Array:
    return np.array([[float(row[name]) for name in names] for row in rows])


@dataclass(frozen=True, eq=False)
class FixedCamera:
    """A camera at rest.

    Attributes:
        model: Its calibration.
        rotation: (3, 3) from its optical frame to the world's.
        translation: (3,) its position in the world, meters.
    """

    model: CameraModel
    rotation: Array
    translation: Array


def read_tsai(path: Path) -> FixedCamera:
    """The camera of a Tsai calibration in PETS's XML format (millimeters, radians).

    Tsai's model has the undistorted coordinates as a function of the distorted ones; plumb_bob has
    the opposite, and is fitted to it over the image.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no such file.
    """
    try:
        root = ElementTree.parse(path).getroot()
        found = {name: root.find(f".//{name}") for name in ("Geometry", "Intrinsic", "Extrinsic")}
        values = {
            f"{name}.{key}": float(value)
            for name, element in found.items()
            if element is not None
            for key, value in element.attrib.items()
        }
        width, height = (int(values[f"Geometry.{key}"]) for key in ("width", "height"))
        pixel = np.array([values["Geometry.dpx"], values["Geometry.dpy"]])
        focal, kappa, scale = (values[f"Intrinsic.{key}"] for key in ("focal", "kappa1", "sx"))
        center = np.array([values["Intrinsic.cx"], values["Intrinsic.cy"]])
        angles = [values[f"Extrinsic.{key}"] for key in ("rx", "ry", "rz")]
        shift = np.array([values[f"Extrinsic.{key}"] for key in ("tx", "ty", "tz")]) / 1000.0
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise ValueError(f"{path} is no Tsai calibration in XML: {error}") from error
    columns, rows = np.meshgrid(np.linspace(0, width - 1, 40), np.linspace(0, height - 1, 30))
    offsets = np.column_stack([columns.ravel(), rows.ravel()]) - center
    distorted = offsets * pixel / (scale, 1.0)
    factors = 1.0 + kappa * np.square(distorted).sum(axis=1)
    radius = np.linalg.norm(distorted / focal, axis=1) * factors
    powers = radius[:, None] ** [2, 4, 6]
    weights = radius[:, None]
    k1, k2, k3 = np.linalg.lstsq(powers * weights, (1.0 / factors - 1.0) * radius, rcond=None)[0]
    model = CameraModel(
        focal * scale / pixel[0],
        focal / pixel[1],
        center[0],
        center[1],
        width,
        height,
        (k1, k2, 0.0, 0.0, k3),
    )
    about_x, about_y, about_z = (
        cv2.Rodrigues(angle * axis)[0] for angle, axis in zip(angles, np.eye(3), strict=True)
    )
    to_camera = about_z @ about_y @ about_x
    return FixedCamera(model, to_camera.T, -to_camera.T @ shift)


@dataclass(frozen=True, eq=False)
class GroundTracks:
    """Boxes of a detector with the positions and identities of the people in them.

    Attributes:
        frames: (N,) from 1.
        ids: (N,) of the people.
        boxes: (N, 4) of the detector, pixels counted from 0.
        positions: (N, 2) on the ground, meters.
        velocities: (N, 2) by central differences over six frames, m/s; NaN where unknown.
    """

    frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    boxes: Array
    positions: Array
    velocities: Array


def read_ground_tracks(folder: Path, rate: float) -> GroundTracks:
    """Detections that overlap a person by more than half.

    Args:
        folder: With `gt.txt` and `det.txt`.
        rate: Frames per second.

    Raises:
        OSError: A file cannot be read.
    """
    truth = np.loadtxt(folder / "gt.txt", delimiter=",")
    detections = np.loadtxt(folder / "det.txt", delimiter=",")
    velocities = np.full((len(truth), 2), np.nan)
    places = {(int(row[0]), int(row[1])): row[7:9] for row in truth}
    for index, row in enumerate(truth):
        before, after = ((int(row[0]) + step, int(row[1])) for step in (-3, 3))
        if before in places and after in places:
            velocities[index] = (places[after] - places[before]) * rate / 6.0
    pairs = []
    for frame in np.unique(truth[:, 0]):
        mine, theirs = (np.flatnonzero(one[:, 0] == frame) for one in (truth, detections))
        overlap = pairwise_iou(truth[mine, 2:6], detections[theirs, 2:6])
        for one, other in zip(*linear_sum_assignment(-overlap), strict=True):
            if overlap[one, other] > 0.5:
                pairs.append((mine[one], theirs[other]))
    matched = truth[[one for one, _ in pairs]]
    boxes = detections[[other for _, other in pairs], 2:6] - (1.0, 1.0, 0.0, 0.0)
    return GroundTracks(
        matched[:, 0].astype(np.int64),
        matched[:, 1].astype(np.int64),
        boxes,
        matched[:, 7:9],
        velocities[[one for one, _ in pairs]],
    )


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A frame of a depth camera with the pixels of one target.

    Attributes:
        image: (H, W, 3) uint8 BGR.
        depth: (H, W) uint16, millimeters.
        mask: (H, W) whether a pixel is the target's.
    """

    image: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    mask: NDArray[np.bool_]


def read_depth_frames(folder: Path) -> Iterator[DepthFrame]:
    """The frames of a folder in the order of their names."""
    for path in sorted(folder.glob("*_depth.png")):
        stem = path.name.removesuffix("_depth.png")
        image = cv2.imread(str(folder / f"{stem}.jpg"))
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(folder / f"{stem}_mask.jpg"), cv2.IMREAD_GRAYSCALE)
        if image is None or depth is None or mask is None:
            raise ValueError(f"{path} or its image or mask is no image")
        yield DepthFrame(image, depth, mask > 127)
