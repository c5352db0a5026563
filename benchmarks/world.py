r"""Accuracy of positions in meters: errors, and whether the covariances are true.

    python benchmarks/world.py --kitti FOLDER --pets FOLDER --calibration View_001.xml \
        --depth FOLDER --output world.md

Each folder adds a table; `world_data.py` says what it contains. Three parts need no data: rendered
depth images with exact positions, a robot that turns, and the CPU time of a position.

NEES: normalized estimation error squared over its degrees of freedom, 1 for a true covariance.
Inside: share of the frames whose truth is in the 90 % region.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, rankdata
from tables import Table
from world_data import (
    Array,
    FixedCamera,
    GroundTracks,
    LabeledBoxes,
    read_depth_frames,
    read_ground_tracks,
    read_kitti,
    read_tsai,
)
from world_recording import FRAME, IMAGE_TOPIC, stamp_at, write_room
from world_room import (
    CAMERA_HEIGHT,
    CAMERA_PITCH,
    Room,
    RoomFrame,
    Walker,
    circling,
    driving,
)
from world_scenes import Person, Renderer, box_around, corrupted

from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.progress import OnProgress, progress_bar
from pf_tracker_ros.recordings.positions import RecordedPositions, RecordedSensors
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import (
    CameraModel,
    GroundPlane,
    Localizer,
    Place,
    PositionFilter,
    fit_ground_plane,
    in_fixed_frame,
)

PETS_RATE = 7.0
# Boxes and repetitions of the plane from people.
PLANE_BOXES, PLANE_RUNS = 50, 30
# Boxes of the depth camera are larger than the target by this share at each side.
LOOSE = 0.15
# Distance of a passing occluder, of that of the target; its width, of the target's; frames to pass.
OCCLUDER_NEAR, OCCLUDER_WIDTH, OCCLUDER_FRAMES = 0.55, 0.3, 25
RENDERED_FRAMES = 200
# Frames of a robot that turns, and its angular velocity, degrees per second.
TURNING_FRAMES, TURNING_RATE = 100, 60.0
PARTS = ("kitti", "pets", "plane", "depth", "rendered", "turning", "cost")
# Standard deviation of center and size of the boxes of rendered people, pixels.
BOX_SD = 3.0


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of N estimates with D dimensions.

    Attributes:
        sizes: (N,) errors, meters or relative.
        nees: (N,) squared errors in standard deviations.
        dimensions: D.
    """

    sizes: Array
    nees: Array
    dimensions: int

    @classmethod
    def of(cls, errors: Array, covariances: Array, scale: Array | float = 1.0) -> Errors:
        """From (N, D) errors, (N, D, D) covariances, and what the sizes are divided by."""
        solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
        sizes = np.linalg.norm(errors, axis=1) / scale
        return cls(sizes, (errors * solved).sum(axis=1), errors.shape[1])

    def cells(self, factor: float = 1.0, digits: int = 2) -> list[str]:
        """Number, median, 90 %, NEES, and inside."""
        if not len(self.sizes):
            return ["0", "-", "-", "-", "-"]
        inside = (self.nees < chi2.ppf(0.9, self.dimensions)).mean()
        median, ninety = np.percentile(self.sizes, (50, 90)) * factor
        return [
            str(len(self.sizes)),
            f"{median:.{digits}f}",
            f"{ninety:.{digits}f}",
            f"{self.nees.mean() / self.dimensions:.2f}",
            f"{inside:.3f}",
        ]


def position_errors(
    places: Sequence[Place | None], positions: Array, selected: NDArray[np.bool_]
) -> tuple[Errors, Errors, int]:
    """Errors of range and position, relative to the range, and the number without a place."""
    chosen = [index for index in np.flatnonzero(selected) if places[index] is not None]
    found = [place for place in (places[index] for index in chosen) if place is not None]
    if not found:
        return Errors(np.empty(0), np.empty(0), 1), Errors(np.empty(0), np.empty(0), 3), 0
    true = positions[chosen]
    ranges = np.linalg.norm(true, axis=1)
    errors = np.array([place.position for place in found]) - true
    covariances = np.array([place.covariance for place in found])
    along = true / ranges[:, None]
    variance = np.einsum("ni,nij,nj->n", along, covariances, along)
    differences = np.array([place.range for place in found]) - ranges
    return (
        Errors.of(differences[:, None], variance[:, None, None], ranges),
        Errors.of(errors, covariances, ranges),
        int(selected.sum()) - len(found),
    )


