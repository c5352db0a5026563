"""Which frame is shown, and with which results."""

from types import SimpleNamespace

import pytest

from pf_tracker_ros.node.console.frame_synchronizer import FrameSynchronizer

TRACKING = {"values": {"state": "tracking"}, "targets": [{"id": "1"}], "selected": "1"}
IDLE = {"values": {"state": "idle"}, "targets": [], "selected": ""}
BOXES = {"1": {"box": [1, 2, 3, 4], "color": "#ff8000"}}


class Synchronizer(FrameSynchronizer):
    """With a shorter way to add."""

    def add(self, stamp, image=None, now=0.0, **parts):
        """Add an image, if one is given, and then the parts of its result."""
        if image is not None:
            self.add_image(stamp, image, now)
        for part, content in parts.items():
            self.add_result(stamp, part, content, now)


@pytest.fixture
def synchronizer():
    """With a tracker that has just sent a status."""
    synchronizer = Synchronizer()
    synchronizer.add(1, status=IDLE)
    return synchronizer


def test_a_picture_waits_for_its_box(synchronizer):
    synchronizer.add(2, "picture")
    assert not synchronizer.choose(now=0.01)
    synchronizer.add(2, status=TRACKING, now=0.02)
    assert not synchronizer.choose(now=0.02)
    synchronizer.add(2, boxes=BOXES, now=0.03)
    assert synchronizer.choose(now=0.03)
    assert synchronizer.latest.stamp == 2
    assert synchronizer.latest.results == {"status": TRACKING, "boxes": BOXES}
    assert not synchronizer.choose(now=0.04)


def test_a_picture_of_targets_waits_for_particles_and_of_a_selected_one_for_its_likelihood(
    synchronizer,
):
    synchronizer.required_parts = {"particles", "likelihood"}
    synchronizer.add(1, "without a target")
    assert synchronizer.choose(now=0.0)
    for stamp, status in ((2, TRACKING | {"selected": ""}), (3, TRACKING)):
        synchronizer.add(stamp, "picture")
        for part, content in (("status", status), ("particles", []), ("boxes", BOXES)):
            assert not synchronizer.choose(now=0.0)
            synchronizer.add(stamp, **{part: content})
        assert synchronizer.choose(now=0.0) == (stamp == 2)
    synchronizer.add(3, likelihood={})
    assert synchronizer.choose(now=0.0)
    assert synchronizer.latest.results.keys() == {"status", "particles", "boxes", "likelihood"}


def test_the_newest_picture_with_results_is_shown_and_older_ones_are_dropped(synchronizer):
    for stamp in (2, 3, 4):
        synchronizer.add(stamp, f"picture {stamp}")
    for stamp in (3, 2):
        synchronizer.add(stamp, status=IDLE)
    assert synchronizer.choose(now=0.0)
    assert synchronizer.latest.image == "picture 3"
    assert not synchronizer.choose(now=0.0)


def test_a_picture_without_results_is_shown_after_a_timeout(synchronizer):
    synchronizer.add(2, "picture")
    assert not synchronizer.choose(now=0.2)
    assert synchronizer.choose(now=0.3)
    assert synchronizer.latest.results == {}


def test_the_timeout_grows_with_the_latency_of_the_tracker(synchronizer):
    for stamp in range(2, 10):
        now = 0.3 * stamp
        synchronizer.add(stamp, "picture", now)
        synchronizer.add(stamp, status=IDLE, now=now + 0.24)
        assert synchronizer.choose(now + 0.24)
    synchronizer.add(10, "picture", now=3.0)
    assert not synchronizer.choose(now=3.4)
    assert synchronizer.choose(now=3.5)


def test_without_a_tracker_pictures_are_shown_at_once():
    synchronizer = Synchronizer()
    synchronizer.add(1, "first")
    assert synchronizer.choose(now=0.0)
    synchronizer.add(2, status=IDLE)
    synchronizer.add(3, "second", now=5.0)
    assert synchronizer.choose(now=5.0)


def test_a_picture_of_a_recording_in_lockstep_waits_for_a_late_status():
    synchronizer = Synchronizer(status_timeout=5.0)
    synchronizer.add(1, "before the tracker")
    assert synchronizer.choose(now=0.0)
    synchronizer.add(1, status=IDLE)
    assert synchronizer.choose(now=0.0)
    # After a pause, on a busy machine.
    synchronizer.add(2, "picture", now=60.0)
    assert not synchronizer.choose(now=64.9)
    synchronizer.add(2, status=TRACKING, now=64.9)
    assert not synchronizer.choose(now=65.1)
    synchronizer.add(2, boxes=BOXES, now=65.1)
    assert synchronizer.choose(now=65.1)
    assert synchronizer.latest.results == {"status": TRACKING, "boxes": BOXES}
    for now in (66.0, 71.0):
        # The tracker has ended, so the recording sends the image again.
        synchronizer.add(3, "picture", now)
        assert not synchronizer.choose(now)
    assert synchronizer.choose(now=71.1)
    synchronizer.clear()
    synchronizer.add(1, "of another recording", now=72.0)
    assert synchronizer.choose(now=72.0)


def test_large_pictures_of_a_fast_camera_are_shown_though_a_part_never_comes(synchronizer):
    """They leave the buffer before the part's timeout."""
    synchronizer.required_parts = {"likelihood"}
    picture, interval, shown = SimpleNamespace(data=bytes(10**7)), 1 / 30, 0
    for number in range(1, 61):
        now = number * interval
        synchronizer.add(number, picture, now)
        shown += synchronizer.choose(now)
        if number > 4:
            synchronizer.add(number - 4, status=TRACKING, boxes=BOXES, now=now)
            shown += synchronizer.choose(now)
            assert number < 12 or synchronizer.latest.stamp >= number - 8
    assert shown > 50


