"""The plan of a run of `track`: recording, targets, detections and parameters, from its options."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pf_tracker_ros.evaluation.command_line import (
    errors_name_parameter_file,
    merge_parameter_file,
    parse_parameters,
)
from pf_tracker_ros.footage import is_bag
from pf_tracker_ros.footage.access import lexists
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.parameter_files import read_node_section
from pf_tracker_ros.parameters import build, declarations
from pf_tracker_ros.recordings.detections import (
    BuiltInDetector,
    DetectionFile,
    DetectionSource,
    DetectionTopic,
)
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS, RecordingError
from pf_tracker_ros.recordings.keyframes.keyframes import KeyframeTrack, read_keyframes
from pf_tracker_ros.recordings.keyframes.tracking import track_between_keyframes
from pf_tracker_ros.recordings.positions import RecordedPositions
from pf_tracker_ros.recordings.recording import BagRecording, Recording, open_recording
from pf_tracker_ros.recordings.sidecar_files import detections_file, target_file
from pf_tracker_ros.recordings.target import Target, choose_targets
from pf_tracker_ros.recordings.tracking import (
    TrackedFrame,
    Tracking,
    track_recording,
    tracker_parameters,
)
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import ActivePreset

# Name of the localizer's node in parameter files.
_LOCALIZER = "localizer"
# Parameters of the localizer that have no effect on recordings.
_WITHOUT_EFFECT = {"autostart", "depth_transport"}

SIDECAR = Path()
"""Value of an option without its file or folder: the default place beside the recording or results.