def kitti_table(sequences: Sequence[LabeledBoxes], on_progress: OnProgress) -> Table:
    """Range and position before a moving car, with the defaults of `Localizer`."""
    kinds: dict[str, Sequence[str]] = {
        "ground and height": ("ground", "height"),
        "ground": ("ground",),
        "height": ("height",),
    }
    positions = np.concatenate([one.positions for one in sequences])
    whole = np.concatenate([one.is_whole for one in sequences])
    border = np.concatenate([one.at_border for one in sequences])
    groups, fused = [], []
    for name, methods in kinds.items():
        places: list[Place | None] = []
        for sequence in sequences:
            localizer = Localizer(sequence.camera)
            places += [localizer.locate(box, methods=methods) for box in sequence.boxes]
            on_progress(sequence.name, len(sequence.boxes))
        fused = fused or places
        groups.append(_kitti_row(f"{name}, whole", places, positions, whole))
    rows = [_kitti_row("at the border", fused, positions, border)]
    start = 0
    for sequence in sequences:
        of_sequence = np.zeros(len(whole), dtype=bool)
        of_sequence[start : start + len(sequence.boxes)] = sequence.is_whole
        start += len(sequence.boxes)
        rows.append(_kitti_row(f"whole in {sequence.name}", fused, positions, of_sequence))
    return Table(
        "KITTI, people and cyclists before a moving car",
        (
            "boxes",
            "located",
            "range median %",
            "90 %",
            "NEES",
            "inside",
            "position median %",
            "90 %",
            "NEES",
            "inside",
            "no place",
        ),
        [groups, rows],
    )


def _kitti_row(
    name: str, places: Sequence[Place | None], positions: Array, selected: NDArray[np.bool_]
) -> list[str]:
    ranges, errors, missing = position_errors(places, positions, selected)
    return [name, *ranges.cells(100.0, 1), *errors.cells(100.0, 1)[1:], str(missing)]


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
            stamp = round(tracks.frames[index] / PETS_RATE * 1e9)
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
    return Table("People before a calibrated camera", headings, [rows])


def _errors_of(pairs: Sequence[tuple[Array, Array]]) -> Errors:
    errors, covariances = zip(*pairs, strict=True)
    return Errors.of(np.array(errors), np.array(covariances))


def plane_table(camera: FixedCamera, tracks: GroundTracks, on_progress: OnProgress) -> Table:
    """The ground learned from random boxes: errors of the positions on it."""
    generator = np.random.default_rng(0)
    true = GroundPlane.from_pose(camera.rotation, camera.translation)
    level = np.column_stack([tracks.positions, np.zeros(len(tracks.positions))])
    expected = on_ground(true, (level - camera.translation) @ camera.rotation)
    foot = tracks.boxes[:, :2] + tracks.boxes[:, 2:] * (0.5, 1.0) - 0.5
    rays = camera.model.rays(foot)
    size = (camera.model.width, camera.model.height)
    ends = tracks.boxes[:, :2] + tracks.boxes[:, 2:]
    inside = ((tracks.boxes[:, :2] > 10) & (ends < np.array(size) - 10)).all(axis=1)
    rows = []
    for height in (1.7, 1.75):
        figures = []
        for _ in range(PLANE_RUNS):
            chosen = generator.choice(np.flatnonzero(inside), PLANE_BOXES, replace=False)
            on_progress("plane from people", 1)
            plane = fit_ground_plane(camera.model, tracks.boxes[chosen], height).plane
            places = on_ground(plane, rays * plane.distances(rays)[:, None])
            moved = aligned(places[inside], expected[inside])
            ranges = np.linalg.norm(places, axis=1) / np.linalg.norm(expected, axis=1)
            figures.append(
                [
                    np.median(np.linalg.norm(moved - expected[inside], axis=1)),
                    np.nanmedian(np.linalg.norm(places - expected, axis=1)),
                    100.0 * (np.nanmedian(ranges) - 1.0),
                    plane.height or np.nan,
                    np.degrees(plane.pitch),
                    np.degrees(plane.roll),
                ]
            )
        rows.append([f"{height:g} m", *(f"{one:.2f}" for one in np.median(figures, axis=0))])
    exact = [f"{one:.2f}" for one in (true.height or 0.0, *np.degrees([true.pitch, true.roll]))]
    rows.append(["calibration", "", "", "", *exact])
    return Table(
        f"The ground from {PLANE_BOXES} people of a known height (median of {PLANE_RUNS} draws)",
        (
            "people's height",
            "median error after alignment, m",
            "before, m",
            "bias of the range, %",
            "camera's height, m",
            "pitch, degrees",
            "roll",
        ),
        [rows],
    )


