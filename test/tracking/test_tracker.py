"""The tracker on generated images: follows, repeats itself, coasts, refuses."""

import itertools
from datetime import timedelta

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.presets import PRESETS

WIDTH, HEIGHT, SIDE = 320, 240, 36
CUES = (
    "color_histogram",
    "gradient_orientation",
    "foreground_probability",
    "oriented_gradients",
    "correlation_response",
)
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def texture(seed, shape, low, high):
    noise = np.random.default_rng(seed).integers(low, high, (*[s // 6 for s in shape[:2]], 3))
    return cv2.resize(noise.astype(np.uint8), shape[1::-1], interpolation=cv2.INTER_CUBIC)


BACKGROUND = texture(1, (HEIGHT, WIDTH), 90, 160)
TARGET = texture(2, (SIDE, SIDE), 0, 250)


def frame(x, y, scale=1.0, visible=True):
    """The target with its center at (x, y), and its box."""
    image = BACKGROUND.copy()
    side = round(SIDE * scale)
    left, top = round(x - side / 2), round(y - side / 2)
    if visible:
        image[top : top + side, left : left + side] = cv2.resize(TARGET, (side, side))
    return image, (left, top, side, side)


def center(box):
    return np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])


def overlap(a, b):
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    common = max(width, 0) * max(height, 0)
    return common / (a[2] * a[3] + b[2] * b[3] - common)


def walk(count=40, speed=3.0):
    return [frame(60 + speed * t, 120 + 30 * np.sin(t / 8)) for t in range(count)]


def run(tracker, frames):
    tracker.start(*frames[0])
    return [tracker.update(image) for image, _ in frames[1:]]


@every_preset
def test_follows_a_moving_target(preset):
    frames = walk()
    estimates = run(Tracker.from_preset(preset), frames)
    for estimate, (_, box) in zip(estimates, frames[1:], strict=True):
        assert overlap(estimate.box, box) > 0.6
        assert estimate.state == "tracking"


@pytest.mark.parametrize("kind", ["gray", "16 bit"])
@every_preset
def test_follows_in_gray_and_16_bit_images(preset, kind):
    def convert(image):
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return gray if kind == "gray" else gray.astype(np.uint16) * 12 + 7000

    frames = [(convert(image), box) for image, box in walk()]
    estimates = run(Tracker.from_preset(preset), frames)
    assert overlap(estimates[-1].box, frames[-1][1]) > 0.6


@pytest.mark.parametrize("preset", ["default", "zhang2015"])
def test_a_change_of_size_is_followed(preset):
    frames = [frame(160, 120, 1.0 + 0.02 * t) for t in range(40)]
    estimates = run(Tracker.from_preset(preset), frames)
    assert overlap(estimates[-1].box, frames[-1][1]) > 0.6


def test_li2007_keeps_the_size_of_the_first_box():
    frames = [frame(160, 120, 1.0 + 0.02 * t) for t in range(20)]
    for estimate in run(Tracker.from_preset("li2007"), frames):
        assert estimate.box[2:] == pytest.approx((SIDE, SIDE))


def test_zhang2015_renews_its_template_above_a_similarity_of_065():
    """The gate is on the likelihood; for this cue alone the two are one."""
    tracker = Tracker.from_preset("zhang2015")
    gate = tracker.parameters["template.update_above"]
    sharpness = tracker.parameters["oriented_gradients.sharpness"]
    for similarity, trusted in [(0.6499, False), (0.6501, True)]:
        squared_distance = (1.0 - similarity) ** 2
        assert (np.exp(-sharpness * squared_distance / 2) > gate) == trusted


def test_zhang2015_follows_through_a_flip_of_polarity():
    """What was brighter than the ground becomes darker, as infrared images know it."""
    frames = [(255 - image if t >= 20 else image, box) for t, (image, box) in enumerate(walk(40))]
    estimates = run(Tracker.from_preset("zhang2015"), frames)
    assert overlap(estimates[-1].box, frames[-1][1]) > 0.6


@every_preset
def test_same_seed_same_bits_another_seed_other_bits(preset):
    frames = walk(15)
    one, same = (run(Tracker.from_preset(preset, seed=5), frames) for _ in range(2))
    other = run(Tracker.from_preset(preset, seed=6), frames)
    assert [e.box for e in one] == [e.box for e in same]
    np.testing.assert_array_equal(one[-1].particles, same[-1].particles)
    assert [e.box for e in one] != [e.box for e in other]


def test_starting_again_begins_the_random_sequence_anew():
    frames = walk(10)
    tracker = Tracker.from_preset("default", seed=3)
    assert [e.box for e in run(tracker, frames)] == [e.box for e in run(tracker, frames)]


@every_preset
def test_the_estimate_is_complete_and_consistent(preset):
    frames = walk(10)
    estimate = run(Tracker.from_preset(preset), frames)[-1]
    count = len(estimate.weights)
    assert estimate.weights.sum() == pytest.approx(1.0)
    assert estimate.particles.shape[0] == estimate.particle_boxes.shape[0] == count
    assert estimate.particle_boxes.shape == (count, 4)
    assert 1.0 <= estimate.effective_sample_size <= count
    assert 0.0 <= estimate.confidence <= 1.0
    assert sum(estimate.powers.values()) == pytest.approx(1.0)
    centers = estimate.particle_boxes[:, :2] + estimate.particle_boxes[:, 2:] / 2
    of_particles = np.cov(centers.T, aweights=estimate.weights, ddof=0)
    if PRESETS[preset].get("proposal.search_share"):
        # The box is that of the likeliest mode, and the target may be in another.
        np.testing.assert_allclose(center(estimate.box), estimate.weights @ centers, atol=0.5)
        assert np.linalg.eigvalsh(estimate.covariance - of_particles).min() > 0.0
    else:
        np.testing.assert_allclose(center(estimate.box), estimate.weights @ centers)
        np.testing.assert_allclose(estimate.covariance, of_particles)
    assert all(isinstance(value, float) for value in estimate.box)


def test_the_first_estimate_is_the_given_box_with_full_confidence():
    image, box = frame(100, 100)
    estimate = Tracker.from_preset("li2007").start(image, box)
    assert estimate.box == pytest.approx(box)
    assert (estimate.state, estimate.confidence) == ("tracking", 1.0)


@every_preset
def test_while_hidden_the_covariance_grows_and_then_the_target_is_found_again(preset):
    tracker = Tracker.from_preset(preset)
    estimates = run(tracker, walk(30))
    assert estimates[-1].state == "tracking"
    hidden = []
    for t in range(30, 34):
        image, _ = frame(60 + 3.0 * t, 120 + 30 * np.sin(t / 8), visible=False)
        hidden.append(tracker.update(image))
    assert {estimate.state for estimate in hidden} == {"occluded"}
    traces = [np.trace(estimate.covariance) for estimate in hidden]
    # What a search covers goes with the size of the box, which may shrink a little meanwhile.
    least = 0.998 if PRESETS[preset].get("proposal.search_share") else 1.0
    assert all(later > least * earlier for earlier, later in itertools.pairwise(traces))
    assert traces[-1] > 2 * np.trace(estimates[-1].covariance)
    for t in range(34, 44):
        image, box = frame(60 + 3.0 * t, 120 + 30 * np.sin(t / 8))
        estimate = tracker.update(image)
    assert estimate.state == "tracking"
    assert overlap(estimate.box, box) > 0.5


def test_while_hidden_the_target_moves_on_at_its_velocity():
    """With little noise of the position, the velocity is what explains the motion."""
    parameters = {"motion.position_noise": 0.1, "motion.velocity_noise": 2.0}
    tracker = Tracker.from_preset("li2007", parameters=parameters | {"particles": 300})
    seen = run(tracker, [frame(60 + 3.0 * t, 120) for t in range(30)])[-1]
    for _ in range(6):
        hidden = tracker.update(BACKGROUND)
    assert hidden.state == "occluded"
    moved = center(hidden.box) - center(seen.box)
    np.testing.assert_allclose(moved, [18.0, 0.0], atol=6.0)


@every_preset
def test_a_target_hidden_for_too_long_is_lost(preset):
    parameters = {"track.lost_after": 0.5}
    tracker = Tracker.from_preset(preset, parameters=parameters)
    run(tracker, walk(20))
    states = [tracker.update(BACKGROUND, dt=0.1).state for _ in range(8)]
    assert states == ["occluded"] * 4 + ["lost"] * 4


@every_preset
def test_the_search_for_a_lost_target_does_not_grow_without_end(preset):
    parameters = {"track.lost_after": 0.5}
    tracker = Tracker.from_preset(preset, parameters=parameters)
    run(tracker, walk(20))
    lost = [tracker.update(BACKGROUND, dt=0.1) for _ in range(60)][5:]
    assert {estimate.state for estimate in lost} == {"lost"}
    traces = [np.trace(estimate.covariance) for estimate in lost]
    assert max(traces) < 2 * traces[0]
    assert lost[0].box != lost[1].box
    image, box = frame(60 + 3.0 * 20, 120 + 30 * np.sin(20 / 8))
    for _ in range(30):
        found = tracker.update(image)
    assert found.state == "tracking"
    assert overlap(found.box, box) > 0.5


def test_templates_freeze_while_hidden():
    """After a long look at the background the target itself still fits as before."""
    frames = walk(20)
    parameters = {"track.lost_after": 1000.0, "track.confidence_rate": 1.0}
    tracker = Tracker.from_preset("default", parameters=parameters)
    before = run(tracker, frames)[-1].confidence
    for _ in range(50):
        tracker.update(BACKGROUND, dt=0.001)
    assert tracker.update(frames[-1][0], dt=0.001).confidence > 0.5 * before


def confidence_after_a_change(**template):
    """The confidence in a target that has turned, little by little, into another one."""
    other = texture(9, (SIDE, SIDE), 0, 250)
    parameters = {"template.update_above": 0.0, "template.keep": 0.5, "track.occluded_below": 0.0}
    parameters |= {f"template.{name}": value for name, value in template.items()}
    tracker = Tracker.from_preset("li2007", parameters=parameters)
    image, box = frame(100, 120)
    left, top, side, _ = box
    tracker.start(image, box)
    for share in np.linspace(0.0, 1.0, 31):
        changed = cv2.addWeighted(TARGET, 1.0 - share, other, share, 0.0)
        image[top : top + side, left : left + side] = changed
        estimate = tracker.update(image)
    return estimate.confidence


def test_what_was_learned_vouches_for_a_change():
    assert confidence_after_a_change() > 0.85


def test_nothing_is_learned_below_the_confidence_that_it_takes():
    assert confidence_after_a_change(confident_above=1.0, settling_frames=1) < 0.7
    likely = confidence_after_a_change(confident_above=0.3, settling_frames=1)
    assert likely == confidence_after_a_change()


def test_the_first_frames_are_learned_from_whatever_the_confidence():
    """The change takes 31 frames, for which a confidence of .003 at most is asked for."""
    settling = confidence_after_a_change(confident_above=1.0, settling_frames=10000)
    assert settling == confidence_after_a_change()


def test_time_between_frames_counts():
    """At half the frame rate the target moves twice as far a frame, and dt says so."""
    frames = walk(40)[::2]
    tracker = Tracker.from_preset("default")
    tracker.start(*frames[0])
    for image, box in frames[1:]:
        estimate = tracker.update(image, dt=0.08)
        assert overlap(estimate.box, box) > 0.5


@every_preset
def test_a_gap_of_days_is_no_error(preset, recwarn):
    tracker = Tracker.from_preset(preset)
    run(tracker, walk(5))
    for gap in (86_400.0 * 30, 0.0, 1e300):
        assert np.isfinite(tracker.update(BACKGROUND, dt=gap).box).all()
    assert not recwarn.list


def test_no_time_no_spread():
    parameters = {"motion.prior_position": 0.0}
    tracker = Tracker.from_preset("li2007", parameters=parameters)
    tracker.start(*frame(100, 100))
    estimate = tracker.update(frame(100, 100)[0], dt=0.0)
    np.testing.assert_allclose(estimate.covariance, 0.0, atol=1e-9)


@pytest.mark.parametrize("edge", [(2, 120), (318, 120), (160, 2), (160, 238)])
@every_preset
def test_a_target_that_leaves_the_image_is_no_error(preset, edge):
    tracker = Tracker.from_preset(preset)
    tracker.start(BACKGROUND, (edge[0] - 18, edge[1] - 18, 36, 36))
    for _ in range(20):
        estimate = tracker.update(BACKGROUND)
        assert np.isfinite(estimate.box).all()


@every_preset
@pytest.mark.parametrize("value", [0, 255])
def test_a_flat_image_is_no_error(preset, value):
    tracker = Tracker.from_preset(preset)
    run(tracker, walk(5))
    for _ in range(5):
        estimate = tracker.update(np.full_like(BACKGROUND, value))
    assert np.isfinite(estimate.box).all()
    assert estimate.state == "occluded"


def test_starting_on_a_flat_image_is_no_error():
    flat = np.zeros((100, 100), np.uint8)
    estimates = run(Tracker.from_preset("default"), [(flat, (40, 40, 20, 20))] * 5)
    assert np.isfinite(estimates[-1].box).all()


def test_a_box_of_the_whole_image_and_one_of_a_pixel_are_no_error():
    for box in [(0, 0, WIDTH, HEIGHT), (100, 100, 1, 1)]:
        estimates = run(Tracker.from_preset("default"), [(BACKGROUND, box)] * 5)
        assert np.isfinite(estimates[-1].box).all()


def test_a_large_target_is_looked_at_reduced_and_still_followed():
    large = texture(3, (900, 1200), 90, 160)
    sprite = cv2.resize(TARGET, (300, 300), interpolation=cv2.INTER_CUBIC)
    frames = []
    for t in range(15):
        image = large.copy()
        image[200:500, 100 + 10 * t : 400 + 10 * t] = sprite
        frames.append((image, (100 + 10 * t, 200, 300, 300)))
    estimates = run(Tracker.from_preset("default"), frames)
    assert overlap(estimates[-1].box, frames[-1][1]) > 0.7


@pytest.mark.parametrize(
    ("box", "complaint"),
    [
        ((10, 10, 0, 20), "too small"),
        ((10, 10, -5, 20), "too small"),
        ((10, 10, 321, 20), "larger than the image, 320 x 240"),
        ((400, 10, 20, 20), "outside the image, 320 x 240"),
        ((-30, 10, 20, 20), "outside the image"),
        ((10, 10, float("nan"), 20), "finite"),
        ((10, 10, float("inf"), 20), "finite"),
        ((10, 10, 20), "four"),
        ("here", "four"),
        (None, "four"),
        (("10", "10", "20", "20"), "four finite numbers"),
        ((10, 10, 20, "20"), "four finite numbers"),
        (np.array(["10", "10", "20", "20"]), "four finite numbers"),
        ((10, 10, 20, None), "four finite numbers"),
        (np.array([10, 10, 20, None]), "four finite numbers"),
        (np.array([10, 10, 20, 20], dtype=object), "four finite numbers"),
        ((10, True, 20, 20), "four finite numbers"),
        (np.ones(4, bool), "four finite numbers"),
        ((10, 10, 20, 20j), "four finite numbers"),
        (np.full(4, np.timedelta64(20, "s")), "four finite numbers"),
        ([[10, 10, 20, 20]], "four finite numbers"),
        (((10, 10), (20, 20)), "four finite numbers"),
        ((10, 10, (20, 20)), "four finite numbers"),
        ({"x": 10, "y": 10, "width": 20, "height": 20}, "four finite numbers"),
        ((10, 10, 20, 10**400), "four finite numbers"),
    ],
)
def test_a_bad_box_is_refused_and_the_target_before_is_kept(box, complaint):
    tracker = Tracker.from_preset("li2007")
    tracker.start(*frame(100, 100))
    before = tracker.estimate
    with pytest.raises(ValueError, match=complaint):
        tracker.start(BACKGROUND, box)
    assert tracker.estimate is before


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((240, 320, 4), np.uint8),
        np.zeros((240, 320, 3), np.float32),
        np.zeros((240, 320), np.int16),
        np.zeros((0, 320), np.uint8),
        np.zeros(320, np.uint8),
        [[0, 1], [2, 3]],
        np.zeros((100, 320, 3), np.uint8),
        np.zeros((240, 320), np.uint8),
    ],
)
def test_a_bad_image_is_refused_and_the_target_is_kept(image):
    tracker = Tracker.from_preset("li2007")
    tracker.start(*frame(100, 100))
    before = tracker.estimate
    with pytest.raises(ValueError, match="image is"):
        tracker.update(image)
    assert tracker.estimate is before
    assert overlap(tracker.update(frame(100, 100)[0]).box, frame(100, 100)[1]) > 0.6


