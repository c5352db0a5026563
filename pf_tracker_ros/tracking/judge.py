"""Whether the target is seen; if not, what is told of it, or where it is found again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pf_tracker_ros.boxes import are_at, as_box, sides_apart
from pf_tracker_ros.tracking.estimate import Track, TrackThresholds
from pf_tracker_ros.tracking.hiding import WhileHidden
from pf_tracker_ros.tracking.judgment import Confidence, Judgment
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.redetection import Found, Redetector
from pf_tracker_ros.tracking.steering import Beginning
from pf_tracker_ros.tracking.target import Target

# Confidence that a frame alone must give for anything to be learned of it, however the cues' own
# similarity is.
_LEARN_ABOVE = 0.01


class Judge:
    """Makes the judgment of a frame out of its measurement.

    Args:
        confidence: How sure it is that the target is in the box.
        while_hidden: What is done with a target that is not seen.
        redetector: Looks for it elsewhere; None where nobody does.
        beginning: Makes what a target begins anew with.
        thresholds: Between seen, hidden and lost.
    """

    def __init__(
        self,
        confidence: Confidence,
        while_hidden: WhileHidden,
        redetector: Redetector | None,
        beginning: Beginning,
        thresholds: TrackThresholds,
    ) -> None:
        self._confidence = confidence
        self._while_hidden = while_hidden
        self._redetector = redetector
        self._beginning = beginning
        self._thresholds = thresholds

    def judge(
        self,
        target: Target,
        measured: Measurement,
        interval: float,
        draw: np.random.Generator,
        *,
        searches_everywhere: bool = True,
    ) -> Judgment:
        """What is told of the target in a frame.

        Args:
            target: After the last frame.
            measured: In this one.
            interval: Seconds since the last one.
            draw: Source of randomness, for a target that begins anew.
            searches_everywhere: Whether it is looked for all over the image once it is lost.
        """
        thresholds = self._thresholds
        now = self._confidence.judge(target, measured.seen, measured.match, lambda: measured.spread)
        # While it looks as it did last, it is not lost, whatever it looked like first.
        glimpse = max(now, measured.match.similarity)
        look_alike = target.look_alike
        if now >= thresholds.occluded_below and _is_of_the_runner_up(target, measured):
            look_alike = as_box(measured.box)
        if look_alike is not None and are_at(measured.box, look_alike):
            # Whatever it looks like.
            now = glimpse = 0.0
        confidence = self._confidence.update(target.estimate.confidence, now)
        track = target.track.advance(confidence, glimpse, interval, thresholds)
        if self._redetector is None and track.probation:
            # Nobody looks for another.
            track = replace(track, probation=0.0)
        # The best place around may be like the target, and the box beside it.
        learns = self._redetector is None or now >= _LEARN_ABOVE
        judged = Judgment(
            measured.box, confidence, track, measured.particles, measured.boxes, learns
        )
        if track.is_settled:
            return judged
        is_seen, box = track.state == "tracking", None
        goes_now = target.track.state == "tracking" and not is_seen
        if self._redetector and look_alike is None and goes_now:
            look_alike = self._redetector.look_alike(target, measured)
        judged = replace(judged, look_alike=look_alike)
        if not is_seen:
            judged = self._while_hidden.judge(target, measured, judged)
            box = self._while_hidden.begin_anew(target, judged)
        if track.state != "occluded" or track.probation:
            # What looks like it elsewhere may be the target, what is followed something else.
            judged = replace(judged, learns=False)
        if not is_seen and now > thresholds.recovered_above:
            return judged
        found = None
        if self._redetector:
            everywhere = searches_everywhere and track.state != "occluded"
            rival = now if is_seen else 0.0
            found = self._redetector.find(target, measured, judged, everywhere, rival)
        if found is not None:
            box, judged = found.box, self._believe(found, judged)
        if box is None:
            return judged
        particles, boxes = self._beginning.spread_anew(target, box, measured.frame.size, draw)
        return replace(judged, box=box, particles=particles, boxes=boxes, learns=False)

    def _believe(self, found: Found, judged: Judgment) -> Judgment:
        """What is told once the target is found elsewhere.

        Where it went out of sight a moment ago it is that. After a longer time it may be something
        like it: then it counts as lost until more frames agree.
        """
        track = judged.track
        if track.state == "tracking":
            return replace(judged, confidence=0.0, track=track.lose(self._thresholds))
        if track.state == "occluded" and not track.probation:
            return replace(judged, confidence=found.confidence, track=Track())
        return judged


def _is_of_the_runner_up(target: Target, measured: Measurement) -> bool:
    """Whether the estimate has jumped to what was seen beside the target a frame before.

    Where it is not clear of where the target was, that may have moved so far.
    """
    return (
        target.track.state == "tracking"
        and target.runner_up is not None
        and bool(are_at(measured.box, target.runner_up))
        and bool(sides_apart(measured.box, target.estimate.box) >= 1.0)
    )
