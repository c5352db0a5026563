"""Positions and velocities of people before the calibrated camera of PETS 2009, S2.L1.

The folder has MOT's `gt.txt`, with x and y on the ground in columns 8 and 9, and `det.txt`; the
published Tsai calibration of the view is `View_001.xml`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from tables import Table

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, GroundPlane, Localizer, PositionFilter, in_fixed_frame
from world_parts.errors import Array, Errors

RATE = 7.0
_TSAI = {"width", "height", "dpx", "dpy", "focal", "kappa1", "sx", "cx", "cy"}
_TSAI |= {"rx", "ry", "rz", "tx", "ty", "tz"}


@dataclass(frozen=True, eq=False)
class FixedCamera:
    """A camera at rest."""

    model: CameraModel  # its calibration
    rotation: Array  # (3, 3) from its optical frame to the world's
    translation: Array  # (3,) its position in the world, meters


def read_tsai(path: Path) -> FixedCamera:
    """The camera of a Tsai calibration in PETS's XML format (millimeters, radians).

    Tsai's model has the undistorted coordinates as a function of the distorted ones; plumb_bob has
    the opposite, and is fitted to it over the image.
    """
    root = ElementTree.parse(path).getroot()
    values = {
        f"{element.tag}.{key}": float(element.attrib[key])
        for element in root.iter()
        for key in element.attrib.keys() & _TSAI
    }
    width, height = (int(values[f"Geometry.{key}"]) for key in ("width", "height"))
    pixel = np.array([values["Geometry.dpx"], values["Geometry.dpy"]])
    focal, kappa, scale = (values[f"Intrinsic.{key}"] for key in ("focal", "kappa1", "sx"))
    center = np.array([values["Intrinsic.cx"], values["Intrinsic.cy"]])
    angles = [values[f"Extrinsic.{key}"] for key in ("rx", "ry", "rz")]
    shift = np.array([values[f"Extrinsic.{key}"] for key in ("tx", "ty", "tz")]) / 1000.0
    columns, rows = np.meshgrid(np.linspace(0, width - 1, 40), np.linspace(0, height - 1, 30))
    offsets = np.column_stack([columns.ravel(), rows.ravel()]) - center
    distorted = offsets * pixel / (scale, 1.0)
    factors = 1.0 + kappa * np.square(distorted).sum(axis=1)
    radius = np.linalg.norm(distorted / focal, axis=1) * factors
    powers = radius[:, None] ** [2, 4, 6]
    weights = radius[:, None]
    k1, k2, k3 = np.linalg.lstsq(powers * weights, (1.0 / factors - 1.0) * radius, rcond=None)[0]
    lengths = focal * scale / pixel[0], focal / pixel[1]
    model = CameraModel(*lengths, *center, width, height, (k1, k2, 0.0, 0.0, k3))
    about_x, about_y, about_z = (
        cv2.Rodrigues(angle * axis)[0] for angle, axis in zip(angles, np.eye(3), strict=True)
    )
    to_camera = about_z @ about_y @ about_x
    return FixedCamera(model, to_camera.T, -to_camera.T @ shift)


@dataclass(frozen=True, eq=False)
class GroundTracks:
    """Boxes of a detector with the positions and identities of the people in them."""

    frames: NDArray[np.int64]  # (N,) from 1
    ids: NDArray[np.int64]  # (N,) of the people
    boxes: Array  # (N, 4) of the detector, pixels counted from 0
    positions: Array  # (N, 2) on the ground, meters
    velocities: Array  # (N, 2) by central differences over six frames, m/s; NaN where unknown


def read_ground_tracks(folder: Path, rate: float) -> GroundTracks:
    """Detections that overlap a person by more than half; the rate is in frames per second."""
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


def pets_table(camera: FixedCamera, tracks: GroundTracks, on_progress: OnProgress) -> Table:
    """Positions on the ground, raw and filtered, and velocities."""
    plane = GroundPlane.from_pose(camera.rotation, camera.translation)
    localizer = Localizer(camera.model, plane.height, plane.pitch, plane.roll)
    measured = locate_all(camera, localizer, tracks.boxes)
    raw, filtered, velocities = [], [], []
    for identity in np.unique(tracks.ids):
        tracker, updates = PositionFilter(), 0
        for index in np.flatnonzero(tracks.ids == identity):
            measurement = measured[index]
            if measurement is None:
                continue
            stamp = round(tracks.frames[index] / RATE * 1e9)
            tracker.update(stamp, measurement[0], measurement[1:])
            updates += 1
            state = tracker.predict(stamp)
            if state is None:
                continue
            true = tracks.positions[index]
            raw.append((measurement[0] - true, measurement[1:]))
            filtered.append((state.position - true, state.covariance[:2, :2]))
            # After half a second.
            if updates > 3 and np.isfinite(tracks.velocities[index]).all():
                error = state.velocity - tracks.velocities[index]
                velocities.append((error, state.covariance[2:, 2:]))
        on_progress("PETS", 1)
    rows = [
        [name, *_errors_of(pairs).cells()]
        for name, pairs in (
            ("position, m", raw),
            ("filtered, m", filtered),
            ("velocity, m/s", velocities),
        )
    ]
    headings = ("PETS 2009, detector's boxes", "frames", "median", "90 %", "NEES", "inside")
    return Table("People before a calibrated camera", headings, rows)


def locate_all(camera: FixedCamera, localizer: Localizer, boxes: Array) -> list[Array | None]:
    """For each box (3, 2): position on the ground in the world, and its covariance."""
    found: list[Array | None] = []
    for box in boxes:
        place = localizer.locate(box)
        if place is None:
            found.append(None)
            continue
        fixed = in_fixed_frame(place, camera.rotation, camera.translation)
        found.append(np.vstack([fixed.mean[:2], fixed.covariance[:2, :2]]))
    return found


def _errors_of(pairs: Sequence[tuple[Array, Array]]) -> Errors:
    errors, covariances = zip(*pairs, strict=True)
    return Errors.of(np.array(errors), np.array(covariances))
