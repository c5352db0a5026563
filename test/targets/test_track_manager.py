"""Computations on the image are done once a frame, for any number of targets."""

import numpy as np
import pytest

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames import frame as frame_module
from pf_tracker_ros.frames.exposure import GainControl
from pf_tracker_ros.frames.frame import TiledImage
from pf_tracker_ros.parameters import build
from pf_tracker_ros.targets.track_manager import FrameNotBufferedError, TrackManager
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

INTERVAL = 0.1
STEP = 10**8


@pytest.fixture
def make_manager():
    def make(preset="default", most=4, **parameters):
        values = preset_parameters(preset, most) | parameters
        manager = TrackManager(build(TrackerParameters, values), seed=5)
        manager.frames.limit(200, 128.0)
        return manager

    return make


def at(number):
    return (number + 1) * STEP


def sixteen_bit(image):
    return image.mean(axis=2).astype(np.uint16) * 30 + 7000


def begin(manager, images, boxes):
    """Start targets on the first of the images."""
    first, *others = (tuple(box) for box in boxes)
    manager.start_on(Frame(images[0], at(0)), first)
    for box in others:
        manager.start(box)


def go_on(manager, images, numbers):
    for number in numbers:
        manager.update(Frame(images[number], at(number)), INTERVAL)


# Shared computations


@pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015"])
def test_pixels_are_converted_and_reduced_once_for_all_targets(
    preset, make_manager, walkers, monkeypatch
):
    counts = {}

    class CountingImage(TiledImage):
        def __init__(self, shape):
            super().__init__(shape)
            self.shape = shape

        def read(self, part, compute):
            def count(within):
                counts.setdefault(self.shape, np.zeros(self.shape[:2], int))[within.slices] += 1
                return compute(within)

            return super().read(part, count)

    images = [sixteen_bit(image) for image in walkers.images[:2]]
    manager = make_manager(preset, working_size=20)
    x, y, width, height = walkers.boxes[0][0]
    begin(manager, images, [(x + 12 * place, y, width, height) for place in range(3)])
    monkeypatch.setattr(frame_module, "TiledImage", CountingImage)
    go_on(manager, images, [1])
    assert {shape[:2] for shape in counts} >= {(200, 320), (100, 160)}
    assert all(one.max() == 1 for one in counts.values())


@pytest.fixture
def model_updates(monkeypatch):
    """The boxes passed to each update of a background model."""
    updates = []
    update = BackgroundModel.update

    def counted(model, image, foreground_boxes=()):
        updates.append([tuple(box) for box in foreground_boxes])
        return update(model, image, foreground_boxes)

    monkeypatch.setattr(BackgroundModel, "update", counted)
    return updates


@pytest.mark.parametrize("targets", [1, 3])
def test_the_background_is_learned_once_a_frame(targets, make_manager, walkers, model_updates):
    manager = make_manager("zhang_bo")
    begin(manager, walkers.images, walkers.boxes[0][:targets])
    assert len(model_updates) == 1
    for number in range(1, 6):
        go_on(manager, walkers.images, [number])
        assert len(model_updates) == 1 + number
        assert len(model_updates[-1]) == targets
    states = [target.estimate.background for target in manager.targets]
    assert all(state is states[0] for state in states)


@pytest.mark.parametrize("preset", ["li2007", "zhang2015"])
def test_without_a_foreground_cue_there_is_no_background_model(
    preset, make_manager, walkers, model_updates
):
    manager = make_manager(preset)
    begin(manager, walkers.images, walkers.boxes[0])
    go_on(manager, walkers.images, [1])
    assert model_updates == []


def test_a_new_background_model_gets_the_boxes_of_all_targets(make_manager, walkers, model_updates):
    manager = make_manager("li2007")
    begin(manager, walkers.images, walkers.boxes[0])
    manager.adopt_parameters(
        make_manager("li2007", cues=("color_histogram", "gradient_orientation", "foreground"))
    )
    go_on(manager, walkers.images, [1])
    assert model_updates == [[tuple(box) for box in walkers.boxes[0]]]


def test_gain_control_is_updated_once_a_frame(make_manager, walkers, monkeypatch):
    intervals = []
    update = GainControl.update

    def counted(gain, image, interval):
        intervals.append(interval)
        return update(gain, image, interval)

    monkeypatch.setattr(GainControl, "update", counted)
    images = [sixteen_bit(image) for image in walkers.images[:4]]
    manager = make_manager("li2007")
    begin(manager, images, walkers.boxes[0])
    go_on(manager, images, range(1, 4))
    assert intervals == [0.0] + [INTERVAL] * 3


def test_without_a_single_target_frames_are_only_buffered(make_manager, walkers, model_updates):
    manager = make_manager("zhang_bo", 1)
    go_on(manager, walkers.images, range(4))
    assert (model_updates, len(manager.frames)) == ([], 4)
    # It is caught up through the frames since its own, with a new background model.
    started = manager.start(tuple(walkers.boxes[1][0]), at(1))
    assert (started.caught_up, len(model_updates)) == (2, 3)


# Refused targets


def test_targets_of_one_seed_have_their_own_random_numbers(make_manager, walkers):
    manager = make_manager("li2007")
    begin(manager, walkers.images, [walkers.boxes[0][0], walkers.boxes[0][0] + (25, 0, 0, 0)])
    first, second = (target.estimate.particles for target in manager.targets)
    assert not np.allclose(first[:, 0] + 25.0, second[:, 0])


@pytest.mark.parametrize("most", [1, 2])
@pytest.mark.parametrize(
    "drawn",
    [
        ((500.0, 10.0, 20.0, 20.0), 0, ValueError),
        ((10.0, 10.0, 0.0, 20.0), at(3), ValueError),
        ((10.0, 10.0, 20.0, 20.0), at(0) - 2 * 10**9, FrameNotBufferedError),
    ],
)
def test_a_refused_start_changes_nothing(make_manager, walkers, as_told, most, drawn):
    box, stamp, refusal = drawn
    snapshots = []
    for is_tried in (False, True):
        manager = make_manager("default", most)
        begin(manager, walkers.images, walkers.boxes[0][:most])
        go_on(manager, walkers.images, range(1, 6))
        if is_tried:
            with pytest.raises(refusal):
                manager.start(box, stamp)
        go_on(manager, walkers.images, range(6, 9))
        snapshots.append((as_told(manager.targets), manager.frames.stamps))
    assert snapshots[0] == snapshots[1]


def test_a_refused_start_on_an_old_frame_leaves_the_buffer_unchanged(
    make_manager, walkers, as_told
):
    """More frames than are replayed, by a moving camera."""
    images = [np.roll(walkers.images[0], number % 7, axis=1) for number in range(45)]
    manager = make_manager("default", 1 + 1)
    begin(manager, images, walkers.boxes[0][:2])
    go_on(manager, images, range(1, 45))
    before = [entry.frame.camera_motion for entry in manager.frames.entries]
    with pytest.raises(ValueError, match="the maximum"):
        manager.start(tuple(walkers.boxes[0][2]), at(0))
    after = [entry.frame.camera_motion for entry in manager.frames.entries]
    assert any(motion is not None for motion in before)
    assert all(one is other for one, other in zip(before, after, strict=True))
