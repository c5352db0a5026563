"""What is to be tracked in a recording, and how: one target, or several and a detector's."""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pf_tracker_ros.evaluation.command_line import (
    parse_parameters,
    take_parameter_file,
    telling_of_file,
)
from pf_tracker_ros.footage import is_bag
from pf_tracker_ros.footage.access import is_there
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.recordings.beside import detections_file
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS, RecordingError
from pf_tracker_ros.recordings.recording import Recording, open_recording
from pf_tracker_ros.recordings.target import Target, choose_targets
from pf_tracker_ros.recordings.tracking import Tracked, track_recording
from pf_tracker_ros.tracking.presets import PresetInForce
from pf_tracker_ros.targets.tracker import Tracker

if TYPE_CHECKING:
    from pf_tracker_ros.recordings.detections.hearing import Hearing

_MOST = "targets.most"

BESIDE = Path()
"""What an option stands for that is given without its file or folder: the one beside.

To be told by `is` from the folder that a user is in.
"""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be tracked in a recording, and how.

    Attributes:
        recording: In which.
        targets: Which, besides what a detector finds.
        hearing: Hears what a detector says, None without one.
        is_several: Whether it is for a tracker of several targets.
        preset: Name of the preset.
        parameters: Full name to value, where they differ from the preset's.
        seed: As for `Tracker`.
    """

    recording: Recording
    targets: tuple[Target, ...]
    hearing: Hearing | None
    is_several: bool
    preset: str
    parameters: Mapping[str, Any]
    seed: int

    @property
    def summary(self) -> str:
        """The preset, and how many values differ from it."""
        return _summary(self.preset, self.parameters, self.seed, several=self.is_several)

    def track(self) -> Generator[Tracked, None, None]:
        """Track; see `track_recording` and `track_targets`."""
        recording, preset, seed = self.recording, self.preset, self.seed
        if not self.is_several:
            return track_recording(recording, self.targets[0], preset, self.parameters, seed)
        from pf_tracker_ros.recordings.several import track_targets

        return track_targets(
            recording,
            self.targets,
            self.hearing,
            preset=preset,
            parameters=self.parameters,
            seed=seed,
        )

    def close(self) -> None:
        """Let go of what hears the detector."""
        if self.hearing is not None:
            self.hearing.close()


def open_asked(path: Path, options: argparse.Namespace) -> Recording:
    """Open a recording as the options of `track` ask for.

    Raises:
        FootageError: It cannot be read.
    """
    rate = options.frame_rate or DEFAULT_FRAME_RATE
    return open_recording(path, bag_topic=options.bag_topic, frame_rate=rate)


def check_applies(options: argparse.Namespace, recording: Recording) -> None:
    """Refuse options that are for another kind of recording.

    Raises:
        RecordingError: There is one.
    """
    path = recording.path
    if options.bag_topic and not is_bag(path):
        raise RecordingError(f"--bag-topic is for a bag, and {path} is none; leave it out")
    rate = 1.0 / recording.interval
    # Where it tells the same, nothing is disregarded.
    if options.frame_rate and not math.isclose(rate, options.frame_rate, rel_tol=1e-3):
        raise RecordingError(
            f"--frame-rate is for a folder of images, and {path} tells its own, about {rate:.4g} "
            "frames a second; leave it out"
        )


def plan_for(
    recording: Recording,
    options: argparse.Namespace,
    draw: Callable[[int], tuple[Target, ...]] | None = None,
    *,
    is_archived: bool = False,
) -> Plan:
    """What the options of `track` ask for.

    Args:
        recording: In which.
        options: Of the command line.
        draw: Asks for up to so many targets in the place of all others, once nothing else is in
            the way.
        is_archived: Whether it is one of an archive, where some options are not allowed.

    Raises:
        RecordingError: There is no target, or one or the detections cannot be used.
        ParameterError: A parameter is not allowed.
        FootageError: The detections of a bag cannot be read.
    """
    detected = is_detected(options)
    targets: tuple[Target, ...] = ()
    if draw is None:
        targets = choose_targets(
            recording, options.box or (), detected=detected, is_archived=is_archived
        )
    hearing = _hearing(recording, options, is_archived=is_archived) if detected else None
    try:
        if draw is not None:
            targets = draw(_most_targets(options))
        # One target alone may be that of a tracker of several, whose parameters are given then.
        several = detected or len(targets) > 1 or not _suit_one_target(options)
        parameters = _parameters(options, several=several)
        return Plan(recording, targets, hearing, several, options.preset, parameters, options.seed)
    except BaseException:
        if hearing is not None:
            hearing.close()
        raise


def take_settings(options: argparse.Namespace) -> None:
    """Put what a parameter file gives into preset, parameters and seed, as if it had been typed.

    Args:
        options: Of the command line, which are changed.

    Raises:
        ParameterError: The file cannot be read, or is not for a tracker; or a parameter is the
            node's alone.
        EvaluationError: What is given contradicts it.
    """
    if "max_targets" in parse_parameters(options.parameter):
        raise ParameterError(
            f"'max_targets' is a parameter of the node; here it is '{_MOST}': --parameter {_MOST}=N"
        )
    settings = take_parameter_file(options)
    if settings.most_targets > 1 and _MOST not in parse_parameters(options.parameter):
        options.parameter.append(f"{_MOST}={settings.most_targets}")
    if options.seed is None:
        options.seed = settings.seed or 0


def is_detected(options: argparse.Namespace) -> bool:
    """Whether a detector is to start targets."""
    return any((options.detections, options.detections_topic, options.detector))


def check_request(options: argparse.Namespace) -> None:
    """Refuse what no recording could be tracked with, before one is opened.

    Raises:
        ParameterError: A parameter is not allowed.
        RecordingError: Several targets cannot be tracked here.
    """
    if is_detected(options) or len(options.box or ()) > 1:
        _parameters(options, several=True)
        return
    try:
        _parameters(options, several=False)
    except ParameterError as error:
        # A target file may list several, which have some more of them.
        try:
            _parameters(options, several=True)
        except (ParameterError, RecordingError):
            raise error from None


def _suit_one_target(options: argparse.Namespace) -> bool:
    """Whether the parameters are those of a tracker of one target."""
    try:
        _parameters(options, several=False)
    except ParameterError:
        return False
    return True


def _most_targets(options: argparse.Namespace) -> int:
    """How many targets there may be; 1 where several cannot be tracked here."""
    try:
        parameters = _parameters(options, several=True)
    except (ParameterError, RecordingError):
        return 1
    from pf_tracker_ros.targets.multi_tracker import MultiTracker

    values = MultiTracker.from_preset(options.preset, options.seed, parameters).parameters
    return int(values[_MOST])


def _parameters(options: argparse.Namespace, *, several: bool) -> dict[str, Any]:
    """Full name to value of what differs from the preset's, for one target or several."""
    tunables = _several_tunables() if several else None
    given = options.parameter
    parameters = parse_parameters(given, tunables=tunables) if tunables else parse_parameters(given)
    with telling_of_file(options):
        _summary(options.preset, parameters, options.seed, several=several)
    return parameters


