import contextlib
import hashlib
import threading
import time
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    SequenceFailure,
    evaluate_each,
    evaluate_sequence,
    evaluate_sequences,
    mean_scores,
    read_sequences,
)
from pf_tracker_ros.footage import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters

TARGET = (10.0, 10.0, 10.0, 10.0)
# Apart from TARGET, center 40 px away.
FAR = (50.0, 10.0, 10.0, 10.0)
# Overlaps TARGET by 1/3, center 5 px away.
OVERLAPPING = (15.0, 10.0, 10.0, 10.0)


class MemoryFootage:
    """Footage in memory."""

    name = "drawn"
    nominal_interval = 0.04

    def __init__(self, ground_truth, frame_count=None, stamps=None):
        self.ground_truth = None if ground_truth is None else np.array(ground_truth, float)
        self.frame_count = None
        self.images = [
            np.full((60, 80, 3), index, np.uint8)
            for index in range(frame_count or len(self.ground_truth))
        ]
        self.stamps = stamps or [40_000_000 * (index + 1) for index in range(len(self.images))]
        self.passes = 0

    def frames(self):
        self.passes += 1
        for stamp, image in zip(self.stamps, self.images, strict=True):
            yield Frame(image, stamp)


@dataclass
class PlainEstimate:
    box: tuple
    state: str = "tracking"


LOST = PlainEstimate(box=None, state="lost")


class ScriptedTracker:
    """Returns prepared estimates and records its inputs."""

    def __init__(self, *outputs):
        self.outputs = [
            output if isinstance(output, PlainEstimate) else PlainEstimate(output)
            for output in outputs
        ]
        self.given = []

    def start(self, image, box):
        self.given.append((int(image[0, 0, 0]), box))

    def update(self, image, dt):
        self.given.append((int(image[0, 0, 0]), dt))
        return self.outputs[len(self.given) - 2]


class BusyTracker:
    """Calls a function in each update."""

    def __init__(self, work):
        self.work = work

    def start(self, image, box):
        pass

    def update(self, image, dt):
        self.work()
        return PlainEstimate(TARGET)


