"""Tracks targets between keyframes, forward and backward.

For each target and frame of the recording:
1. A forward tracker starts on each keyframe, and tracks up to the next one.
2. There, a backward tracker starts, and tracks back over the stored images.
3. Both passes are joined (`joining.py`). After the last keyframe, and before one where the target
   is absent, the forward pass counts alone.

4. Where a target is absent up to a keyframe with a box, a backward pass looks whether it came back
   earlier. It stays absent, but these frames are to be checked.

A frame is yielded when all targets are known in it. So images are stored from the oldest keyframe
whose next one has not been reached yet.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.parameters import build
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.keyframes.frame_store import FrameStore
from pf_tracker_ros.recordings.keyframes.joining import (
    CHECK_JOINED_BELOW,
    CHECK_SINGLE_BELOW,
    Pass,
    join,
)
from pf_tracker_ros.recordings.keyframes.keyframes import KeyframeTrack, check_within
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.tracking import TrackedFrame, Tracking
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.targets.tracker import Tracker
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.parameters import TrackerParameters

_Image = NDArray[Any]
# Frames before the end of an absence in which the target is looked for.
_LOOK_BACK = 300


def track_between_keyframes(
    recording: Recording,
    tracks: Sequence[KeyframeTrack],
    *,
    parameters: Mapping[str, Any],
    seed: int = 0,
) -> Tracking:
    """Track targets between their keyframes; the keyframes' boxes are met exactly.

    Args:
        recording: To track in.
        tracks: The targets, at least one.
        parameters: Full name to value of all parameters; each target has a tracker of its own.
        seed: As for `Tracker`.

    Yields:
        Every frame, in order. A target is reported from its first keyframe on.

    Raises:
        ParameterError: A parameter is invalid.
        RecordingError: A keyframe is refused, or belongs to another recording.
        FootageError: The recording cannot be read, or only in part.
    """
    values = build(TrackerParameters, {**parameters, "max_targets": 1})
    pending: list[RecordedFrame] = []
    count = 0
    with (
        one_opencv_thread(),
        closing(FrameStore()) as images,
        closing(Prefetch(recording.frames())) as frames,
    ):
        targets = [_TargetPasses(track, values, seed, images) for track in tracks]
        failure = None
        try:
            for frame in frames:
                count += 1
                problem = _add(frame, targets, images)
                # The store keeps the image.
                pending.append(replace(frame, decoded=None, problem=problem))
                known = min(target.known_until for target in targets)
                yield from _completed(pending, known, targets, images)
        except FootageError as error:
            failure = error
        # Without the next keyframe, the forward pass is kept.
        for target in targets:
            target.settle_forward()
        yield from _completed(pending, count, targets, images)
        if failure is not None:
            raise failure
        check_within(tracks, count)


def _add(frame: RecordedFrame, targets: Sequence[_TargetPasses], images: FrameStore) -> str:
    """Track all targets into a frame; return why it cannot be used, or an empty text."""
    if frame.image is None:
        for target in targets:
            target.skip(frame, frame.problem)
        return frame.problem
    images.add(frame.index, frame.image)
    problems = [problem for target in targets if (problem := target.add(frame, frame.image))]
    return problems[0] if len(problems) == len(targets) else ""


def _completed(
    pending: list[RecordedFrame],
    known: int,
    targets: Sequence[_TargetPasses],
    images: FrameStore,
) -> Iterator[TrackedFrame]:
    """Take the frames before `known` from the pending ones, and yield their results."""
    while pending and pending[0].index < known:
        frame = pending.pop(0)
        index = frame.index
        image = images.find(index)
        images.discard(index)
        decoded = None if image is None else Frame(image, frame.stamp)
        moments = [(target, target.take(index)) for target in targets]
        present = [(target, moment) for target, moment in moments if moment is not None]
        yield TrackedFrame(
            frame=replace(frame, decoded=decoded),
            outcome="refused" if frame.problem else "tracked" if present else "waiting",
            targets=tuple(
                TrackedTarget(target.track.id, target.track.label, moment.estimate, 0.0, 0.0)
                for target, moment in present
                if not frame.problem
            ),
            selected=targets[0].track.id if len(targets) == 1 and present else 0,
            max_targets=len(targets),
            image=image,
            problem=frame.problem,
            to_check={
                target.track.id: moment.to_check for target, moment in present if moment.to_check
            },
            keyframes=frozenset(
                target.track.id for target, _ in present if index in target.track.keyframes
            ),
        )


class _Moment:
    """A target in one frame.

    Attributes:
        estimate: Its estimate, reduced to a single particle.
        to_check: Why a person should look at it, or empty.
    """

    def __init__(self, estimate: Estimate, to_check: str = "") -> None:
        self.estimate = estimate
        self.to_check = to_check


class _TargetPasses:
    """The passes of one target.

    Attributes:
        track: Its keyframes.
        known_until: The target is known in all frames before this one.
    """

    def __init__(
        self, track: KeyframeTrack, values: TrackerParameters, seed: int, images: FrameStore
    ) -> None:
        self.track = track
        self.known_until = 0
        self._images = images
        self._forward, self._backward = Tracker(values, seed), Tracker(values, seed)
        self._last_keyframe = max(track.keyframes)
        # Frames and stamps of the forward pass since the last keyframe, with its estimates.
        self._open: dict[int, tuple[int, Estimate]] = {}
        self._moments: dict[int, _Moment] = {}
        self._absent: Estimate | None = None
        # Stamps of the last frames of an absence.
        self._absences: dict[int, int] = {}

    def take(self, frame: int) -> _Moment | None:
        """Remove and return the target in a frame; None before its first keyframe."""
        return self._moments.pop(frame, None)

    def skip(self, frame: RecordedFrame, problem: str) -> None:
        """Pass over a frame without a usable image."""
        if self.track.keyframes.get(frame.index) is not None:
            raise self._refusal(frame.index, problem)
        if frame.index in self.track.keyframes:
            self._begin_absence(frame)
        elif not (self._open or self._absences) or frame.index > self._last_keyframe:
            self.known_until = frame.index + 1

    def add(self, frame: RecordedFrame, image: _Image) -> str:
        """Track into a frame; return why it cannot be used, or an empty text."""
        if frame.index in self.track.keyframes:
            box = self.track.keyframes[frame.index]
            if box is None:
                self._begin_absence(frame)
            else:
                self._meet(frame, image, box)
            return ""
        if self._forward.started:
            last_stamp = next(reversed(self._open.values()))[0]
            try:
                estimate = self._forward.update(image, _seconds(last_stamp, frame.stamp))
            except (ValueError, cv2.error) as error:
                self.skip(frame, str(error))
                return str(error)
            current = frame.stamp, _reduced(estimate)
            self._open[frame.index] = current
            if frame.index > self._last_keyframe:
                self.settle_forward()
                self._open = {frame.index: current}
                self.known_until = frame.index + 1
            return ""
        if self._absent is not None:
            self._add_absent(frame, self._absent)
        else:
            self.known_until = frame.index + 1
        return ""

    def _begin_absence(self, frame: RecordedFrame) -> None:
        """Complete the forward pass before a keyframe where the target is absent."""
        self.settle_forward()
        self._forward.stop()
        # The first keyframe has a box.
        assert self._absent is not None
        self._add_absent(frame, self._absent)

    def _meet(self, frame: RecordedFrame, image: _Image, box: Box) -> None:
        """Complete the passes at a keyframe with a box, and start the next one."""
        try:
            if self._open:
                self._settle_both(frame, image, box)
            self._check_absences(frame, image, box)
            start = _reduced(self._forward.start(image, box))
        except (ValueError, cv2.error) as error:
            raise self._refusal(frame.index, str(error)) from error
        start = _moved(start, box)
        self._absent = _moved(start, box, state="lost", confidence=0.0)
        self._moments[frame.index] = _Moment(start)
        self._open = {frame.index: (frame.stamp, start)}
        self.known_until = frame.index + (frame.index >= self._last_keyframe)

    def _add_absent(self, frame: RecordedFrame, estimate: Estimate) -> None:
        """Add a frame of an absence."""
        self._moments[frame.index] = _Moment(estimate)
        if frame.index >= self._last_keyframe:
            self.known_until = frame.index + 1
            return
        self._absences[frame.index] = frame.stamp
        if len(self._absences) > _LOOK_BACK:
            del self._absences[min(self._absences)]
        self.known_until = min(self._absences)

    def _check_absences(self, frame: RecordedFrame, image: _Image, box: Box) -> None:
        """Track back from the keyframe that ends an absence, while the target is visible."""
        if self._absences:
            self._backward.start(image, box)
        last_stamp = frame.stamp
        for earlier in sorted(self._absences, reverse=True):
            stored, stamp = self._images.find(earlier), self._absences[earlier]
            if stored is None or not _have_same_format(stored, image):
                break
            estimate = self._backward.update(stored, _seconds(stamp, last_stamp))
            last_stamp = stamp
            if estimate.state != "tracking" or estimate.confidence < CHECK_SINGLE_BELOW:
                break
            reason = f"given as absent, but tracked back from frame {frame.index}"
            if earlier not in self.track.keyframes:
                self._moments[earlier].to_check = reason
        self._absences = {}

    def _settle_both(self, frame: RecordedFrame, image: _Image, box: Box) -> None:
        """Complete the forward pass at a keyframe, track back from there, and join both."""
        first = self._images.find(next(iter(self._open)))
        assert first is not None
        if not _have_same_format(first, image):
            # Neither pass gets from one image size to the other.
            self.settle_forward()
            return
        last_stamp = next(reversed(self._open.values()))[0]
        arrival = self._forward.update(image, _seconds(last_stamp, frame.stamp))
        self._open[frame.index] = frame.stamp, _reduced(arrival)
        frames = list(self._open)
        forward = [estimate for _, estimate in self._open.values()]
        backward = [_reduced(self._backward.start(image, box))]
        for later, earlier in pairwise(reversed(frames)):
            seconds = _seconds(self._open[earlier][0], self._open[later][0])
            stored = self._images.find(earlier)
            assert stored is not None
            backward.append(_reduced(self._backward.update(stored, seconds)))
        backward.reverse()
        joined = join(_pass(forward), _pass(backward))
        for number in range(1, len(frames) - 1):
            confidence, overlap = float(joined.confidences[number]), joined.overlaps[number]
            nearer = forward if 2 * number < len(frames) else backward
            estimate = _moved(
                nearer[number],
                as_box(joined.boxes[number]),
                state=joined.states[number],
                confidence=confidence,
            )
            reason = f"overlap of both passes {overlap:.2f}, confidence {confidence:.2f}"
            is_sure = confidence >= CHECK_JOINED_BELOW
            self._moments[frames[number]] = _Moment(estimate, "" if is_sure else reason)
        self._open = {}

    def settle_forward(self) -> None:
        """Take the forward pass alone since its keyframe."""
        for frame, (_, estimate) in self._open.items():
            if frame < self.known_until or frame in self.track.keyframes:
                continue
            reason = f"one pass only, confidence {estimate.confidence:.2f}"
            is_sure = estimate.confidence >= CHECK_SINGLE_BELOW
            self._moments[frame] = _Moment(estimate, "" if is_sure else reason)
        self._open = {}

    def _refusal(self, frame: int, reason: str) -> RecordingError:
        return RecordingError(
            f"{self.track.source}, keyframe of target {self.track.id} in frame {frame}, counted "
            f"from 0: {reason}",
            WRONG_TARGET,
        )


def _have_same_format(one: _Image, other: _Image) -> bool:
    return one.shape == other.shape and one.dtype == other.dtype


def _seconds(earlier: int, later: int) -> float:
    return max(later - earlier, 0) / NANOSECONDS


def _pass(estimates: Sequence[Estimate]) -> Pass:
    return Pass(
        np.array([estimate.box for estimate in estimates]),
        np.array([estimate.confidence for estimate in estimates]),
        [estimate.state for estimate in estimates],
    )


def _reduced(estimate: Estimate) -> Estimate:
    """An estimate whose particles are not kept: thousands of them would not fit into memory."""
    return _moved(estimate, estimate.box)


def _moved(estimate: Estimate, box: Box, **changes: Any) -> Estimate:
    particle = np.array([box])
    return replace(
        estimate,
        box=box,
        particles=particle,
        particle_boxes=particle,
        weights=np.ones(1),
        effective_sample_size=1.0,
        **changes,
    )