def on_ground(plane: GroundPlane, points: Array) -> Array:
    """(N, 2) coordinates along the ground, forward and right of the camera, of (N, 3) points."""
    forward = np.array([0.0, 0.0, 1.0]) - plane.down[2] * plane.down
    forward /= np.linalg.norm(forward)
    return points @ np.column_stack([forward, np.cross(plane.down, forward)])


def aligned(points: Array, targets: Array) -> Array:
    """(N, 2) points after the rotation and translation that bring them nearest to the targets.

    A plane before a camera has no place in the world: without it, only the shape counts.
    """
    middle, target_middle = points.mean(axis=0), targets.mean(axis=0)
    left, _, right = np.linalg.svd((points - middle).T @ (targets - target_middle))
    sign = np.sign(np.linalg.det(left @ right))
    rotated: Array = (points - middle) @ left @ np.diag([1.0, sign]) @ right
    return rotated + target_middle


def depth_table(folder: Path, on_progress: OnProgress) -> Table:
    """Frames of a depth camera, as they are, with holes, and with a passing occluder."""
    camera = CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480)
    rows = []
    for name, holes, occluded, predicted in (
        ("loose box", 0.0, False, False),
        ("30 % holes", 0.3, False, False),
        ("30 % holes, occluder", 0.3, True, False),
        ("30 % holes, occluder, predicted range", 0.3, True, True),
    ):
        generator = np.random.default_rng(0)
        localizer, prediction = Localizer(camera), None
        errors, evidence, hidden = [], [], []
        for index, frame in enumerate(read_depth_frames(folder)):
            true = float(np.median(frame.depth[frame.mask & (frame.depth > 0)])) * 1e-3
            x, y, width, height = box_around(frame.mask)
            image, depth = frame.image.copy(), frame.depth.copy()
            share = 0.0
            if occluded:
                phase = index % OCCLUDER_FRAMES / OCCLUDER_FRAMES
                middle = x + (1.6 * phase - 0.3) * width
                left = max(int(middle - OCCLUDER_WIDTH * width / 2), 0)
                right = max(int(middle + OCCLUDER_WIDTH * width / 2), left)
                depth[:, left:right] = round(1000.0 * OCCLUDER_NEAR * true)
                image[:, left:right] = (30, 90, 160)
                share = float(frame.mask[:, left:right].sum() / frame.mask.sum())
            depth = corrupted(depth * 1e-3, holes, generator) if holes else depth
            box = (
                x - LOOSE * width,
                y - LOOSE * height,
                (1.0 + 2.0 * LOOSE) * width,
                (1.0 + 2.0 * LOOSE) * height,
            )
            place = localizer.locate(
                box, image=image, depth=depth, predicted_range=prediction if predicted else None
            )
            on_progress(name, 1)
            if place is None:
                errors.append(np.inf)
                continue
            distance = float(place.position[2])
            # The lower center may be far below a half figure: along the bearing.
            prediction = (distance / float(place.bearing[2]), 0.05 * distance + 0.05)
            errors.append(abs(distance / true - 1.0))
            if place.occlusion is not None:
                evidence.append(place.occlusion)
                hidden.append(share)
        rows.append(
            [
                name,
                f"{100.0 * float((np.array(errors) > 0.1).mean()):.1f}",
                f"{100.0 * float(np.median(errors)):.1f}",
                auroc(np.array(evidence), np.array(hidden) > 0.05) if occluded else "-",
            ]
        )
    return Table(
        "Frames of a depth camera",
        ("", "off by over 10 %, %", "median error, %", "AUROC of the occlusion"),
        [rows],
    )


def auroc(values: Array, positive: NDArray[np.bool_]) -> str:
    """Area under the receiver operating characteristic, as a text."""
    count, others = int(positive.sum()), int((~positive).sum())
    if not (count and others):
        return "-"
    ranks = float(rankdata(values)[positive].sum())
    return f"{(ranks - count * (count + 1) / 2.0) / (count * others):.3f}"