def compute(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def scored(truth, *outputs):
    """The result of a tracker with these outputs."""
    return evaluate_sequence(MemoryFootage(truth), lambda seed: ScriptedTracker(*outputs), [0])


def test_the_first_frame_counts_with_the_given_box():
    result = scored([TARGET] * 4, FAR, FAR, OVERLAPPING)
    assert result.boxes[0].tolist() == [list(box) for box in (TARGET, FAR, FAR, OVERLAPPING)]
    # Overlaps 1, 0, 0, 1/3: above 20, 0, 0 and 7 (0 .. .3) of the 21 thresholds.
    assert result.scores.success_auc == pytest.approx((20 + 7) / 4 / 21)
    assert result.scores.precision_20px == 0.5
    assert result.scores.frames == 4


def test_lost_frame_keeps_the_last_box():
    result = scored([TARGET] * 6, LOST, OVERLAPPING, LOST, FAR, LOST)
    expected = [TARGET, TARGET, OVERLAPPING, OVERLAPPING, FAR, FAR]
    assert result.boxes[0].tolist() == [list(box) for box in expected]
    assert result.lost[0].tolist() == [False, True, False, True, False, True]


def test_every_tracker_sees_every_frame_once_in_one_pass():
    footage = MemoryFootage([TARGET] * 3, stamps=[5_000_000_000, 5_040_000_000, 5_140_000_000])
    trackers = {}

    def make_tracker(seed):
        return trackers.setdefault(seed, ScriptedTracker(TARGET, TARGET))

    evaluate_sequence(footage, make_tracker, seeds=[3, 8])
    assert footage.passes == 1
    assert set(trackers) == {3, 8}
    for tracker in trackers.values():
        assert [image for image, _ in tracker.given] == [0, 1, 2]
        assert tracker.given[0][1] == TARGET
        assert [dt for _, dt in tracker.given[1:]] == pytest.approx([0.04, 0.1])


def test_scores_are_means_over_the_seeds():
    outputs = {0: (TARGET, TARGET, TARGET), 1: (FAR, FAR, FAR)}
    result = evaluate_sequence(
        MemoryFootage([TARGET] * 4), lambda seed: ScriptedTracker(*outputs[seed]), seeds=range(2)
    )
    aucs = [20 / 21, 20 / 21 / 4]
    assert result.success_aucs == pytest.approx(aucs)
    assert result.scores.success_auc == pytest.approx(sum(aucs) / 2)
    assert result.scores.precision_20px == pytest.approx((1 + 0.25) / 2)
    assert result.success_curve == pytest.approx([0.625] * 20 + [0])
    assert result.success_auc_std == pytest.approx(abs(aucs[0] - aucs[1]) / 2**0.5)


def test_frames_without_true_box_are_tracked_but_not_scored():
    ground_truth = [TARGET, (np.nan,) * 4, (0, 0, 0, 0), TARGET]
    tracker = ScriptedTracker(FAR, FAR, OVERLAPPING)
    result = evaluate_sequence(MemoryFootage(ground_truth), lambda seed: tracker, [0])
    assert len(tracker.given) == 4
    assert result.scores.success_auc == pytest.approx((20 + 7) / 2 / 21)
    assert result.scores.precision_20px == 1
    assert result.scores.frames == 4


def test_means_weigh_long_and_short_sequences_alike():
    mean = mean_scores([scored([TARGET] * 2, TARGET), scored([TARGET] * 8, *[FAR] * 7)])
    assert mean.success_auc == pytest.approx((20 / 21 + 20 / 21 / 8) / 2)
    assert mean.precision_20px == pytest.approx((1 + 1 / 8) / 2)
    assert mean.frames == 5


def test_only_cpu_time_of_update_is_counted():
    class SlowToRead(MemoryFootage):
        def frames(self):
            for frame in super().frames():
                compute(0.015)
                yield frame

    spent = []

    def work():
        before = time.process_time()
        compute(0.004)
        time.sleep(0.01)
        spent.append(time.process_time() - before)

    result = evaluate_sequence(
        SlowToRead([TARGET] * 8), lambda seed: BusyTracker(work), seeds=[0, 1]
    )
    # The trackers of all seeds process a frame before the next is read.
    expected = np.reshape(spent, (7, 2)).T
    # Reading would add more than twice the work.
    assert np.median(result.cpu_seconds / expected) < 2.0
    assert (result.cpu_seconds >= expected).all()


def test_threads_of_the_tracker_are_counted():
    def work():
        thread = threading.Thread(target=compute, args=(0.004,))
        thread.start()
        thread.join()

    result = evaluate_sequence(MemoryFootage([TARGET] * 6), lambda seed: BusyTracker(work), [0])
    assert result.scores.cpu_ms_median >= 4.0


def test_background_work_of_the_decoder_is_not_counted():
    class ReadAhead(MemoryFootage):
        def frames(self):
            block = bytes(4_000_000)
            for frame in super().frames():
                # Some 10 ms without the interpreter's lock, like a video decoder's thread.
                threading.Thread(target=hashlib.md5, args=(block,)).start()
                yield frame

    started = time.process_time()
    result = evaluate_sequence(
        ReadAhead([TARGET] * 16), lambda seed: BusyTracker(lambda: time.sleep(0.003)), [0]
    )
    background = (time.process_time() - started) / 16
    assert background > 0.002
    assert result.scores.cpu_ms_median < 1e3 * background / 4


@pytest.mark.parametrize("ending", [contextlib.nullcontext(), pytest.raises(RuntimeError)])
def test_opencv_has_one_thread_only_while_tracking(ending):
    seen = []

    def work():
        seen.append(cv2.getNumThreads())
        if not isinstance(ending, contextlib.nullcontext):
            raise RuntimeError

    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        with ending:
            evaluate_sequence(MemoryFootage([TARGET] * 2), lambda seed: BusyTracker(work), [0])
        assert seen == [1]
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_tracker_cannot_draw_into_the_frames_of_the_others():
    class DrawingTracker(ScriptedTracker):
        def update(self, image, dt):
            image[:] = 255
            return super().update(image, dt)

    footage = MemoryFootage([TARGET] * 2)
    with pytest.raises(EvaluationError, match="read-only"):
        evaluate_sequence(footage, lambda seed: DrawingTracker(TARGET), [0])
    assert footage.images[1].flags.writeable


@pytest.mark.parametrize(
    ("footage", "message"),
    [
        (MemoryFootage([TARGET] * 3, frame_count=2), "drawn: 2 frames, but 3 true boxes"),
        (MemoryFootage([TARGET] * 3, frame_count=4), "drawn: more than 3 frames, but 3 true boxes"),
        (MemoryFootage(None, frame_count=2), "drawn: no ground truth"),
        (MemoryFootage([TARGET]), "at least 2 frames"),
        (MemoryFootage([TARGET[:3]] * 2), r"shape \(2, 3\)"),
        (MemoryFootage([(0, 0, 0, 0), TARGET]), "absent in the first frame.*; allowed: .* above 0"),
        (MemoryFootage([(np.nan,) * 4, TARGET]), "absent in the first frame.*; allowed: finite"),
    ],
)
def test_unusable_ground_truth_is_refused(footage, message):
    with pytest.raises(EvaluationError, match=message):
        evaluate_sequence(footage, lambda seed: ScriptedTracker(*[TARGET] * 9), [0])


def test_the_request_is_checked_before_tracking():
    footage = MemoryFootage([TARGET] * 3)
    with pytest.raises(EvaluationError, match="at least one"):
        evaluate_sequence(footage, lambda seed: ScriptedTracker(TARGET), [])
    footage.frame_count = 5
    with pytest.raises(EvaluationError, match="5 frames, but 3 true boxes"):
        evaluate_sequence(footage, lambda seed: ScriptedTracker(*[TARGET] * 9), [0])
    assert footage.passes == 0


@pytest.mark.parametrize("box", [(np.nan, 0, 1, 1), (0, 0, np.inf, 1), (0, 0, 1)])
def test_an_invalid_box_is_refused_with_its_frame(box):
    with pytest.raises(EvaluationError, match=r"drawn, frame 3: .*4 finite numbers"):
        scored([TARGET] * 3, TARGET, box)


@pytest.fixture
def two_sequences(write_sequence, moving_square):
    images, boxes = moving_square.images, moving_square.boxes
    return read_sequences(
        [write_sequence("whole", images, boxes), write_sequence("half", images[:10], boxes[:10])]
    )


def test_a_seed_gives_the_same_bits_alone_and_beside_others(two_sequences):
    make_tracker = partial(Tracker.from_preset, "li2007")
    both = evaluate_sequence(two_sequences[0], make_tracker, [0, 1])
    alone = evaluate_sequence(two_sequences[0], make_tracker, [1])
    assert np.array_equal(both.boxes[1], alone.boxes[0])
    assert np.array_equal(both.lost[1], alone.lost[0])
    assert not np.array_equal(both.boxes[0], both.boxes[1])


def test_boxes_are_those_of_a_session_to_the_bit(moving_square):
    # Stamps with a jitter of up to 1 ms: intervals with many digits.
    late = np.random.default_rng(5).integers(0, 1_000_000, len(moving_square.images))
    stamps = (1_700_000_000 * 10**9 + 33_333_333 * np.arange(len(late)) + late).tolist()
    footage = MemoryFootage(moving_square.boxes, stamps=stamps)
    footage.images = moving_square.images
    result = evaluate_sequence(footage, partial(Tracker.from_preset, "default"), [4])

    session = Session(preset_parameters("default"), seed=4)
    session.request(tuple(moving_square.boxes[0]), stamps[0])
    outcomes = [session.process(frame) for frame in footage.frames()]
    assert [outcome.frame for outcome in outcomes] == ["started"] + ["tracked"] * (len(stamps) - 1)
    assert not result.lost.any()
    boxes = np.array([outcome.estimate.box for outcome in outcomes])
    np.testing.assert_array_equal(result.boxes[0], boxes)


def test_processes_give_the_same_boxes_as_one(two_sequences):
    make_tracker = partial(Tracker.from_preset, "li2007")
    progress, of_each = [], []
    one = evaluate_sequences(
        two_sequences, make_tracker, [0], on_progress=lambda *done: of_each.append(done)
    )
    assert of_each == [("whole", 1)] * 20 + [("half", 1)] * 10
    two = evaluate_sequences(
        two_sequences, make_tracker, [0], jobs=2, on_progress=lambda *done: progress.append(done)
    )
    assert [result.name for result in two] == ["whole", "half"]
    assert sorted(progress) == [("half", 10), ("whole", 20)]
    for first, second in zip(one, two, strict=True):
        assert np.array_equal(first.boxes, second.boxes)


@pytest.mark.parametrize("jobs", [1, 2])
def test_other_sequences_are_evaluated_after_a_failure(two_sequences, jobs):
    two_sequences[0].ground_truth[0] = (500, 500, 10, 10)
    make_tracker = partial(Tracker.from_preset, "li2007")
    results = dict(evaluate_each(two_sequences, make_tracker, [0], jobs))
    assert isinstance(results[0], SequenceFailure)
    assert "whole, frame 1: " in str(results[0].error)
    (alone,) = evaluate_sequences(two_sequences[1:], make_tracker, [0])
    assert np.array_equal(results[1].boxes, alone.boxes)
    # Without the other results, the error reaches the caller.
    with pytest.raises(EvaluationError, match=r"whole, frame 1: .*outside the image"):
        evaluate_sequences(two_sequences, make_tracker, [0], jobs)
