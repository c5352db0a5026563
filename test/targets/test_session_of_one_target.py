"""The session with a single target, compared with the library."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import LATE_WITHIN
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.target_filter import TargetFilter

SECOND = 1_000_000_000
START = 1_000 * SECOND
PARAMETERS = preset_parameters("li2007") | {"particles": 20}


@pytest.fixture
def images(moving_square):
    return moving_square.images


@pytest.fixture
def box(moving_square):
    return tuple(moving_square.boxes[0])


@pytest.fixture
def session():
    return Session(PARAMETERS, seed=3)


@pytest.fixture
def started(session, images, box):
    session.request(box)
    assert session.process(Frame(images[0], START)).frame == "started"
    return session


def library(images, box, intervals):
    """Estimates of the library alone, fed with the images after the first."""
    tracker = Tracker.from_preset("li2007", seed=3, parameters={"particles": 20})
    tracker.start(images[0], box)
    pairs = zip(images[1:], intervals, strict=True)
    return [tracker.update(image, interval) for image, interval in pairs]


def same(first, second):
    return first.box == second.box and np.array_equal(first.particles, second.particles)


def test_frames_without_stamps_are_tracked_at_the_nominal_interval(session, images, box):
    session.request(box)
    outcomes = [session.process(Frame(image, 0)) for image in images[:4]]
    assert [outcome.frame for outcome in outcomes] == ["started", *["tracked"] * 3]
    assert same(outcomes[-1].estimate, library(images[:4], box, [None] * 3)[-1])


def test_a_duplicate_frame_is_not_tracked_again(started, images, box):
    first = started.process(Frame(images[1], START + SECOND))
    again = started.process(Frame(images[2], START + SECOND))
    assert again.frame == "duplicate"
    assert again.estimate is first.estimate
    after = started.process(Frame(images[3], START + 2 * SECOND))
    assert same(after.estimate, library(images[[0, 1, 3]], box, [1.0, 1.0])[-1])


def test_a_late_frame_is_dropped_and_does_not_move_the_clock(started, images, box):
    late = started.process(Frame(images[5], START - LATE_WITHIN))
    assert (late.frame, late.estimate.box) == ("late", box)
    after = started.process(Frame(images[1], START + 40_000_000))
    assert same(after.estimate, library(images[:2], box, [0.04])[0])


@pytest.mark.parametrize(
    ("stamps", "intervals"),
    [
        ([20_000_000, 100_000_000, 5 * SECOND], [0.02, 0.08, 4.9]),
        ([-START, SECOND, 2 * SECOND], [None, None, 1.0]),
        ([-LATE_WITHIN - 1, -LATE_WITHIN // 2 - 1, -1], [None, 0.5, 0.5]),
    ],
    ids=["stamped", "one without a stamp", "a jump back"],
)
def test_the_interval_is_the_difference_of_the_stamps_or_the_nominal_one(
    started, images, box, stamps, intervals
):
    outcomes = [
        started.process(Frame(image, START + stamp))
        for image, stamp in zip(images[1:4], stamps, strict=True)
    ]
    assert {outcome.frame for outcome in outcomes} == {"tracked"}
    for outcome, expected in zip(outcomes, library(images[:4], box, intervals), strict=True):
        assert same(outcome.estimate, expected)


def test_a_cancelled_request_does_not_start(session, images, box):
    session.request(box)
    session.cancel_requests()
    assert session.requested_stamp is None
    assert session.process(Frame(images[0], START)).frame == "waiting"


def test_a_frame_is_classified_by_its_stamp_alone(started, images):
    """So dropped images need no decoding; a duplicate is processed if a target starts on it."""
    stamp = START + SECOND
    assert started.classify(stamp) == "next"
    estimate = started.process(Frame(images[1], stamp), "next").estimate
    for arrival, other in (("duplicate", stamp), ("late", stamp - SECOND // 2)):
        assert started.classify(other) == arrival
        dropped = started.drop(arrival)
        assert (dropped.frame, dropped.estimate) == (arrival, estimate)
        assert (dropped.started, dropped.refused, dropped.jumped_back) == ((), (), 0.0)
    started.request((0.0, 0.0, 30.0, 30.0))
    assert started.classify(stamp) == "again"
    outcome = started.process(Frame(images[1], stamp), "again")
    assert (outcome.frame, outcome.estimate.box) == ("started", (0.0, 0.0, 30.0, 30.0))
    assert started.classify(stamp - 5 * SECOND) == "jump"
    assert started.process(Frame(images[2], stamp - 5 * SECOND), "jump").jumped_back == 5.0


def test_a_refusal_is_reported_with_the_next_valid_frame(started, images):
    started.request((1000.0, 0.0, 10.0, 10.0))
    with pytest.raises(ValueError, match="image is"):
        started.process(Frame(images[1][:40], START + 40_000_000))
    assert started.requested_stamp == 0
    outcome = started.process(Frame(images[1], START + 80_000_000))
    assert outcome.frame == "tracked"
    assert "the center of box (1000, 0, 10, 10) is outside" in outcome.refused[0]
    assert started.process(Frame(images[2], START + 120_000_000)).refused == ()


def test_a_new_seed_takes_effect_with_the_next_target(started, images, box):
    started.configure(PARAMETERS, seed=4)
    same_seed = started.process(Frame(images[1], START + SECOND))
    assert same(same_seed.estimate, library(images[:2], box, [1.0])[0])
    started.request(box)
    started.process(Frame(images[0], START + 2 * SECOND))
    other_seed = started.process(Frame(images[1], START + 3 * SECOND))
    assert not same(other_seed.estimate, same_seed.estimate)


# Time that jumps back


def jumped(images, box, policy, late_within=SECOND):
    session = Session(PARAMETERS, seed=3)
    session.time_policy = TimePolicy(policy, late_within)
    session.request(box)
    session.process(Frame(images[0], START))
    session.process(Frame(images[1], START + 40_000_000))
    return session, session.process(Frame(images[2], START - 5 * SECOND))


def test_the_threshold_decides_between_late_and_jumped(images, box):
    assert jumped(images, box, "wait", 6 * SECOND)[1].frame == "late"
    assert jumped(images, box, "wait", 5 * SECOND)[1].frame == "waiting"


def test_a_restart_on_an_image_that_the_box_does_not_fit_waits(images, box):
    session, _ = jumped(images, box, "restart")
    outcome = session.process(Frame(images[0][:20, :20], START - 20 * SECOND))
    assert (outcome.frame, outcome.estimate) == ("waiting", None)
    assert "larger than the image" in outcome.refused[0]


def test_a_looped_recording_shorter_than_the_threshold_is_tracked(started, images):
    for index in range(1, 20):
        started.process(Frame(images[index], START + index * 40_000_000))
    frames = [started.process(Frame(images[i], START + i * 40_000_000)).frame for i in range(12)]
    assert frames == ["late"] * 9 + ["tracked"] * 3


# Targets on past frames


@pytest.fixture
def watching(session, images):
    """A session without a target after ten frames, 40 ms apart."""
    session.frame_buffer.limit(frames=8, megabytes=10.0)
    for index in range(10):
        session.process(Frame(images[index], START + index * 40_000_000))
    return session


def test_a_target_on_a_past_frame_is_caught_up(watching, images, box, moving_square):
    drawn = tuple(moving_square.boxes[6])
    watching.request(drawn, START + 6 * 40_000_000)
    outcome = watching.process(Frame(images[10], START + 10 * 40_000_000))
    assert (outcome.frame, outcome.caught_up) == ("started", 4)
    assert same(outcome.estimate, library(images[6:11], drawn, [0.04] * 4)[-1])
    after = watching.process(Frame(images[11], START + 11 * 40_000_000))
    assert same(after.estimate, library(images[6:12], drawn, [0.04] * 5)[-1])


def test_a_target_on_a_frame_beyond_the_buffer_is_refused(watching, images, box):
    watching.request(box, START + 40_000_000)
    outcome = watching.process(Frame(images[10], START + 10 * 40_000_000))
    assert (outcome.frame, outcome.estimate) == ("waiting", None)
    assert "0.080 s older than the oldest one in the buffer" in outcome.refused[0]
    assert "the last 8 frames" in outcome.refused[0]
    assert "frame_buffer_length" in outcome.refused[0]
    assert "back to 0.280 s ago" in outcome.refused[0]


def test_a_target_is_caught_up_through_a_bounded_number_of_frames(session, images, box):
    """Each costs an update."""
    session.frame_buffer.limit(frames=200, megabytes=1000.0)
    for index in range(100):
        session.process(Frame(images[0], START + index * 10_000_000))
    session.request(box, START)
    outcome = session.process(Frame(images[0], START + 100 * 10_000_000))
    assert (outcome.frame, outcome.caught_up) == ("started", 30)
    assert outcome.targets[0].age == pytest.approx(1.0)


def test_a_target_from_long_before_the_first_frame_is_refused(session, images, box):
    """The refusal waits for a frame, since a looped recording may restart."""
    session.request(box, START)
    outcome = session.process(Frame(images[0], START + SECOND + 1))
    assert (outcome.frame, outcome.refused) == ("waiting", ())
    outcome = session.process(Frame(images[0], START + SECOND + 40_000_000))
    assert outcome.frame == "waiting"
    assert "1.040 s older than the oldest one in the buffer" in outcome.refused[0]


def test_a_request_at_the_end_of_a_pass_waits_for_the_next_pass(started, images, box):
    """As when the tracker is a frame behind a looped replay."""
    started.frame_buffer.limit(frames=8, megabytes=10.0)
    stamps = [START + index * 100_000_000 for index in range(len(images))]
    for image, stamp in zip(images[1:-1], stamps[1:-1], strict=True):
        started.process(Frame(image, stamp))
    started.request(box, START)
    outcome = started.process(Frame(images[-1], stamps[-1]))
    assert (outcome.frame, outcome.refused) == ("tracked", ())
    outcome = started.process(Frame(images[0], START))
    assert (outcome.frame, outcome.refused) == ("started", ())
    assert outcome.estimate.box == pytest.approx(box)


def test_a_request_with_a_stamp_of_another_clock_is_refused(watching, box):
    with pytest.raises(ValueError, match=r"is 3600 s after that of the last frame"):
        watching.request(box, START + 9 * 40_000_000 + 3600 * SECOND)
    assert watching.requested_stamp is None


def test_a_stopped_session_waits_for_the_next_target(started, images, box):
    started.request(box, START + SECOND)
    started.stop()
    assert started.estimate is None
    assert started.process(Frame(images[1], START + SECOND)).frame == "waiting"
    started.request(box)
    assert started.process(Frame(images[1], START + 2 * SECOND)).frame == "started"


# Parameters that require relearning


@pytest.mark.parametrize(
    "estimated", [(-30.0, 20.0, 220.0, 50.0), (150.0, 118.0, 40.0, 40.0), (20.0, 20.0, 0.5, 300.0)]
)
def test_a_target_larger_than_the_image_can_be_relearned(started, images, estimated):
    # The motion model bounds an estimate; the image also bounds a new target.
    last_seen = started._manager._last_seen
    for key, seen in last_seen.items():
        last_seen[key] = seen._replace(box=estimated)
    started.configure(preset_parameters("zhang2015"), seed=0)
    assert started.process(Frame(images[0], START + SECOND)).frame == "tracked"


def test_a_check_changes_nothing(started, images, box):
    started.check(preset_parameters("default"), 9)
    after = started.process(Frame(images[1], START + 40_000_000))
    assert same(after.estimate, library(images[:2], box, [0.04])[0])


def test_a_loop_without_its_first_frame_starts_the_target_on_the_second(session, images, box):
    # Longer than the buffer, so that frames of the first pass have been dropped.
    session.frame_buffer.limit(4, 64.0)
    stamps = [START + index * 40_000_000 for index in range(60)]
    session.request(box, stamps[0])
    for index, stamp in enumerate(stamps):
        session.process(Frame(images[index % 4], stamp))
    session.request(box, stamps[0])
    outcome = session.process(Frame(images[1], stamps[1]))
    assert (outcome.frame, outcome.refused) == ("started", ())
    assert outcome.estimate.box == box


# Checked and adopted parameters


@pytest.fixture
def built(monkeypatch):
    """The target filters that have been built."""
    filters, init = [], TargetFilter.__init__

    def counting(target_filter, parameters):
        filters.append(target_filter)
        init(target_filter, parameters)

    monkeypatch.setattr(TargetFilter, "__init__", counting)
    return filters


@pytest.mark.parametrize("changes", [{"motion.position_noise": 3.0}, {"working_size": 60}, {}])
def test_a_checked_change_is_built_once(started, images, box, built, changes):
    started.check(PARAMETERS | changes, 3)
    started.configure(PARAMETERS | changes, 3)
    assert len(built) == 1
    estimate = started.process(Frame(images[1], START + 40_000_000)).estimate
    tracker = Tracker.from_preset("li2007", seed=3, parameters={"particles": 20})
    tracker.start(images[0], box)
    tracker.set_parameters(changes)
    assert estimate == tracker.update(images[1], 0.04)


def test_a_check_is_outdated_by_a_frame_or_a_stop(started, images, box):
    after = PARAMETERS | {"working_size": 60}
    started.check(after, 3)
    started.process(Frame(images[1], START + 40_000_000))
    started.configure(after, 3)
    estimate = started.process(Frame(images[2], START + 80_000_000)).estimate
    tracker = Tracker.from_preset("li2007", seed=3, parameters={"particles": 20})
    tracker.start(images[0], box)
    tracker.update(images[1], 0.04)
    tracker.set_parameters({"working_size": 60})
    assert estimate == tracker.update(images[2], 0.04)
    started.check(PARAMETERS, 3)
    started.stop()
    started.configure(PARAMETERS, 3)
    assert started.process(Frame(images[3], START + SECOND)).frame == "waiting"


@pytest.mark.parametrize("state", ["occluded", "lost"])
def test_a_relearned_target_keeps_its_state_until_a_frame_shows_it(session, images, box, state):
    black = np.zeros_like(images[0])
    session.configure(PARAMETERS | {"track.lost_after": 0.1}, seed=3)
    session.request(box)
    session.process(Frame(images[0], START))
    count = 1 if state == "occluded" else 4
    for index in range(1, count + 1):
        estimate = session.process(Frame(black, START + index * 40_000_000)).estimate
    assert estimate.state == state
    # With these, next to any confidence is enough, and only a target that was lost stays lost.
    after = preset_parameters("zhang2015")
    after |= {"track.lost_after": 3600.0, "track.wrong_box_cost": 0.05}
    session.configure(after, seed=3)
    assert session.estimate.state == state
    unseen = session.process(Frame(black, START + (count + 1) * 40_000_000)).estimate
    assert unseen.state == state
    assert state == "occluded" or unseen.confidence == 0.0
    shown = session.process(Frame(images[0], START + (count + 2) * 40_000_000)).estimate
    assert shown.state == "tracking"


def test_relearning_from_an_earlier_frame_does_not_move_the_clock(started, images):
    black = np.zeros_like(images[0])
    assert started.process(Frame(black, START + 40_000_000)).estimate.state == "occluded"
    started.configure(preset_parameters("zhang2015"), seed=3)
    assert started.process(Frame(black, START + 40_000_000)).frame == "duplicate"


# Images of another size


def in_size(image, size):
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def test_targets_are_tracked_in_16_bit_images_of_another_size(images, box, moving_square):
    session = Session(PARAMETERS, seed=3)
    session.request(box)
    gray = (images.mean(axis=3) * 250).astype(np.uint16)
    session.process(Frame(gray[0], START))
    outcome = session.process(Frame(in_size(gray[1], (320, 240)), START + 40_000_000))
    assert outcome.frame == "tracked"
    assert outcome.estimate.box[:2] == pytest.approx(2 * moving_square.boxes[1][:2], abs=12)


REFUSED = {
    "another aspect ratio": lambda image: image[:100],
    "too small for the target": lambda image: in_size(image, (4, 3)),
    "another type": lambda image: in_size(image, (80, 60))[..., 0],
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_image_that_cannot_be_scaled_to_is_refused_and_the_target_kept(
    started, images, box, case
):
    with pytest.raises(ValueError, match="but the targets are tracked in images of"):
        started.process(Frame(np.ascontiguousarray(REFUSED[case](images[1])), START + 20_000_000))
    after = started.process(Frame(images[1], START + 40_000_000))
    assert same(after.estimate, library(images[:2], box, [0.04])[0])


def test_a_restart_scales_the_first_box_to_the_size_of_its_frame(images, box):
    session, _ = jumped(images, box, "restart")
    outcome = session.process(Frame(in_size(images[0], (320, 240)), START - 20 * SECOND))
    assert outcome.frame == "started"
    assert outcome.estimate.box == tuple(2 * value for value in box)
