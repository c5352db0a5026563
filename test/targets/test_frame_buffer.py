"""The buffer of recent frames for late detections and manual targets."""

import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, HistoryEntry, ReducedFrame, thinned
from pf_tracker_ros.targets.tracks import TrackSet

IMAGE = np.zeros((10, 100), np.uint8)
# No whole number of tenths of a second.
FIRST = 1_234_567_890_123_456_789
SHAPES = {"1080p": (1080, 1920, 3), "4K": (2160, 3840, 3)}


def entry(image, stamp, interval=0.0, number=0, *, seen=None, motion=None):
    frame = Frame(image, stamp)
    frame.camera_motion = motion
    return HistoryEntry(frame, interval, TrackSet(frame=number), seen)


def add(buffer, image, stamp):
    buffer.add(entry(image, stamp))


def filled(image, count, rate=30.0, *, frames=120, megabytes=64.0, seen=()):
    """A buffer with copies of an image, and their stamps.

    The frames with the numbers in `seen` have an empty detector result.
    """
    buffer, stamps = FrameBuffer(frames, megabytes), []
    for index in range(count):
        stamps.append(FIRST + round(index * NANOSECONDS / rate))
        found = () if index in seen else None
        buffer.add(entry(image.copy(), stamps[-1], 1.0 / rate, index, seen=found))
    return buffer, stamps


def held(buffer):
    """Bytes of the stored images."""
    kept = [one.stored_frame for one in buffer.entries]
    return sum((one.image if isinstance(one, Frame) else one.pixels).nbytes for one in kept)


def is_reduced(one):
    return isinstance(one.stored_frame, ReducedFrame)


def test_the_newest_frames_are_kept_up_to_a_number_of_bytes():
    buffer = FrameBuffer(frames=100, megabytes=0.0025)
    for stamp in range(1, 6):
        add(buffer, IMAGE, stamp)
    assert buffer.stamps == [4, 5]
    buffer.limit(100, 0.0015)
    assert buffer.stamps == [5]
    buffer.limit(0, 0.0)
    add(buffer, IMAGE, 6)
    assert buffer.stamps == [6]
    assert FrameBuffer().empty_copy().stamps == []


def test_an_image_counts_with_all_memory_that_it_holds():
    buffer = FrameBuffer(frames=100, megabytes=0.0025)
    for stamp in range(1, 6):
        # A pixel a row, and the rest of the data is padding, as a message may have it.
        padded = np.frombuffer(bytes(1000), np.uint8).reshape(10, 100)
        add(buffer, padded[:, :1], stamp)
    assert buffer.stamps == [4, 5]


def test_a_jump_back_and_another_image_format_clear_the_buffer():
    for image, stamp in (
        (IMAGE, 1),
        (IMAGE, 2),
        (IMAGE[:5], 3),
        (IMAGE.astype(np.uint16), 3),
    ):
        buffer = FrameBuffer(frames=10, megabytes=1.0)
        add(buffer, IMAGE, 1)
        add(buffer, IMAGE, 2)
        add(buffer, image, stamp)
        assert buffer.stamps == [stamp]
        # A jump back resets it; a change of format sets it.
        assert buffer.dropped_until == (2 if stamp == 3 else 0)


def test_a_frame_without_a_stamp_clears_the_buffer():
    buffer = FrameBuffer(frames=10, megabytes=1.0)
    add(buffer, IMAGE, 1)
    add(buffer, IMAGE, 0)
    assert buffer.stamps == []


def test_an_empty_copy_has_the_same_bounds():
    buffer, _ = filled(IMAGE, 5, frames=3)
    other = buffer.empty_copy()
    assert (len(buffer), len(other)) == (3, 0)
    for stamp in range(1, 6):
        add(other, IMAGE, stamp)
    assert other.stamps == [3, 4, 5]


# Frames that exceed the memory


