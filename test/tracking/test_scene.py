"""A scene: what is of the camera is done once a frame, and each target is on its own."""

import copy
import gc
import pickle
import weakref

import numpy as np
import pytest
from pf_tracker_ros.tracking.scene import Scene

from pf_tracker_ros import Tracker
from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.frames import frame as frame_module
from pf_tracker_ros.frames.gain_control import GainControl
from pf_tracker_ros.frames.gray_range import gray_range
from pf_tracker_ros.frames.tiles import TiledImage
from pf_tracker_ros.tracking.presets import PRESETS

INTERVAL = 0.04
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def pickled(value):
    return pickle.loads(pickle.dumps(value))


every_way = pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])


def box(boxes, index):
    return tuple(boxes[index].tolist())


def estimates(scene, images, number):
    """Of one target in the next images."""
    told = []
    for image in images:
        scene.update(image, INTERVAL)
        told.append(scene.targets[number].estimate)
    return told


# Ids


def test_ids_count_from_1_and_are_never_used_again(make_follower, couple):
    scene = Scene(make_follower("li2007"))
    assert dict(scene.targets) == {}
    image = couple.images[0]
    assert scene.start(image, box(couple.first, 0)) == 1
    assert scene.start(image, box(couple.second, 0)) == 2
    scene.stop(2)
    assert scene.start(image, box(couple.second, 0)) == 3
    scene.stop(1)
    scene.stop(3)
    assert dict(scene.targets) == {}
    scene.update(couple.images[1], INTERVAL)
    assert scene.start(couple.images[1], box(couple.first, 1)) == 4
    assert [*scene.targets] == [4]


def test_a_target_that_is_not_there_is_not_stopped(make_follower, couple):
    scene = Scene(make_follower("li2007"))
    scene.start(couple.images[0], box(couple.first, 0))
    with pytest.raises(KeyError):
        scene.stop(2)
    assert [*scene.targets] == [1]
    scene.stop(1)
    with pytest.raises(KeyError):
        scene.stop(1)


def test_targets_are_changed_by_the_scene_alone(make_follower, couple):
    scene = Scene(make_follower("li2007"))
    number = scene.start(couple.images[0], box(couple.first, 0))
    with pytest.raises(TypeError):
        scene.targets[number] = None
    before = scene.targets[number]
    scene.update(couple.images[1], INTERVAL)
    assert scene.targets[number] is not before


# What is done once


@pytest.fixture
def looked_at(monkeypatch):
    """Shape of a view of a frame to how often each of its pixels was computed, since cleared."""
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

    monkeypatch.setattr(frame_module, "TiledImage", CountingImage)
    return counts


def sixteen_bit(image):
    return image.mean(axis=2).astype(np.uint16) * 30 + 7000


@pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015"])
def test_pixels_are_converted_and_reduced_once_for_all_targets(
    preset, make_follower, couple, looked_at
):
    """Boxes of 60 px are looked at in an image reduced to a half, but by zhang2015."""
    first, last = (sixteen_bit(couple.images[index]) for index in (0, 1))
    boxes = (30.0, 50.0, 60.0, 60.0), (70.0, 50.0, 60.0, 60.0)

    def computed(*kept):
        scene = Scene(make_follower(preset))
        for number in [scene.start(first, one) for one in boxes]:
            if number not in kept:
                scene.stop(number)
        looked_at.clear()
        scene.update(last, INTERVAL)
        return dict(looked_at)

    alone, other, both = computed(1), computed(2), computed(1, 2)
    shapes = {(160, 240)} | ({(80, 120)} if preset != "zhang2015" else set())
    assert alone.keys() == other.keys() == both.keys() >= shapes
    for shape, counts in both.items():
        assert counts.max() == 1
        # Either would have computed some of the same.
        assert ((alone[shape] > 0) & (other[shape] > 0)).any()
        np.testing.assert_array_equal(counts > 0, (alone[shape] > 0) | (other[shape] > 0))


@pytest.fixture
def model_updates(monkeypatch):
    """The boxes that every update of a background model was told."""
    told = []
    update = BackgroundModel.update

    def counted(model, image, holes=()):
        told.append(list(holes))
        return update(model, image, holes)

    monkeypatch.setattr(BackgroundModel, "update", counted)
    return told


@pytest.mark.parametrize("targets", [1, 2])
def test_the_background_is_learned_once_a_frame(targets, make_follower, couple, model_updates):
    scene = Scene(make_follower("zhang_bo"))
    for boxes in (couple.first, couple.second)[:targets]:
        scene.start(couple.images[0], box(boxes, 0))
    assert len(model_updates) == 1
    for index in range(1, 6):
        scene.update(couple.images[index], INTERVAL)
        assert len(model_updates) == 1 + index
        assert len(model_updates[-1]) == targets
    states = [target.estimate.background for target in scene.targets.values()]
    assert all(state is states[0] for state in states)