def require(package: str, extra: str) -> None:
    """Make sure that a package is installed.

    Raises:
        RecordingError: It is not; the message says how to get it.
    """
    try:
        importlib.import_module(package)
    except ImportError as error:
        name = "pyyaml" if package == "yaml" else package
        raise RecordingError(
            f"{name} is not installed: pip install {name}, or '.[{extra}]' in the sources"
        ) from error


def _several_tunables() -> type:
    require("scipy", "targets")
    from pf_tracker_ros.targets.parameters import MultiTrackerParameters

    return MultiTrackerParameters


def _summary(preset: str, parameters: Mapping[str, Any], seed: int, *, several: bool) -> str:
    """What the node calls the preset in force."""
    if not several:
        values = Tracker.from_preset(preset, seed, parameters).parameters
        return PresetInForce.of({"preset": preset, **values}).summary
    from pf_tracker_ros.targets.multi_tracker import MultiTracker
    from pf_tracker_ros.targets.parameters import multi_preset_parameters

    values = MultiTracker.from_preset(preset, seed, parameters).parameters | {"preset": preset}
    # The node has max_targets in its place, which is of no preset.
    del values["targets.most"]
    return PresetInForce.of(values, multi_preset_parameters).summary


def _hearing(recording: Recording, options: argparse.Namespace, *, is_archived: bool) -> Hearing:
    if options.detections:
        from pf_tracker_ros.recordings.detections.file import DetectionFile

        if options.detections is not BESIDE:
            return DetectionFile(options.detections)
        path = detections_file(recording.path)
        if not is_there(path):
            otherwise = "" if is_archived else ", or give --detections FILE"
            raise RecordingError(
                f"no detections for {recording.path}: write {path.name} beside it{otherwise}",
                WRONG_DETECTIONS,
            )
        return DetectionFile(path)
    if options.detections_topic:
        from pf_tracker_ros.recordings.detections.topic import DetectionTopic

        return DetectionTopic(recording.path, options.detections_topic)
    from pf_tracker_ros.recordings.detections.built_in import BuiltInDetector

    return BuiltInDetector(options.detector, options.detector_rate)
