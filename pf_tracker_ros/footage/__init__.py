"""Recorded images as stamped frames: videos, folders of images, sequence folders and bags."""

from pf_tracker_ros.footage.bag_writing import BagWriter, write_footage
from pf_tracker_ros.footage.bags import BagImage, ImageBag, is_bag, open_bag
from pf_tracker_ros.footage.base import Footage, FootageError, PartialFootageError
from pf_tracker_ros.footage.opening import existing_path, open_footage
from pf_tracker_ros.footage.sequences import read_sequence
from pf_tracker_ros.frames import Frame

__all__ = [
    "BagImage",
    "BagWriter",
    "Footage",
    "FootageError",
    "Frame",
    "ImageBag",
    "PartialFootageError",
    "existing_path",
    "is_bag",
    "open_bag",
    "open_footage",
    "read_sequence",
    "write_footage",
]
