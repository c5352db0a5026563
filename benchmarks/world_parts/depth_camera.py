"""Range and occlusion from the frames of a depth camera, with holes and a passing occluder.

A frame is NAME.jpg, NAME_depth.png (millimeters) and NAME_mask.jpg.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, Localizer
from world_parts.errors import auroc

# Boxes are larger than the target by this share at each side; share of the depth without a value.
LOOSE, HOLES = 0.15, 0.3
# Distance of a passing occluder, of that of the target; its width, of the target's; frames to pass.
OCCLUDER_NEAR, OCCLUDER_WIDTH, OCCLUDER_FRAMES = 0.55, 0.3, 25


# Standard deviation of the depth at 1 m, meters, and side of a hole, pixels. Source: Khoshelham and
# Elberink 2012, "Accuracy and Resolution of Kinect Depth Data".
_DEPTH_NOISE, _HOLE = 0.0015, 8


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A frame of a depth camera with the pixels of one target."""

    image: NDArray[np.uint8]  # (H, W, 3) uint8 BGR
    depth: NDArray[np.uint16]  # (H, W) uint16, millimeters
    mask: NDArray[np.bool_]  # (H, W) whether a pixel is the target's


def read_depth_frames(folder: Path) -> Iterator[DepthFrame]:
    """The frames of a folder in the order of their names."""
    for path in sorted(folder.glob("*_depth.png")):
        stem = path.name.removesuffix("_depth.png")
        image = cv2.imread(str(folder / f"{stem}.jpg"))
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(folder / f"{stem}_mask.jpg"), cv2.IMREAD_GRAYSCALE)
        if image is None or depth is None or mask is None:
            raise FootageError(f"{path} or its image or mask is no image")
        yield DepthFrame(image, depth, mask > 127)


def depth_table(folder: Path, on_progress: OnProgress) -> Table:
    """Frames of a depth camera with loose boxes, holes and a passing occluder."""
    generator = np.random.default_rng(0)
    localizer = Localizer(CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480))
    errors, evidence, hidden = [], [], []
    for index, original in enumerate(read_depth_frames(folder)):
        true = float(np.median(original.depth[original.mask & (original.depth > 0)])) * 1e-3
        x, y, width, height = cv2.boundingRect(original.mask.astype(np.uint8))
        frame, share = _occluded(original, index, OCCLUDER_NEAR * true)
        place = localizer.locate(
            (
                x - LOOSE * width,
                y - LOOSE * height,
                (1.0 + 2.0 * LOOSE) * width,
                (1.0 + 2.0 * LOOSE) * height,
            ),
            image=frame.image,
            depth=corrupted(frame.depth * 1e-3, HOLES, generator),
        )
        on_progress("depth", 1)
        if place is None:
            errors.append(np.inf)
            continue
        errors.append(abs(float(place.position[2]) / true - 1.0))
        if place.occlusion is not None:
            evidence.append(place.occlusion)
            hidden.append(share)
    row = [
        f"{100.0 * HOLES:.0f} % holes, occluder",
        f"{100.0 * float((np.array(errors) > 0.1).mean()):.1f}",
        f"{100.0 * float(np.median(errors)):.1f}",
        auroc(np.array(evidence), np.array(hidden) > 0.05),
    ]
    headings = ("", "off by over 10 %, %", "median error, %", "AUROC of the occlusion")
    return Table("Frames of a depth camera", headings, [row])


def _occluded(frame: DepthFrame, index: int, distance: float) -> tuple[DepthFrame, float]:
    """A frame with something that passes in front, and the share of the target that it hides."""
    x, _, width, _ = cv2.boundingRect(frame.mask.astype(np.uint8))
    image, depth = frame.image.copy(), frame.depth.copy()
    phase = index % OCCLUDER_FRAMES / OCCLUDER_FRAMES
    middle = x + (1.6 * phase - 0.3) * width
    left = max(int(middle - OCCLUDER_WIDTH * width / 2), 0)
    right = max(int(middle + OCCLUDER_WIDTH * width / 2), left)
    depth[:, left:right] = round(1000.0 * distance)
    image[:, left:right] = (30, 90, 160)
    hidden = float(frame.mask[:, left:right].sum() / frame.mask.sum())
    return DepthFrame(image, depth, frame.mask), hidden


def corrupted(
    depth: NDArray[np.float64], holes: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """A depth image with noise, and with a share of holes."""
    noisy = depth + generator.normal(0.0, 1.0, depth.shape) * _DEPTH_NOISE * depth**2
    rows, columns = (side // _HOLE + 1 for side in depth.shape)
    coarse = (generator.random((rows, columns)) < holes).astype(np.uint8)
    large = cv2.resize(coarse, (columns * _HOLE, rows * _HOLE), interpolation=cv2.INTER_NEAREST)
    noisy[large[: depth.shape[0], : depth.shape[1]] > 0] = np.nan
    return noisy.astype(np.float32)
