"""Which frame is shown, and with what."""

from types import SimpleNamespace

import pytest

from pf_tracker_ros.node.console.frame_synchronizer import FrameSynchronizer

TRACKING = {"values": {"state": "tracking"}, "targets": [{"id": "1"}], "selected": "1"}
IDLE = {"values": {"state": "idle"}, "targets": [], "selected": ""}
BOXES = {"1": {"box": [1, 2, 3, 4], "color": "#ff8000"}}


@pytest.fixture
def pairing():
    """With a tracker that has answered just now."""
    pairing = FrameSynchronizer()
    pairing.add_result(1, "status", IDLE, now=0.0)
    return pairing


def test_a_picture_waits_for_its_box(pairing):
    pairing.add_image(2, "picture", now=0.0)
    assert not pairing.choose(now=0.01)
    pairing.add_result(2, "status", TRACKING, now=0.02)
    assert not pairing.choose(now=0.02)
    pairing.add_result(2, "boxes", BOXES, now=0.03)
    assert pairing.choose(now=0.03)
    assert pairing.latest.stamp == 2
    assert pairing.latest.answer == {"status": TRACKING, "boxes": BOXES}
    assert not pairing.choose(now=0.04)


def test_the_order_in_which_the_parts_come_does_not_matter(pairing):
    pairing.add_result(2, "boxes", BOXES, now=0.0)
    pairing.add_result(2, "status", TRACKING, now=0.0)
    pairing.add_image(2, "picture", now=0.0)
    assert pairing.choose(now=0.0)


def test_particles_are_waited_for_where_somebody_looks(pairing):
    pairing.required_parts = {"particles"}
    pairing.add_image(2, "picture", now=0.0)
    pairing.add_result(2, "status", TRACKING, now=0.0)
    pairing.add_result(2, "boxes", BOXES, now=0.0)
    assert not pairing.choose(now=0.0)
    pairing.add_result(2, "particles", [], now=0.0)
    assert pairing.choose(now=0.0)


def test_the_likelihood_is_waited_for_where_a_target_is_selected(pairing):
    pairing.required_parts = {"particles", "likelihood"}
    for stamp, status in ((2, TRACKING | {"selected": ""}), (3, TRACKING)):
        pairing.add_image(stamp, "picture", now=0.0)
        for part, content in (("status", status), ("particles", []), ("boxes", BOXES)):
            assert not pairing.choose(now=0.0)
            pairing.add_result(stamp, part, content, now=0.0)
        assert pairing.choose(now=0.0) == (stamp == 2)
    pairing.add_result(3, "likelihood", {}, now=0.0)
    assert pairing.choose(now=0.0)
    assert pairing.latest.answer.keys() == {"status", "particles", "boxes", "likelihood"}


def test_without_a_target_there_is_nothing_to_wait_for(pairing):
    pairing.required_parts = {"particles"}
    pairing.add_image(2, "picture", now=0.0)
    pairing.add_result(2, "status", IDLE, now=0.0)
    assert pairing.choose(now=0.0)


def test_the_newest_answered_picture_wins_and_older_ones_are_passed_over(pairing):
    for stamp in (2, 3, 4):
        pairing.add_image(stamp, f"picture {stamp}", now=0.0)
    for stamp in (3, 2):
        pairing.add_result(stamp, "status", IDLE, now=0.0)
    assert pairing.choose(now=0.0)
    assert pairing.latest.image == "picture 3"
    assert not pairing.choose(now=0.0)


def test_a_picture_without_an_answer_is_shown_in_the_end(pairing):
    pairing.add_image(2, "picture", now=0.0)
    assert not pairing.choose(now=0.2)
    assert pairing.choose(now=0.3)
    assert pairing.latest.answer == {}


def test_a_tracker_that_takes_long_is_waited_for_longer(pairing):
    for stamp in range(2, 10):
        now = 0.3 * stamp
        pairing.add_image(stamp, "picture", now)
        pairing.add_result(stamp, "status", IDLE, now + 0.24)
        assert pairing.choose(now + 0.24)
    pairing.add_image(10, "picture", now=3.0)
    assert not pairing.choose(now=3.4)
    assert pairing.choose(now=3.5)


def test_without_a_tracker_pictures_are_shown_at_once():
    pairing = FrameSynchronizer()
    pairing.add_image(1, "first", now=0.0)
    assert pairing.choose(now=0.0)
    pairing.add_result(2, "status", IDLE, now=0.0)
    pairing.add_image(3, "second", now=5.0)
    assert pairing.choose(now=5.0)


def test_where_time_goes_back_the_answers_of_before_do_not_count(pairing):
    for now in (0.0, 0.1):
        for stamp in (2, 3):
            pairing.add_image(stamp, f"picture {stamp} at {now}", now)
            assert not pairing.choose(now)
            pairing.add_result(stamp, "status", IDLE | {"at": now}, now)
            assert pairing.choose(now)
            assert pairing.latest.image == f"picture {stamp} at {now}"
            assert pairing.latest.answer["status"]["at"] == now
    assert pairing.latest.number == 4


