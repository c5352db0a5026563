"""Folders of images in natural order: `2.png` comes before `10.png`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.access import check_file, entries, exists
from pf_tracker_ros.footage.base import (
    DEFAULT_FRAME_RATE,
    FootageError,
    describe_image,
    frame_stamp,
)
from pf_tracker_ros.frames import Frame

IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp")

# Depth and color stay as stored. A rotation by the EXIF orientation would not fit ground truth,
# which counts pixels as stored.
_READ_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION


def natural_order(name: str) -> tuple[tuple[str | int, ...], str]:
    """Sorting key that compares digits as numbers, then case and leading zeros."""
    # re.split with a group alternates text and digits, so equal positions hold equal types.
    parts = re.split(r"([0-9]+)", name.casefold())
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts)), name


def image_paths(folder: Path) -> list[Path]:
    """The images of a folder in natural order, without hidden files.

    Raises:
        FootageError: The folder cannot be listed, or an image is not a readable regular file.
    """
    found = [
        entry
        for entry in entries(folder)
        if entry.suffix.lower() in IMAGE_SUFFIXES
        and not entry.name.startswith(".")
        and not (exists(entry) and entry.is_dir())
    ]
    for path in found:
        check_file(path, "image")
    return sorted(found, key=lambda entry: natural_order(entry.name))


def read_image(path: Path) -> NDArray[Any]:
    """Read an image file as stored.

    Returns:
        (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.

    Raises:
        FootageError: The file cannot be decoded, or has another depth.
    """
    check_file(path, "image")
    # OpenCV opens only file names in UTF-8.
    octets = np.fromfile(path, dtype=np.uint8)
    reason = ""
    try:
        image = cv2.imdecode(octets, _READ_FLAGS) if octets.size else None
    except cv2.error as error:
        # Too many pixels for OpenCV or the memory.
        image, reason = None, f" ({' '.join(error.err.split())})"
    if image is None:
        raise FootageError(
            f"image {path} cannot be decoded{reason}; accepted are {', '.join(IMAGE_SUFFIXES)}"
        )
    eight_bit = image.dtype == np.uint8 and (image.ndim == 2 or image.shape[2] == 3)
    sixteen_bit_gray = image.dtype == np.uint16 and image.ndim == 2
    if not eight_bit and not sixteen_bit_gray:
        raise FootageError(
            f"image {path} is {describe_image(image)}; accepted are 8-bit color, 8-bit gray and "
            "16-bit gray"
        )
    return image


class ImageFolderFootage:
    """The images of a folder, in natural order of their names.

    The constructor reads the first image, to report errors early.

    Args:
        folder: The folder.
        frame_rate: Frames per second.

    Raises:
        FootageError: There are no images, or the first one cannot be read.
    """

    ground_truth = None

    def __init__(self, folder: Path, *, frame_rate: float = DEFAULT_FRAME_RATE) -> None:
        self._paths: Sequence[Path] = image_paths(folder)
        if not self._paths:
            raise FootageError(
                f"folder {folder} has no images; accepted are {', '.join(IMAGE_SUFFIXES)}"
            )
        read_image(self._paths[0])
        self.name = folder.resolve().name
        self.frame_count: int | None = len(self._paths)
        self.nominal_interval = 1.0 / frame_rate

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        for index, path in enumerate(self._paths):
            yield Frame(read_image(path), frame_stamp(index, self.nominal_interval))