@pytest.mark.parametrize("preset", ["li2007", "zhang2015"])
def test_without_a_cue_of_the_foreground_there_is_no_background_model(
    preset, make_follower, couple, model_updates
):
    scene = Scene(make_follower(preset))
    scene.start(couple.images[0], box(couple.first, 0))
    scene.update(couple.images[1], INTERVAL)
    assert model_updates == []


def test_the_gray_range_goes_on_once_a_frame(make_follower, couple, monkeypatch):
    intervals = []
    follow = GainControl.follow

    def counted(gain, image, interval):
        intervals.append(interval)
        return follow(gain, image, interval)

    monkeypatch.setattr(GainControl, "follow", counted)
    scene = Scene(make_follower("li2007"))
    images = [sixteen_bit(image) for image in couple.images[:4]]
    for boxes in (couple.first, couple.second):
        scene.start(images[0], box(boxes, 0))
    for image in images[1:]:
        scene.update(image, INTERVAL)
    assert intervals == [0.0] + [INTERVAL] * 3


def test_a_start_on_the_image_given_last_does_not_open_the_frame_again(
    make_follower, couple, model_updates
):
    scene = Scene(make_follower("zhang_bo"))
    scene.start(couple.images[0], box(couple.first, 0))
    scene.update(couple.images[1], INTERVAL)
    scene.start(couple.images[1], box(couple.second, 1))
    assert len(model_updates) == 1 + 1
    # The same pixels in another array may be another frame.
    scene.start(couple.images[1].copy(), box(couple.second, 1))
    assert len(model_updates) == 3


def test_whoever_begins_the_background_anew_is_told_where_all_targets_are(
    make_follower, couple, model_updates
):
    scene = Scene(make_follower("zhang_bo"))
    scene.start(couple.images[0], box(couple.first, 0))
    scene.start(couple.images[1], box(couple.second, 1))
    assert model_updates[-1] == [box(couple.first, 0), box(couple.second, 1)]
    scene.update(couple.images[2], INTERVAL)
    assert len(model_updates[-1]) == 2

    late = Scene(make_follower("li2007"))
    late.start(couple.images[0], box(couple.first, 0))
    late.reconfigure(make_follower("li2007", {"cues": ("color_histogram", "foreground")}))
    late.start(couple.images[0], box(couple.second, 0))
    assert model_updates[-1] == [box(couple.first, 0), box(couple.second, 0)]


# Each target on its own


def alone(follower, couple, end):
    """Estimates of the first target in a scene of its own, from the second frame on."""
    scene = Scene(follower, seed=5)
    number = scene.start(couple.images[0], box(couple.first, 0))
    return estimates(scene, couple.images[1:end], number)


@pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015"])
def test_the_bits_of_a_target_do_not_hang_on_another_of_the_same_frame(
    preset, make_follower, couple
):
    follower = make_follower(preset)
    end = len(couple.images)
    expected = alone(follower, couple, end)
    assert {one.state for one in expected} == {"tracking", "occluded"}
    scene = Scene(follower, seed=5)
    number = scene.start(couple.images[0], box(couple.first, 0))
    other = scene.start(couple.images[0], box(couple.second, 0))
    together = estimates(scene, couple.images[1:end], number)
    assert together == expected
    assert scene.targets[other].estimate.box == pytest.approx(couple.second[-1], abs=6)

    # That one neither hangs on this: in a scene of the same ids it goes on by itself.
    scene = Scene(follower, seed=5)
    scene.start(couple.images[0], box(couple.first, 0))
    assert scene.start(couple.images[0], box(couple.second, 0)) == other
    told = estimates(scene, couple.images[1:end], other)
    scene = Scene(follower, seed=5)
    scene.stop(scene.start(couple.images[0], box(couple.first, 0)))
    assert scene.start(couple.images[0], box(couple.second, 0)) == other
    assert estimates(scene, couple.images[1:end], other) == told


@every_preset
def test_nor_on_one_that_comes_later_and_goes_again(preset, make_follower, couple):
    follower = make_follower(preset)
    end = len(couple.images)
    expected = alone(follower, couple, end)
    scene = Scene(follower, seed=5)
    number = scene.start(couple.images[0], box(couple.first, 0))
    told = estimates(scene, couple.images[1:4], number)
    other = scene.start(couple.images[3], box(couple.second, 3))
    told += estimates(scene, couple.images[4:12], number)
    scene.stop(other)
    told += estimates(scene, couple.images[12:end], number)
    assert told == expected


