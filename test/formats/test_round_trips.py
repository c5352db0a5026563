"""Tracks survive each format: boxes to a thousandth of a pixel, ids, labels, absence."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pf_tracker_ros.formats import BoxTrack, FormatError, LabeledBox

COORDINATES = st.floats(-500.0, 5000.0, allow_nan=False)
SIDES = st.floats(0.01, 2000.0, allow_nan=False)
BOXES = st.builds(
    LabeledBox,
    st.none() | st.tuples(COORDINATES, COORDINATES, SIDES, SIDES),
    st.booleans(),
    st.floats(0.0, 1.0),
    st.booleans(),
)


def present(track):
    """Frame to box and occlusion where the target is present."""
    return {
        frame: (labeled.box, labeled.occluded)
        for frame, labeled in track.boxes.items()
        if labeled.box is not None
    }


def assert_same(tracks, others):
    assert [track.id for track in tracks] == [other.id for other in others]
    assert [track.label for track in tracks] == [other.label for other in others]
    for track, other in zip(tracks, others, strict=True):
        expected, found = present(track), present(other)
        assert found.keys() == expected.keys()
        for frame, (box, occluded) in expected.items():
            # Corners and sides are rounded to 0.001 px: two of them differ by at most that.
            assert found[frame][0] == pytest.approx(box, abs=1.1e-3)
            assert found[frame][1] == occluded


def test_labels_with_markup_quotes_and_commas(write_and_read, format_name):
    label = "großer <LKW> & \"Zug\", 'neu'"
    (track,) = write_and_read([BoxTrack(1, label, {0: LabeledBox((0.0, 0.0, 5.0, 5.0))})])
    # Columns of KITTI are separated by spaces.
    assert track.label == (label.replace(" ", "_") if format_name == "kitti" else label)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=15)
@given(st.lists(st.dictionaries(st.integers(0, 39), BOXES, min_size=1), min_size=1, max_size=3))
def test_any_tracks_with_absences(write_and_read, several):
    tracks = []
    for id, boxes in enumerate(several, start=1):
        ordered = {frame: boxes[frame] for frame in sorted(boxes)}
        while ordered and next(iter(ordered.values())).box is None:
            del ordered[next(iter(ordered))]
        if ordered:
            tracks.append(BoxTrack(id, "person" if id % 2 else "", ordered))
    if tracks:
        assert_same(tracks, write_and_read(tracks))
    else:
        with pytest.raises(FormatError, match=r"no box|is empty|no <track>"):
            write_and_read(tracks)


def test_confidences(write_and_read, format_name):
    (track,) = write_and_read([BoxTrack(1, "", {0: LabeledBox((0.0, 0.0, 5.0, 5.0), False, 0.25)})])
    confidence = track.boxes[0].confidence
    # CVAT has none.
    assert confidence == 0.25 or (format_name == "cvat" and math.isnan(confidence))