Compare it with `is`: it equals the current folder.
"""

DrawTargets = Callable[[Recording, int], tuple[Target, ...]]
"""Prompts for at most so many targets in a recording."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is tracked, and how.

    Attributes:
        recording: The recording.
        targets: The given targets. Detections may start others.
        detection_source: Source of the detections, None without a detector.
        preset: Name of the preset.
        parameters: Full name to value of all parameters.
        seed: As for `Tracker`.
        keyframes: Targets with keyframes, instead of `targets`.
        positions: Locates the targets in meters; None if that is not wanted.
    """

    recording: Recording
    targets: tuple[Target, ...]
    detection_source: DetectionSource | None
    preset: str
    parameters: Mapping[str, Any]
    seed: int
    keyframes: tuple[KeyframeTrack, ...] = ()
    positions: RecordedPositions | None = None

    @property
    def max_targets(self) -> int:
        """The largest number of simultaneous targets."""
        return int(self.parameters["max_targets"])

    @property
    def summary(self) -> str:
        """The preset, and the number of parameters that differ from it."""
        values = {"preset": self.preset, **self.parameters}
        # Each target with keyframes has a tracker of its own.
        return ActivePreset.of({**values, "max_targets": 1} if self.keyframes else values).summary

    def track(self) -> Generator[TrackedFrame, None, None]:
        """Track, and locate; see `track_recording` and `track_between_keyframes`."""
        return self.positions.locate(self._track()) if self.positions else self._track()

    def _track(self) -> Tracking:
        if self.keyframes:
            return track_between_keyframes(
                self.recording, self.keyframes, parameters=self.parameters, seed=self.seed
            )
        return track_recording(
            self.recording,
            self.targets,
            self.detection_source,
            preset=self.preset,
            parameters=self.parameters,
            seed=self.seed,
        )

    def close(self) -> None:
        """Release the detection source."""
        if self.detection_source is not None:
            self.detection_source.close()


def open_from_options(path: Path | str, options: argparse.Namespace) -> Recording:
    """Open a recording with the options of `track`.

    Args:
        path: Its path; or a camera.
        options: Of the command line.

    Raises:
        FootageError: It cannot be read.
    """
    rate = options.frame_rate or DEFAULT_FRAME_RATE
    return open_recording(
        path, bag_topic=options.bag_topic, frame_rate=rate, as_recorded=options.as_recorded
    )


def check_applies(options: argparse.Namespace, recording: Recording) -> None:
    """Check that the options apply to this kind of recording.

    Raises:
        RecordingError: One does not.
    """
    path = recording.path
    for name, value in (
        ("--bag-topic", options.bag_topic),
        ("--as-recorded", options.as_recorded),
    ):
        if value and not is_bag(path):
            raise RecordingError(f"{name} applies to bags, and {path} is not a bag; leave it out")
    if recording.is_live:
        for name in ("--keyframes", "--detections", "--detections-topic"):
            if getattr(options, name.strip("-").replace("-", "_")):
                raise RecordingError(f"{name} needs a recording, and {path} is a camera")
    rate = 1.0 / recording.interval
    # The recording's own frame rate is no error.
    if options.frame_rate and not math.isclose(rate, options.frame_rate, rel_tol=1e-3):
        raise RecordingError(
            f"--frame-rate applies to folders of images, and {path} has its own frame rate, about "
            f"{rate:.4g} Hz; leave it out"
        )


def make_plan(
    recording: Recording,
    options: argparse.Namespace,
    draw: DrawTargets | None = None,
) -> Plan:
    """Make the plan from the options of `track`.

    Args:
        recording: To track in.
        options: Of the command line; with an archive, the recording is one of it, which changes the
            advice in errors.
        draw: Prompts for the targets, which replace all others. Called last, when all else is
            checked.

    Raises:
        RecordingError: There is no target, or a target or the detections are invalid.
        ParameterError: A parameter is invalid.
        FootageError: The detections of a bag cannot be read.
    """
    positions = _positions(recording, options)
    if options.keyframes is not None:
        return replace(_keyframe_plan(recording, options), positions=positions)
    with_detector, is_archived = uses_detector(options), options.archive is not None
    targets: tuple[Target, ...] = ()
    if draw is None:
        targets = choose_targets(
            recording, options.box or (), with_detector=with_detector, is_archived=is_archived
        )
    detection_source = _detection_source(recording, options) if with_detector else None
    try:
        if draw is not None:
            targets = draw(recording, _parameters(options)["max_targets"])
        parameters = _parameters(options, targets)
        return Plan(
            recording,
            targets,
            detection_source,
            options.preset,
            parameters,
            options.seed,
            positions=positions,
        )
    except BaseException:
        if detection_source is not None:
            detection_source.close()
        raise


def _positions(recording: Recording, options: argparse.Namespace) -> RecordedPositions | None:
    if options.localizer is None:
        return None
    if not isinstance(recording, BagRecording):
        if options.archive is not None:
            # Others of the archive may be bags.
            return None
        raise RecordingError(
            f"--world needs the calibration of the camera, which {recording.path} does not have; "
            "give a bag with CameraInfo"
        )
    given = dict(options.world_topic)
    return RecordedPositions(recording.path, recording.image_topic, given, options.localizer)


def _keyframe_plan(recording: Recording, options: argparse.Namespace) -> Plan:
    path = options.keyframes
    tracks = read_keyframes(target_file(recording.path) if path is SIDECAR else path, recording)
    # Each target has a tracker of its own, with the values for one target.
    parameters = {**_parameters(options, [Target(None)]), "max_targets": len(tracks)}
    return Plan(recording, (), None, options.preset, parameters, options.seed, tracks)


def apply_parameter_file(options: argparse.Namespace) -> None:
    """Merge the parameter file into preset, parameters and seed, as if they had been typed.

    Args:
        options: Of the command line; changed.

    Raises:
        ParameterError: The file cannot be read, or is not for a tracker.
        EvaluationError: Another option contradicts it.
        RecordingError: A parameter of the localizer is given without --world.
    """
    file = options.params_file
    only_localizer = _take_localizer_parameters(options)
    options.params_file = None if only_localizer else file
    settings = merge_parameter_file(options)
    options.params_file = file
    if options.seed is None:
        options.seed = settings.seed or 0


def _take_localizer_parameters(options: argparse.Namespace) -> bool:
    """Move the parameters of the localizer from the tracker's to `options.localizer`.

    Returns:
        Whether the parameter file is for the localizer alone.
    """
    names = declarations(LocalizerParameters).keys() - _WITHOUT_EFFECT
    own = [one for one in options.parameter if one.partition("=")[0].strip() in names]
    options.localizer = None
    if not options.world:
        if own or options.world_topic:
            given = f"--parameter {own[0]}" if own else "--world-topic"
            raise RecordingError(f"{given} is for the localizer; add --world")
        return False
    options.parameter = [one for one in options.parameter if one not in own]
    nodes: list[str] = []
    values: dict[str, Any] = {}
    if options.params_file is not None:
        values, nodes = read_node_section(options.params_file, _LOCALIZER)
    values |= parse_parameters(own, declared_in=LocalizerParameters)
    options.localizer = build(LocalizerParameters, values)
    return bool(nodes) and all(node.rpartition("/")[2] == _LOCALIZER for node in nodes)


def uses_detector(options: argparse.Namespace) -> bool:
    """Whether detections start targets."""
    return any((options.detections, options.detections_topic, options.detector))


def check_request(options: argparse.Namespace) -> None:
    """Check what can be checked before a recording is opened.

    Raises:
        ParameterError: A parameter is invalid.
        RecordingError: There are more targets than `max_targets`.
    """
    _parameters(options, [Target(box) for box in options.box or ()])


def _parameters(options: argparse.Namespace, targets: Sequence[Target] = ()) -> dict[str, Any]:
    """Full name to value of all parameters; raises as `check_request`."""
    given = parse_parameters(options.parameter)
    with errors_name_parameter_file(options):
        values = tracker_parameters(
            options.preset, given, targets, with_detector=uses_detector(options)
        )
        Session(values, options.seed)
    return values


def _detection_source(recording: Recording, options: argparse.Namespace) -> DetectionSource:
    if options.detections_topic:
        return DetectionTopic(recording.path, options.detections_topic)
    if options.detector:
        return BuiltInDetector(options.detector, options.detector_rate)
    if options.detections is not SIDECAR:
        return DetectionFile(options.detections)
    path = detections_file(recording.path)
    if not lexists(path):
        otherwise = "" if options.archive is not None else ", or give --detections FILE"
        raise RecordingError(
            f"no detections for {recording.path}; write {path.name} beside it{otherwise}",
            WRONG_DETECTIONS,
        )
    return DetectionFile(path)