def test_results_of_before_a_time_jump_back_are_not_reused(synchronizer):
    for now in (0.0, 0.1):
        for stamp in (2, 3):
            synchronizer.add(stamp, f"picture {stamp} at {now}", now)
            assert not synchronizer.choose(now)
            synchronizer.add(stamp, status=IDLE | {"at": now}, now=now)
            assert synchronizer.choose(now)
            assert synchronizer.latest.image == f"picture {stamp} at {now}"
            assert synchronizer.latest.results["status"]["at"] == now
    assert synchronizer.latest.number == 4


def test_a_second_result_of_the_same_frame_is_shown(synchronizer):
    """A frame that is played twice has two results; the second may precede its image."""
    synchronizer.add(2, "picture", status=IDLE)
    assert synchronizer.choose(now=0.0)
    for part, content in (("boxes", BOXES), ("status", TRACKING)):
        synchronizer.add(2, **{part: content}, now=0.1)
        synchronizer.choose(now=0.1)
    assert synchronizer.latest.image == "picture"
    assert synchronizer.latest.results == {"status": TRACKING, "boxes": BOXES}
    synchronizer.add(2, status=IDLE, now=0.2)
    assert synchronizer.choose(now=0.2)
    assert synchronizer.latest.results == {"status": IDLE}


def test_an_image_that_comes_after_its_results_keeps_them(synchronizer):
    for now in (0.0, 1.0):
        synchronizer.add(2, status=TRACKING, boxes=[1, 2, 3, now], now=now)
        synchronizer.choose(now)
        synchronizer.add(2, f"picture at {now}", now)
        synchronizer.choose(now)
        # In the second round the results come before the image.
        synchronizer.choose(now + 0.5)
        assert synchronizer.latest.image == f"picture at {now}"
        assert synchronizer.latest.results == {"status": TRACKING, "boxes": [1, 2, 3, now]}


def test_a_replayed_frame_has_no_box_of_its_first_result(synchronizer):
    synchronizer.add(2, "picture", status=TRACKING, boxes=BOXES)
    assert synchronizer.choose(now=0.0)
    synchronizer.add(2, status=TRACKING, now=1.0)
    assert not synchronizer.choose(now=1.0)
    synchronizer.add(2, boxes=[5, 6, 7, 8], now=1.0)
    assert synchronizer.choose(now=1.0)
    assert synchronizer.latest.results["boxes"] == [5, 6, 7, 8]


def test_a_late_part_is_shown_at_once(synchronizer):
    synchronizer.required_parts = {"particles"}
    synchronizer.add(2, "picture", status=TRACKING)
    assert synchronizer.choose(now=0.5)
    synchronizer.add(2, boxes=[], particles=[], now=0.6)
    assert synchronizer.choose(now=0.6)
    assert synchronizer.latest.results.keys() == {"status", "boxes", "particles"}


def test_a_late_part_hides_no_newer_picture(synchronizer):
    synchronizer.required_parts = {"particles"}
    synchronizer.add(2, "picture 2", status=TRACKING, boxes=BOXES, particles=[])
    assert synchronizer.choose(now=0.0)
    synchronizer.add(3, "picture 3", now=0.1)
    synchronizer.add(2, boxes={}, now=0.1)
    assert synchronizer.choose(now=0.1)
    assert synchronizer.latest.image == "picture 2"
    synchronizer.add(2, boxes={}, now=0.2)
    synchronizer.add(3, status=IDLE, now=0.2)
    assert synchronizer.choose(now=0.2)
    assert synchronizer.latest.image == "picture 3"
    assert not synchronizer.choose(now=0.3)


def test_the_results_of_a_fast_camera_may_come_many_frames_later(synchronizer):
    """At 120 Hz and a latency of 80 ms, ten images are newer than each result."""
    shown = []
    for number in range(120):
        now = number / 120
        synchronizer.add(2 + number, f"picture {number}", now)
        if number >= 10:
            synchronizer.add(2 + number - 10, status=IDLE, now=now)
        if synchronizer.choose(now):
            shown.append((synchronizer.latest.stamp, "status" in synchronizer.latest.results))
    assert shown == [(2 + number, True) for number in range(110)]


def test_waiting_images_and_results_are_limited(synchronizer):
    for stamp in range(1, 10_000):
        synchronizer.add(stamp, stamp)
        synchronizer.add(-stamp, boxes=None)
    assert len(synchronizer._images) <= 32
    assert len(synchronizer._results) <= 32
    # Of large ones, fewer.
    for stamp in range(1, 41):
        synchronizer.add(10_000 + stamp, SimpleNamespace(data=bytes(10_000_000)))
    assert list(synchronizer._images) == list(range(10_033, 10_041))


def test_another_recording_reuses_nothing_of_the_last_one(synchronizer):
    synchronizer.add(1, "picture")
    assert synchronizer.choose(now=0.0)
    before = synchronizer.latest.number
    synchronizer.add(2, "waiting")
    synchronizer.clear()
    assert synchronizer.latest is None
    assert not synchronizer.choose(now=9.0)
    # Its frames may have the same stamps; browsers see later numbers.
    synchronizer.add(1, "other", 9.0, status=IDLE)
    assert synchronizer.choose(now=9.0)
    assert (synchronizer.latest.image, synchronizer.latest.number) == ("other", before + 1)