def rendered_table(on_progress: OnProgress, frames: int = RENDERED_FRAMES) -> Table:
    """Rendered people with 30 % holes and background in half of the box."""
    camera = CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480)
    rows = []
    for name, height in (("camera at 1.2 m", 1.2), ("ground unknown", None)):
        generator = np.random.default_rng(0)
        true_plane = GroundPlane.from_angles(1.2, 0.05)
        rays, background = Renderer(camera, true_plane, 9.0).background()
        renderer = Renderer(camera, true_plane, 9.0)
        localizer = Localizer(camera, height, 0.05)
        for label, holes, occluder in (("", 0.3, False), (", occluder", 0.3, True)):
            places: list[Place | None] = []
            positions, evidence, hidden = [], [], []
            for index in range(frames):
                person = Person(
                    generator.uniform(3.5, 7.0),
                    generator.uniform(-0.3, 0.3),
                    generator.normal(1.75, 0.08),
                    generator.uniform(-np.pi, np.pi),
                )
                depth = background.copy()
                mask = renderer.add(rays, depth, person)
                x, y, width, box_height = box_around(mask)
                loose = np.array([x - width / 2.0, y, 2.0 * width, box_height])
                dx, dy, dw, dh = generator.normal(0.0, BOX_SD, 4)
                box = loose + (dx - dw / 2.0, dy - dh / 2.0, dw, dh)
                prediction = None
                if occluder:
                    prediction = (float(np.linalg.norm(renderer.position(person))), 0.2)
                    if index % 2:
                        other = Person(
                            0.6 * person.distance, person.bearing + 0.04, 1.7, np.pi / 2.0
                        )
                        hidden_mask = renderer.add(rays, depth, other) & mask
                        hidden.append(hidden_mask.sum() / mask.sum() > 0.05)
                    else:
                        hidden.append(False)
                place = localizer.locate(
                    box,
                    BOX_SD**2 * np.eye(4),
                    depth=corrupted(depth, holes, generator),
                    predicted_range=prediction,
                )
                if occluder:
                    share = place.occlusion if place is not None else None
                    evidence.append(0.0 if share is None else share)
                places.append(place)
                positions.append(renderer.position(person))
                on_progress("rendered", 1)
            everything = np.ones(frames, dtype=bool)
            ranges, errors, missing = position_errors(places, np.array(positions), everything)
            rows.append(
                [
                    name + label,
                    *ranges.cells(100.0)[:3],
                    *errors.cells(100.0)[1:],
                    str(missing),
                    auroc(np.array(evidence), np.array(hidden)) if occluder else "-",
                ]
            )
    return Table(
        "Rendered people, 30 % holes, background in half of the box",
        (
            "",
            "located",
            "range median %",
            "90 %",
            "position median %",
            "90 %",
            "NEES",
            "inside",
            "no place",
            "AUROC",
        ),
        [rows],
    )


def turning_table(
    on_progress: OnProgress, frames: int = TURNING_FRAMES, rate: float = TURNING_RATE
) -> Table:
    """Directions in the fixed frame while the robot turns and the images arrive late.

    The boxes are exact. The positions are those of `track --world`, by the localizer's own code,
    with odometry at the image's stamp.
    """
    base = driving(0.2, 0.3, np.radians(rate))
    walker = Walker(circling((5.0, 0.0), 0.6, 9.0, 0.0), (50, 60, 200), (90, 60, 40))
    rows = []
    for latency in (0.0, 0.1):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / "room.mcap"
            rendered = write_room(Room((walker,), base, rate=20.0), bag, frames, latency)
            parameters = build(
                LocalizerParameters, {"camera.height": CAMERA_HEIGHT, "camera.pitch": CAMERA_PITCH}
            )
            positions = RecordedPositions(bag, IMAGE_TOPIC, {}, parameters)
            with closing(positions.open()) as sensors:
                errors = [direction_error(frame, sensors, latency) for frame in rendered]
        on_progress("turning", frames)
        found = [error for error in errors if error is not None]
        median, ninety = np.percentile(found, (50, 90))
        rows.append(
            [
                f"{latency:g} s",
                str(len(found)),
                *(f"{one:.2f}" for one in (median, ninety, max(found))),
            ]
        )
    return Table(
        f"Turning at {rate:g} degrees a second, exact boxes",
        ["images late by", "frames", "median, degrees", "90 %", "largest"],
        [rows],
    )


