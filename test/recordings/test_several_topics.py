"""Detections of a bag's topic with the command `track`."""

import pytest
from common import one_sentence

from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS

COUNT = 16


@pytest.mark.parametrize("little_endian", [True, False])
def test_detections_of_a_bag_are_applied_at_their_stamps_when_they_arrive(
    tracked, write_walkers, detections_message, library, little_endian
):
    def message(frame):
        boxes = library.boxes[frame]
        return detections_message(library.at(frame), boxes, little_endian=little_endian)

    # (frame of the detections, frame of their arrival): at once, two frames late, one frame late.
    frames = ((0, 0), (4, 6), (9, 10))
    bag = write_walkers([(library.at(later) + 1000, message(frame)) for frame, later in frames])
    code, errors, found = tracked(bag, "--detections-topic", "/found", "--seed", 2)
    assert (code, errors) == (0, "")
    expected = {arrival: [(library.detections(frame), frame)] for frame, arrival in frames}
    assert library.target_rows(found) == library.track((), expected, seed=2)
    assert len(found) == 2 * COUNT


def test_detections_of_another_clock_are_rejected(
    tracked, write_walkers, detections_message, library
):
    boxes = library.boxes
    bag = write_walkers(
        [
            (library.at(0), detections_message(library.at(0), boxes[0])),
            (library.at(5), detections_message(library.at(5) + 3600 * 10**9, boxes[5])),
            (library.at(6), detections_message(library.at(6), [boxes[6][0]] * 1500)),
        ]
    )
    code, errors, found = tracked(bag, "--detections-topic", "/found")
    assert code == 0
    (line,) = errors.splitlines()
    assert "track: 2 warnings on" in line
    assert line.endswith(" (frames counted from 0)")
    assert "frame 5: detections refused: its stamp is 3600 s after" in line
    assert len(found) == 2 * COUNT


def test_topics_without_detections(track, write_walkers, detections_message, source, library):
    octets = detections_message(library.at(0), [(1.0, 2.0, 30.0, 40.0)])
    bag = write_walkers([(library.at(0), octets), (library.at(8), octets[:-30])])
    output = bag.parent / "out"
    none = "has no topic /none of type vision_msgs/msg/Detection2DArray; available: /found"
    for recording, topic, expected, reason in (
        (bag, "/none", WRONG_DETECTIONS, none),
        (bag, "/eye", WRONG_DETECTIONS, "has no topic /eye of type"),
        (source, "/eye", 2, "applies to bags"),
        (bag, "/found", 3, "topic /found, message 1: a message of"),
    ):
        assert not output.exists()
        code, _, errors = track(recording, "--output", output, "--detections-topic", topic)
        assert (code, reason in one_sentence(errors)) == (expected, True), errors
    assert one_sentence(errors).endswith("; 8 frames were tracked")