@pytest.mark.parametrize("size", ["1080p", "4K"])
def test_large_frames_of_two_seconds_are_kept_thinned_out(size):
    buffer, stamps = filled(np.zeros(SHAPES[size], np.uint8), 90)
    assert set(buffer.stamps) <= set(stamps)
    assert buffer.stamps[-1] == stamps[-1]
    assert 2 * NANOSECONDS <= stamps[-1] - buffer.stamps[0] <= 2.3 * NANOSECONDS
    assert np.diff(buffer.stamps).max() <= 0.14 * NANOSECONDS
    assert held(buffer) <= 64e6
    # For each frame of the last two seconds, one at most 0.07 s away is stored.
    for stamp in stamps[30:]:
        assert abs(buffer.since(stamp)[0].stamp - stamp) <= 0.07 * NANOSECONDS


def test_the_intervals_of_thinned_frames_add_up_to_the_time_between_them():
    buffer, _ = filled(np.zeros(SHAPES["1080p"], np.uint8), 90)
    assert len(buffer) < 60
    intervals = [one.interval for one in buffer.entries[1:]]
    np.testing.assert_allclose(intervals, np.diff(buffer.stamps) / NANOSECONDS, atol=1e-7)
    # Each entry has the track set of the entry before it.
    numbers = [one.tracks_before.frame for one in buffer.entries]
    shown = [round((stamp - FIRST) / NANOSECONDS * 30) for stamp in buffer.stamps]
    assert numbers[1:] == [number + 1 for number in shown[:-1]]


def test_thinning_keeps_frames_with_detections():
    detected = {45, 52, 53, 61, 70}
    buffer, stamps = filled(np.zeros(SHAPES["1080p"], np.uint8), 90, seen=detected)
    kept = {stamps.index(one.stamp) for one in buffer.entries if one.detections is not None}
    assert kept == detected


def test_the_newest_of_large_frames_are_stored_in_full():
    buffer, images = FrameBuffer(120, 64.0), []
    for index in range(90):
        images.append(np.zeros(SHAPES["1080p"], np.uint8))
        add(buffer, images[-1], FIRST + round(index * NANOSECONDS / 30))
        images = images[-4:]
    kept = buffer.entries[-4:]
    assert [one.frame.image is image for one, image in zip(kept, images, strict=True)] == [True] * 4