@pytest.mark.parametrize("kind", [tuple, list, np.array, np.float32, np.uint8])
def test_a_box_of_any_numbers_is_taken(kind):
    tracker = Tracker.from_preset("li2007")
    estimate = tracker.start(BACKGROUND, kind((10, 12, 20, 24)))
    assert estimate.box == (10.0, 12.0, 20.0, 24.0)
    numbers = (np.float32(10), np.int64(12), np.array(20), 24.0)
    assert tracker.start(BACKGROUND, numbers) == estimate


@pytest.mark.parametrize(
    "interval",
    [
        *(-0.1, float("nan"), float("inf"), np.float32("nan")),
        pytest.param(10**400, id="too large for a float"),
        *("0.04", b"0.04", True, np.True_, 0.04 + 0j, np.complex64(1), object(), {}),
        *([], [0.04], (None,), np.array([0.04]), np.array([None]), np.array(None)),
        *(np.array("0.04"), timedelta(seconds=0.04), np.timedelta64(40, "ms")),
    ],
)
def test_a_bad_interval_is_refused(interval):
    tracker = Tracker.from_preset("li2007")
    tracker.start(*frame(100, 100))
    before = tracker.estimate
    with pytest.raises(ValueError, match=r"dt is .*; allowed: a finite number of seconds from 0"):
        tracker.update(BACKGROUND, dt=interval)
    assert tracker.estimate is before