def test_another_answer_to_the_same_frame_is_shown(pairing):
    """A frame that is played twice is answered twice, perhaps before the second has come."""
    pairing.add_image(2, "picture", now=0.0)
    pairing.add_result(2, "status", IDLE, now=0.0)
    assert pairing.choose(now=0.0)
    for part, content in (("boxes", BOXES), ("status", TRACKING)):
        pairing.add_result(2, part, content, now=0.1)
        pairing.choose(now=0.1)
    assert pairing.latest.image == "picture"
    assert pairing.latest.answer == {"status": TRACKING, "boxes": BOXES}
    pairing.add_result(2, "status", IDLE, now=0.2)
    assert pairing.choose(now=0.2)
    assert pairing.latest.answer == {"status": IDLE}


def test_an_image_that_comes_after_its_answer_keeps_it(pairing):
    for now in (0.0, 1.0):
        pairing.add_result(2, "status", TRACKING, now=now)
        pairing.add_result(2, "boxes", [1, 2, 3, now], now=now)
        pairing.choose(now)
        pairing.add_image(2, f"picture at {now}", now=now)
        pairing.choose(now)
        # Played again, it is answered before it comes.
        pairing.choose(now + 0.5)
        assert pairing.latest.image == f"picture at {now}"
        assert pairing.latest.answer == {"status": TRACKING, "boxes": [1, 2, 3, now]}


def test_a_frame_that_is_played_again_has_no_box_of_before(pairing):
    pairing.add_image(2, "picture", now=0.0)
    pairing.add_result(2, "status", TRACKING, now=0.0)
    pairing.add_result(2, "boxes", BOXES, now=0.0)
    assert pairing.choose(now=0.0)
    pairing.add_result(2, "status", TRACKING, now=1.0)
    assert not pairing.choose(now=1.0)
    pairing.add_result(2, "boxes", [5, 6, 7, 8], now=1.0)
    assert pairing.choose(now=1.0)
    assert pairing.latest.answer["boxes"] == [5, 6, 7, 8]


def test_a_part_that_is_late_is_shown_at_once(pairing):
    pairing.required_parts = {"particles"}
    pairing.add_image(2, "picture", now=0.0)
    pairing.add_result(2, "status", TRACKING, now=0.0)
    assert pairing.choose(now=0.5)
    for part in ("boxes", "particles"):
        pairing.add_result(2, part, [], now=0.6)
    assert pairing.choose(now=0.6)
    assert pairing.latest.answer.keys() == {"status", "boxes", "particles"}


def test_a_part_that_is_late_hides_no_picture_that_has_come_since(pairing):
    pairing.required_parts = {"particles"}
    pairing.add_image(2, "picture 2", now=0.0)
    for part, content in (("status", TRACKING), ("boxes", BOXES), ("particles", [])):
        pairing.add_result(2, part, content, now=0.0)
    assert pairing.choose(now=0.0)
    pairing.add_image(3, "picture 3", now=0.1)
    pairing.add_result(2, "boxes", {}, now=0.1)
    assert pairing.choose(now=0.1)
    assert pairing.latest.image == "picture 2"
    pairing.add_result(2, "boxes", {}, now=0.2)
    pairing.add_result(3, "status", IDLE, now=0.2)
    assert pairing.choose(now=0.2)
    assert pairing.latest.image == "picture 3"
    assert not pairing.choose(now=0.3)


def test_the_box_of_a_fast_camera_may_take_many_frames(pairing):
    """120 Hz, and 80 ms for an answer: ten images are newer by then."""
    shown = []
    for number in range(120):
        now = number / 120
        pairing.add_image(2 + number, f"picture {number}", now)
        if number >= 10:
            pairing.add_result(2 + number - 10, "status", IDLE, now)
        if pairing.choose(now):
            shown.append((pairing.latest.stamp, "status" in pairing.latest.answer))
    assert shown == [(2 + number, True) for number in range(110)]


def test_of_large_images_fewer_wait():
    pairing = FrameSynchronizer()
    pairing.add_result(0, "status", IDLE, now=0.0)
    for stamp in range(1, 41):
        pairing.add_image(stamp, SimpleNamespace(data=bytes(10_000_000)), now=0.0)
    assert list(pairing._images) == list(range(33, 41))


def test_what_waits_has_a_limit():
    pairing = FrameSynchronizer()
    pairing.add_result(0, "status", IDLE, now=0.0)
    for stamp in range(1, 10_000):
        pairing.add_image(stamp, stamp, now=0.0)
        pairing.add_result(-stamp, "boxes", None, now=0.0)
    assert len(pairing._images) <= 32
    assert len(pairing._answers) <= 32