@every_preset
def test_nor_on_one_that_was_there_before(preset, make_follower, couple):
    """Its id is another then; so it is compared where the other one was stopped at once."""
    follower = make_follower(preset)

    def told(stopped):
        scene = Scene(follower, seed=5)
        before = scene.start(couple.images[0], box(couple.first, 0))
        if stopped:
            scene.stop(before)
        for image in couple.images[1:4]:
            scene.update(image, INTERVAL)
        number = scene.start(couple.images[3], box(couple.second, 3))
        return estimates(scene, couple.images[4:16], number)

    assert told(stopped=True) == told(stopped=False)


@every_preset
def test_two_targets_of_one_seed_draw_their_own_numbers(preset, make_follower, couple):
    scene = Scene(make_follower(preset), seed=5)
    first, second = (scene.start(couple.images[0], box(couple.first, 0)) for _ in range(2))
    particles = [scene.targets[number].estimate.particles for number in (first, second)]
    assert not np.array_equal(*particles)


# Copies


@every_way
@every_preset
def test_a_copied_scene_goes_on_with_the_same_bits_and_on_its_own(
    preset, copied, make_follower, couple
):
    scene = Scene(make_follower(preset), seed=5)
    scene.start(couple.images[0], box(couple.first, 0))
    scene.start(couple.images[0], box(couple.second, 0))
    for image in couple.images[1:6]:
        scene.update(image, INTERVAL)
    twin, astray, again = (copied(scene) for _ in range(3))
    astray.stop(1)
    astray.start(couple.images[5], box(couple.first, 5))
    for _ in range(4):
        astray.update(np.zeros_like(couple.images[0]), INTERVAL)
    assert [*scene.targets] == [*twin.targets] == [1, 2]

    def told(one):
        followed = []
        for image in couple.images[6:12]:
            one.update(image, INTERVAL)
            followed.append({number: target.estimate for number, target in one.targets.items()})
        followed.append(one.start(couple.images[11], box(couple.first, 11)))
        one.update(couple.images[12], INTERVAL)
        return [*followed, one.targets[3].estimate]

    expected = told(twin)
    assert told(scene) == expected
    assert told(again) == expected


@every_way
def test_a_copied_scene_does_not_carry_its_last_image(copied, make_follower):
    image = np.random.default_rng(0).integers(0, 256, (1000, 1000, 3), dtype=np.uint8)
    scene = Scene(make_follower("default"), seed=5)
    scene.start(image, (400.0, 400.0, 40.0, 40.0))
    scene.update(image, INTERVAL)
    assert len(pickle.dumps(copied(scene))) < image.nbytes / 3
    # The one that was copied still knows it.
    held = scene.targets[1]
    scene.start(image, (500.0, 400.0, 40.0, 40.0))
    assert scene.targets[1] is held


# Sensors that drift


def test_a_target_is_held_while_the_sensor_drifts_beyond_the_first_range(moving_square):
    gray = 7000 + 4 * moving_square.images[0].mean(axis=2)
    first_range = gray_range(gray.astype(np.uint16))
    tracker = Tracker.from_preset("zhang2015")
    tracker.start(gray.astype(np.uint16), moving_square.boxes[0])
    for drift in range(0, 1200, 2):
        estimate = tracker.update((gray + drift).astype(np.uint16), 0.5)
    assert gray.min() + drift > first_range[1]
    assert estimate.state == "tracking"
    assert estimate.box == pytest.approx(moving_square.boxes[0], abs=10)


@pytest.mark.parametrize("kind", ["color", "sixteen bit", "reduced"])
@every_preset
def test_a_frame_that_has_gone_by_is_let_go_at_once(preset, kind, couple):
    """Its image is large, and the garbage collector does not see how large."""
    images = couple.images[:6]
    if kind == "sixteen bit":
        images = [sixteen_bit(image) for image in images]
    if kind == "reduced":
        images = [np.repeat(np.repeat(image, 4, 0), 4, 1) for image in images]
    box = tuple(4.0 * side for side in couple.first[0]) if kind == "reduced" else couple.first[0]
    tracker = Tracker.from_preset(preset)
    tracker.start(images[0], box)
    seen = []
    gc.collect()
    gc.disable()
    try:
        for kept in images[1:]:
            image = kept.copy()
            seen.append(weakref.ref(image))
            tracker.update(image)
        del image
        assert sum(one() is not None for one in seen) <= 1
    finally:
        gc.enable()