@pytest.mark.parametrize(
    "interval", [2, 2.0, np.float32(2), np.float64(2), np.int8(2), np.array(2)]
)
def test_any_real_number_is_an_interval(interval):
    trackers = [Tracker.from_preset("li2007") for _ in range(2)]
    for tracker in trackers:
        tracker.start(*frame(100, 100))
    given, expected = (
        tracker.update(BACKGROUND, dt=dt)
        for tracker, dt in zip(trackers, (interval, 2.0), strict=True)
    )
    assert given == expected


def test_an_update_without_a_target_says_to_start():
    tracker = Tracker.from_preset("default")
    with pytest.raises(RuntimeError, match="call start"):
        tracker.update(BACKGROUND)
    tracker.start(*frame(100, 100))
    tracker.stop()
    assert not tracker.started
    assert tracker.estimate is None
    with pytest.raises(RuntimeError, match="call start"):
        tracker.update(BACKGROUND)


def test_an_unknown_preset_or_parameter_names_what_there_is():
    with pytest.raises(ParameterError, match=r"'fast'; there are: default, li2007"):
        Tracker.from_preset("fast")
    with pytest.raises(ParameterError, match=r"'particle'; there are: particles"):
        Tracker.from_preset("default", parameters={"particle": 3})


def test_parameters_change_without_losing_the_target():
    frames = walk(20)
    tracker = Tracker.from_preset("default")
    run(tracker, frames[:10])
    tracker.set_parameters({"particles": 500, "color_histogram.power": 0.2})
    tracker.update(frames[10][0])
    estimate = tracker.update(frames[11][0])
    assert len(estimate.weights) == 500
    assert overlap(estimate.box, frames[11][1]) > 0.6
    assert tracker.parameters["color_histogram.power"] == 0.2