@pytest.mark.parametrize("shape", [(90, 160, 3), (91, 163, 3), (93, 161)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_reduced_frame_is_restored_without_shift(shape, dtype):
    if len(shape) == 3 and dtype != np.uint8:
        shape = shape[:2]
    coarse = np.random.default_rng(0).uniform(50.0, 200.0, (6, 9, *shape[2:]))
    image = cv2.resize(coarse, shape[1::-1], interpolation=cv2.INTER_CUBIC).astype(dtype)
    buffer, _ = filled(image, 90, megabytes=30 * image.nbytes / 3 / 1e6)
    for one in buffer.entries:
        assert (one.frame.image.shape, one.frame.image.dtype) == (image.shape, image.dtype)
        error = np.abs(one.frame.image.astype(float) - image)[2:-2, 2:-2]
        assert error.max() < 4.0
    assert is_reduced(buffer.first)
    assert not np.array_equal(buffer.first.frame.image, image)


def test_a_reduced_frame_keeps_its_exposure_and_camera_motion():
    image = np.random.default_rng(0).integers(8000, 9000, (60, 80), dtype=np.uint16)
    motion = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    frame = Frame(image, 7)
    frame.expose((0.0, 60_000.0))
    frame.camera_motion = motion
    restored = ReducedFrame.of(frame, 2).restored()
    assert restored.stamp == 7
    assert restored.camera_motion is motion
    # Scaled to its own range of values, it would be as bright as a mask.
    assert restored.pixels.max() < 60


@settings(max_examples=50)
@given(
    st.tuples(st.integers(1, 60), st.integers(1, 60)),
    st.floats(1.0, 100.0),
    st.floats(2.0, 120.0),
    st.integers(1, 150),
    st.sets(st.integers(0, 159)),
)
def test_the_bounds_hold_and_the_newest_frame_is_kept(shape, images_worth, rate, frames, seen):
    image = np.zeros(shape, np.uint8)
    megabytes = images_worth * image.nbytes / 1e6 * (1 + 1e-9)
    buffer, stamps = filled(image, 160, rate, frames=frames, megabytes=megabytes, seen=seen)
    assert buffer.stamps == sorted(set(buffer.stamps))
    assert buffer.stamps[-1] == stamps[-1]
    assert buffer.last.frame.image.nbytes == image.nbytes
    assert len(buffer) <= frames
    assert held(buffer) <= megabytes * 1e6
    # Dropped frames are older than stored ones.
    assert buffer.dropped_until < buffer.stamps[0]
    # Intervals add up to the time between entries.
    for one, interval in zip(buffer.entries[1:], np.diff(buffer.stamps), strict=True):
        assert one.interval == pytest.approx(interval / NANOSECONDS, abs=1e-6)
    buffer.limit(1, megabytes)
    assert buffer.stamps == stamps[-1:]
    assert buffer.dropped_until < stamps[-1]


def test_frames_that_fit_are_kept_in_full_at_any_age():
    image = np.zeros((48, 64), np.uint8)
    buffer, stamps = filled(image, 50, rate=5.0, megabytes=1.0)
    assert buffer.stamps == stamps
    assert not any(map(is_reduced, buffer.entries))


def test_the_nearest_frame_replaces_a_missing_one():
    buffer = FrameBuffer(frames=10, megabytes=1.0)
    for stamp in (100, 200, 300):
        add(buffer, IMAGE, stamp)
    firsts = {stamp: buffer.since(stamp)[0].stamp for stamp in (1, 100, 149, 150, 151, 260, 300)}
    assert firsts == {1: 100, 100: 100, 149: 100, 150: 200, 151: 200, 260: 300, 300: 300}
    assert buffer.since(301) == []


def test_the_buffer_is_complete_until_its_first_frame_is_dropped():
    buffer, _ = filled(IMAGE, 3, frames=3)
    assert buffer.is_complete
    buffer.add(entry(IMAGE, FIRST + NANOSECONDS, 0.1, 3))
    assert not buffer.is_complete
    assert not FrameBuffer().is_complete


def test_derived_images_are_kept_for_the_newest_frame_only():
    image = np.random.default_rng(0).integers(0, 60_000, (400, 400), dtype=np.uint16)
    buffer = FrameBuffer(10, 10.0)
    seen = []
    tracemalloc.start()
    for number in range(5):
        frame = Frame(image.copy(), number + 1)
        frame.expose((0.0, 60_000.0))
        seen.append((frame, frame.pixels.copy()))
        buffer.add(HistoryEntry(frame, 0.04, TrackSet(frame=number)))
    memory = tracemalloc.get_traced_memory()[0] - sum(view.nbytes for _, view in seen)
    tracemalloc.stop()
    # Five images, and one view of 8 bit.
    assert memory < 5.6 * image.nbytes
    for frame, view in seen:
        np.testing.assert_array_equal(frame.pixels, view)


# Replaced entries


def test_replace_from_replaces_all_entries_from_the_first_stamp_on():
    buffer, stamps = filled(IMAGE, 4)
    revised = [entry(IMAGE, stamp, 0.5, 70) for stamp in stamps[2:]]
    buffer.replace_from(revised)
    assert buffer.stamps == stamps
    assert [one.tracks_before.frame for one in buffer.entries] == [0, 1, 70, 70]
    buffer.replace_from([])
    assert len(buffer) == 4


def test_replaced_entries_count_for_the_bounds():
    buffer, stamps = filled(IMAGE, 4, megabytes=0.0045)
    buffer.replace_from(buffer.entries[2:])
    add(buffer, IMAGE, stamps[-1] + 1)
    assert buffer.stamps == [*stamps[1:], stamps[-1] + 1]
    assert buffer.dropped_until == stamps[0]
    buffer.replace_all(buffer.entries[2:])
    assert buffer.stamps == [stamps[3], stamps[-1] + 1]
    assert held(buffer) == 2 * IMAGE.nbytes


def test_entries_stay_in_order_when_some_thinned_frames_are_full():
    image = np.zeros((200, 320, 3), np.uint8)
    megabytes = image.nbytes / 1e6
    buffer, stamps = filled(image, 200, 50.0, frames=1000, megabytes=60 * megabytes)
    buffer.limit(1000, 20 * megabytes)
    for index in range(30):
        buffer.add(entry(image.copy(), stamps[-1] + (index + 1) * NANOSECONDS // 50, 0.02))
    assert {is_reduced(one) for one in buffer.entries[:15]} == {False, True}
    before = buffer.stamps
    buffer.replace_all(buffer.entries)
    assert buffer.stamps == before == sorted(before)


def test_replacing_all_by_none_sets_dropped_until():
    buffer, stamps = filled(IMAGE, 5)
    buffer.replace_all([])
    assert (len(buffer), buffer.dropped_until) == (0, stamps[-1])


def motion(across, down, scale=1.0):
    return np.array([[scale, 0.0, across], [0.0, scale, down], [0.0, 0.0, 1.0]])


def test_a_merged_entry_has_the_interval_and_camera_motion_of_both():
    """A point at (10, 20) goes to (13, 20), then to (26, 45)."""
    dropped = entry(IMAGE, 1, 0.25, 5, motion=motion(3.0, 0.0))
    after = entry(IMAGE, 2, 0.5, 6, motion=motion(0.0, 5.0, scale=2.0))
    merged = after.merge_dropped(dropped)
    assert (merged.stamp, merged.interval, merged.tracks_before) == (2, 0.75, dropped.tracks_before)
    np.testing.assert_allclose(merged.frame.camera_motion @ [10.0, 20.0, 1.0], [26.0, 45.0, 1.0])


@pytest.mark.parametrize(("first", "second"), [(None, True), (True, None), (None, None)])
def test_a_missing_camera_motion_leaves_that_of_the_other_entry(first, second):
    known = motion(3.0, 4.0)
    dropped = entry(IMAGE, 1, 0.1, motion=known if first else None)
    after = entry(IMAGE, 2, 0.1, motion=known if second else None)
    merged = after.merge_dropped(dropped).frame.camera_motion
    assert merged is None if not (first or second) else np.array_equal(merged, known)


def test_entries_with_reduced_frames_are_merged_alike():
    frames = []
    for stamp, across in ((1, 3.0), (2, 4.0)):
        frame = Frame(np.zeros((8, 8), np.uint8), stamp)
        frame.camera_motion = motion(across, 0.0)
        frames.append(ReducedFrame.of(frame, 2))
    dropped, after = (HistoryEntry(frame, 0.1, TrackSet()) for frame in frames)
    merged = after.merge_dropped(dropped)
    assert merged.interval == pytest.approx(0.2)
    np.testing.assert_array_equal(merged.frame.camera_motion, motion(7.0, 0.0))


def test_merging_leaves_the_entry_unchanged():
    dropped = entry(IMAGE, 1, 0.1, motion=motion(3.0, 0.0))
    after = entry(IMAGE, 2, 0.1, motion=motion(4.0, 0.0))
    for _ in range(2):
        merged = after.merge_dropped(dropped).frame.camera_motion
        np.testing.assert_array_equal(merged, motion(7.0, 0.0))
    np.testing.assert_array_equal(after.frame.camera_motion, motion(4.0, 0.0))


@pytest.mark.parametrize(("count", "most", "expected"), [(5, 10, 5), (11, 10, 11), (101, 30, 31)])
def test_entries_are_thinned_evenly(count, most, expected):
    entries = filled(IMAGE, count)[0].entries
    chosen = thinned(entries, most)
    assert len(chosen) == expected
    assert (chosen[0], chosen[-1].stamp) == (entries[0], entries[-1].stamp)
    # 100 steps of a 30th of a second in 30.
    steps = {round(one.interval * 30) for one in chosen[1:]}
    assert steps == ({1} if count < 100 else {3, 4})
    assert sum(one.interval for one in chosen[1:]) == pytest.approx((count - 1) / 30)


def test_thinned_entries_include_those_with_detections():
    entries = filled(IMAGE, 101, seen={50, 51, 52})[0].entries
    chosen = thinned(entries, 10)
    detected = [one for one in chosen if one.detections is not None]
    assert [one.stamp for one in detected] == [entries[number].stamp for number in (50, 51, 52)]
    assert len(chosen) == 13
    assert sum(one.interval for one in chosen[1:]) == pytest.approx(100 / 30)