def direction_error(frame: RoomFrame, sensors: RecordedSensors, latency: float) -> float | None:
    """Error of the first walker's filtered direction from the camera, degrees; None without."""
    box = frame.boxes[0]
    if box is None:
        return None
    stamp = stamp_at(frame.time)
    target = ReportedTarget(1, "", "tracking", 1.0, box, np.eye(4))
    size = frame.image.shape[1], frame.image.shape[0]
    located = sensors.locate(
        TrackerFrame(stamp, FRAME, False, "tracking", 1, size, (target,)),
        stamp + round(latency * NANOSECONDS),
    )
    world = located.targets[0].world if located.targets else None
    if world is None:
        return None
    camera = np.array([frame.base.x, frame.base.y])
    directions = [one - camera for one in (world.filtered.position, frame.positions[0])]
    (x, y), (true_x, true_y) = directions
    return abs(float(np.degrees(np.arctan2(x * true_y - y * true_x, x * true_x + y * true_y))))


def cost_table(on_progress: OnProgress) -> Table:
    """CPU time of one position, the least of some rounds."""
    generator = np.random.default_rng(0)
    depth = np.full((480, 640), 4000, np.uint16)
    depth[150:400, 280:360] = 3000
    depth[generator.random(depth.shape) < 0.3] = 0
    image = generator.integers(0, 255, (480, 640, 3), np.uint8)
    box = (270.0, 140.0, 100.0, 270.0)
    cases: Mapping[str, Mapping[str, object]] = {
        "box alone": {},
        "with depth": {"depth": depth},
        "with depth and a map of the target": {
            "depth": depth,
            "target_probability": np.full((32, 16), 0.5),
        },
        "with depth and image": {"depth": depth, "image": image},
    }
    rows = []
    for name, given in cases.items():
        cells = [name]
        for distortion in ((), (-0.3, 0.1, 0.001, 0.001, 0.0)):
            localizer = Localizer(CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480, distortion))
            cells.append(f"{least_cpu_ms(lambda: localizer.locate(box, **given)):.3f}")  # noqa: B023
            on_progress("cost", 1)
        rows.append(cells)
    headings = ("640 x 480", "rectified, ms", "plumb_bob, ms")
    return Table("CPU time of a position", headings, [rows])


def least_cpu_ms(run: Callable[[], object], rounds: int = 15, count: int = 100) -> float:
    """CPU time in ms of a call, in the fastest of some rounds."""
    best = np.inf
    run()
    for _ in range(rounds):
        start = time.process_time()
        for _ in range(count):
            run()
        best = min(best, (time.process_time() - start) / count)
    return 1000.0 * best


def measured(options: argparse.Namespace, on_progress: OnProgress) -> Iterable[Table]:
    """The tables that the options ask for."""
    parts = options.only or PARTS
    if options.kitti and "kitti" in parts:
        paths = sorted(options.kitti.glob("*.csv"))
        if not paths:
            raise ValueError(f"{options.kitti} has no tables of KITTI labels (*.csv)")
        yield kitti_table([read_kitti(path) for path in paths], on_progress)
    if options.pets and {"pets", "plane"}.intersection(parts):
        if not options.calibration:
            raise ValueError("--pets needs --calibration, the Tsai calibration of its view")
        camera = read_tsai(options.calibration)
        tracks = read_ground_tracks(options.pets, PETS_RATE)
        if "pets" in parts:
            yield pets_table(camera, tracks, on_progress)
        if "plane" in parts:
            yield plane_table(camera, tracks, on_progress)
    if options.depth and "depth" in parts:
        yield depth_table(options.depth, on_progress)
    if "rendered" in parts:
        yield rendered_table(on_progress)
    if "turning" in parts:
        yield turning_table(on_progress)
    if "cost" in parts:
        yield cost_table(on_progress)


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    made = options_of.parts_parser(__doc__, PARTS)
    made.add_argument("--kitti", type=Path, metavar="DIR", help="tables of KITTI tracking labels")
    made.add_argument("--pets", type=Path, metavar="DIR", help="gt.txt and det.txt of PETS09-S2L1")
    made.add_argument("--calibration", type=Path, metavar="FILE", help="Tsai calibration of PETS")
    made.add_argument("--depth", type=Path, metavar="DIR", help="frames of a depth camera")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print."""
    cv2.setNumThreads(1)
    parser = arguments()
    options = parser.parse_args(argv)
    lines = ["# Positions in meters", ""]
    try:
        with progress_bar(None, "boxes") as on_progress:
            tables = list(measured(options, on_progress))
        for table in tables:
            table.show()
            lines += [f"## {table.title}", "", *table.markdown(), ""]
        if options.output:
            options.output.write_text("\n".join(lines), encoding="utf-8")
    except (OSError, ValueError) as error:
        parser.error(" ".join(str(error).split()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