@pytest.mark.parametrize("only", CUES)
def test_cues_are_switched_off_and_on_while_tracking(only):
    frames = walk(24)
    tracker = Tracker.from_preset("default")
    run(tracker, frames[:8])
    # Only cues that cost next to nothing for a box more can search.
    alone = {"proposal.search_share": 0.0, "foreground_probability.own_size": True}
    for powers, part in [
        ({f"{cue}.power": float(cue == only) for cue in CUES} | alone, frames[8:16]),
        ({f"{cue}.power": 0.3 for cue in CUES}, frames[16:]),
    ]:
        tracker.set_parameters(powers)
        for image, box in part:
            assert overlap(tracker.update(image).box, box) > 0.5


def test_refused_parameters_change_nothing():
    tracker = Tracker.from_preset("default")
    before = tracker.parameters
    for values in (
        {"particles": 500, "color_histogram.power": 7.0},
        {f"{cue}.power": 0.0 for cue in CUES},
    ):
        with pytest.raises(ParameterError):
            tracker.set_parameters(values)
        assert tracker.parameters == before


def test_a_read_only_parameter_changes_only_without_a_target():
    tracker = Tracker.from_preset("default")
    tracker.start(*frame(100, 100))
    with pytest.raises(ParameterError, match="stop first"):
        tracker.set_parameters({"gradient_orientation.cells": 3})
    tracker.stop()
    tracker.set_parameters({"gradient_orientation.cells": 3})
    assert tracker.parameters["gradient_orientation.cells"] == 3


def test_motion_noise_changes_while_tracking():
    tracker = Tracker.from_preset("li2007")
    tracker.start(*frame(100, 100))
    narrow = np.trace(tracker.update(BACKGROUND, dt=0.04).covariance)
    tracker.set_parameters({"motion.position_noise": 20.0})
    assert np.trace(tracker.update(BACKGROUND, dt=0.04).covariance) > 5 * narrow


def test_estimates_cannot_be_changed_in_place():
    estimate = Tracker.from_preset("default").start(*frame(100, 100))
    for array in (
        estimate.particles,
        estimate.particle_boxes,
        estimate.weights,
        estimate.covariance,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_an_image_that_is_reused_by_the_caller_does_no_harm():
    """Cameras hand out one buffer again and again."""
    frames = walk(10)
    buffer = np.empty_like(frames[0][0])
    fresh = run(Tracker.from_preset("default"), frames)
    tracker = Tracker.from_preset("default")
    buffer[:] = frames[0][0]
    tracker.start(buffer, frames[0][1])
    for (image, _), expected in zip(frames[1:], fresh, strict=True):
        buffer[:] = image
        assert tracker.update(buffer).box == expected.box
