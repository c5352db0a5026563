"""The tracker on generated images: tracking, repeatability, occlusion, errors."""

import copy
import gc
import itertools
import pickle
import weakref

import cv2
import numpy as np
import pytest
from common import overlap

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, build
from pf_tracker_ros.tracking import target_filter
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS

WIDTH, HEIGHT, SIDE = 320, 240, 36
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


@pytest.mark.parametrize("scale", [0.5, 2.0, 2 / 3])
@every_preset
def test_images_may_change_their_size_at_the_same_aspect_ratio(preset, scale):
    """As in the node and in `track`: the target is rescaled."""
    frames = walk()
    tracker = Tracker.from_preset(preset)
    run(tracker, frames[:8])
    for image, box in frames[8:12]:
        estimate = tracker.update(cv2.resize(image, None, fx=scale, fy=scale))
        assert overlap(estimate.box, scale * np.array(box)) > 0.5
    before = tracker.update(image)
    for other in (image[:, :-20], image[:, :, 0]):
        with pytest.raises(ValueError, match=r"start again to change their type or aspect ratio"):
            tracker.update(other)
    assert overlap(tracker.update(image).box, before.box) > 0.8


def test_li2007_keeps_the_size_of_the_first_box():
    frames = [frame(160, 120, 1.0 + 0.02 * t) for t in range(20)]
    for estimate in run(Tracker.from_preset("li2007"), frames):
        assert estimate.box[2:] == pytest.approx((SIDE, SIDE))


def test_zhang2015_renews_its_template_above_a_similarity_of_065(make_target_filter):
    """The target is blended with another texture until its similarity is just that."""
    target_filter = make_target_filter("zhang2015")
    image, box = frame(100, 120)
    left, top, side, _ = box
    other = texture(9, (SIDE, SIDE), 0, 250)
    state = target_filter.start(image, map(float, box), seed=0)

    def followed(share):
        changed = image.copy()
        patch = cv2.addWeighted(TARGET, 1.0 - share, other, share, 0.0)
        changed[top : top + side, left : left + side] = patch
        return target_filter.follow(state, Frame(changed), 0.04)

    like, unlike = 0.0, 1.0
    assert followed(like).estimate.confidence > 0.65 > followed(unlike).estimate.confidence
    for _ in range(20):
        middle = (like + unlike) / 2
        if followed(middle).estimate.confidence > 0.65:
            like = middle
        else:
            unlike = middle
    above, below = followed(like), followed(unlike)
    for after, renewed in ((above, True), (below, False)):
        assert after.estimate.confidence == pytest.approx(0.65, abs=0.005)
        assert after.estimate.state == "tracking"
        assert np.array_equal(after.templates["hog"], state.templates["hog"]) != renewed
    assert above.estimate.confidence > 0.65 > below.estimate.confidence


def test_zhang2015_follows_through_a_flip_of_polarity():
    """What was brighter than the ground becomes darker, as happens in infrared images."""
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


@every_preset
@pytest.mark.parametrize("seed", [0, 7])
def test_the_first_target_draws_from_the_seed_itself(preset, seed):
    image, box = frame(100, 100)
    estimate = Tracker.from_preset(preset, seed=seed).start(image, box)
    parameters = build(TrackerParameters, PRESETS[preset])
    model = parameters.motion.model
    motion = MOTION_MODELS[model](box, parameters.motion.of_models[model])
    states = motion.sample_prior(parameters.particles, np.random.default_rng(seed))
    np.testing.assert_array_equal(estimate.particles, motion.constrain(states, (WIDTH, HEIGHT)))


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
    assert sum(estimate.cue_weights.values()) == pytest.approx(1.0)
    centers = estimate.particle_boxes[:, :2] + estimate.particle_boxes[:, 2:] / 2
    of_particles = np.cov(centers.T, aweights=estimate.weights, ddof=0)
    if PRESETS[preset].get("proposal.method") == "search":
        # The box is that of one mode; the covariance is that of the errors to expect.
        np.testing.assert_allclose(center(estimate.box), estimate.weights @ centers, atol=0.5)
        assert np.linalg.eigvalsh(estimate.covariance - of_particles).min() > 0.0
    else:
        np.testing.assert_allclose(center(estimate.box), estimate.weights @ centers)
        # The second term is that of rounding to pixels.
        np.testing.assert_allclose(estimate.covariance, of_particles + np.eye(2) / 12)
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
    # The search window scales with the box, which may shrink a little.
    least = 0.998 if PRESETS[preset].get("proposal.method") == "search" else 1.0
    assert all(later > least * earlier for earlier, later in itertools.pairwise(traces))
    assert traces[-1] > 2 * np.trace(estimates[-1].covariance)
    for t in range(34, 44):
        image, box = frame(60 + 3.0 * t, 120 + 30 * np.sin(t / 8))
        estimate = tracker.update(image)
    assert estimate.state == "tracking"
    assert overlap(estimate.box, box) > 0.5


def test_while_hidden_the_target_moves_on_at_its_velocity():
    """With little position noise, the particles have to learn the velocity."""
    parameters = {"motion.position_noise": 0.1, "motion.velocity_noise": 2.0}
    tracker = Tracker.from_preset("li2007", parameters=parameters | {"particles": 300})
    seen = run(tracker, [frame(60 + 3.0 * t, 120) for t in range(30)])[-1]
    for _ in range(6):
        hidden = tracker.update(BACKGROUND)
    assert hidden.state == "occluded"
    moved = center(hidden.box) - center(seen.box)
    np.testing.assert_allclose(moved, [18.0, 0.0], atol=6.0)


@every_preset
def test_the_covariance_of_a_lost_target_is_bounded(preset):
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


def test_templates_freeze_while_hidden(monkeypatch):
    """After many frames of background, the target still matches."""
    frames = walk(20)
    monkeypatch.setattr(target_filter, "RISING_SHARE", 1.0)
    tracker = Tracker.from_preset("default", parameters={"track.lost_after": 1000.0})
    before = run(tracker, frames)[-1].confidence
    for _ in range(50):
        tracker.update(BACKGROUND, dt=0.001)
    assert tracker.update(frames[-1][0], dt=0.001).confidence > 0.5 * before


def confidence_after_a_change(similarity_above=0.0, settled=0):
    """The confidence in a target that changes gradually, after some frames, into another one."""
    other = texture(9, (SIDE, SIDE), 0, 250)
    parameters = {"template.update_above": 0.0, "template.similarity_above": similarity_above}
    parameters |= {"color_histogram.keep": 0.5, "gradient_orientation.keep": 0.5}
    parameters |= {"track.wrong_box_cost": 0.0}
    tracker = Tracker.from_preset("li2007", parameters=parameters)
    image, box = frame(100, 120)
    left, top, side, _ = box
    tracker.start(image, box)
    for _ in range(settled):
        tracker.update(image)
    for share in np.linspace(0.0, 1.0, 31):
        changed = cv2.addWeighted(TARGET, 1.0 - share, other, share, 0.0)
        image[top : top + side, left : left + side] = changed
        estimate = tracker.update(image)
    return estimate.confidence


def test_the_templates_adapt_to_a_gradual_change():
    assert confidence_after_a_change() > 0.85


def test_nothing_is_learned_below_the_required_similarity():
    assert confidence_after_a_change(similarity_above=1.0, settled=40) < 0.7
    likely = confidence_after_a_change(similarity_above=0.3, settled=40)
    assert likely == confidence_after_a_change(settled=40)


def test_the_first_frames_require_less_similarity():
    """In the 31 frames of the change, the required similarity rises to 0.775 only."""
    settling = confidence_after_a_change(similarity_above=1.0)
    assert settling == confidence_after_a_change()


def test_time_between_frames_counts():
    """At half the frame rate, the target moves twice as far in each frame."""
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


@pytest.mark.parametrize("preset", ["li2007", "zhang2015"])
def test_without_elapsed_time_the_particles_stay(preset):
    tracker = Tracker.from_preset(preset)
    first = tracker.start(*frame(100, 100))
    estimate = tracker.update(frame(100, 100)[0], dt=0.0)
    np.testing.assert_allclose(estimate.particle_boxes, first.particle_boxes, atol=1e-9)


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
    with pytest.raises(ParameterError, match=r"'particle'; did you mean 'particles'\?$"):
        Tracker.from_preset("default", parameters={"particle": 3})


FEATURE_CUES = [name for name, cue in CUES.items() if not cue.needs_foreground]


@pytest.mark.parametrize("only", FEATURE_CUES)
def test_cues_are_switched_off_and_on_by_their_weights_while_tracking(only):
    frames = walk(24)
    # Not every cue can search.
    parameters = {"proposal.method": "transition", "cues": FEATURE_CUES}
    tracker = Tracker.from_preset("default", parameters=parameters)
    run(tracker, frames[:8])
    for weights, part in [
        ({f"{cue}.weight": float(cue == only) for cue in FEATURE_CUES}, frames[8:16]),
        ({f"{cue}.weight": 0.3 for cue in FEATURE_CUES}, frames[16:]),
    ]:
        tracker.set_parameters(weights)
        for image, box in part:
            estimate = tracker.update(image)
            assert overlap(estimate.box, box) > 0.5
        used = {cue: weight for cue, weight in estimate.cue_weights.items() if weight > 0.0}
        assert used.keys() == {name.split(".")[0] for name, weight in weights.items() if weight}


def test_refused_parameters_change_nothing():
    tracker = Tracker.from_preset("default")
    tracker.start(*frame(100, 100))
    before, estimate = tracker.parameters, tracker.estimate
    for values in (
        {"particles": 500, "color_contrast.weight": 7.0},
        {"color_contrast.weight": 0.0, "correlation_response.weight": 0.0},
        {"cues": ()},
        {"cues": ("hog", "hog")},
        {"cues": ("color_contrast", "smell")},
        {"cues": ("hog",)},
        {"particles": 500, "hog.weight": 1.5},
    ):
        with pytest.raises(ParameterError):
            tracker.set_parameters(values)
        assert tracker.parameters == before
        assert tracker.estimate is estimate


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("working_size", 60),
        ("correlation_response.window", 3.0),
        ("motion.model", "constant_velocity"),
        ("proposal.method", "transition"),
    ],
)
def test_a_change_that_invalidates_the_templates_relearns_the_last_seen_box(name, value):
    tracker = Tracker.from_preset("default")
    tracker.start(*frame(100, 100))
    before = tracker.update(frame(102, 100)[0])
    tracker.set_parameters({name: value})
    assert tracker.parameters[name] == value
    assert tracker.estimate.box == before.box
    assert tracker.estimate.state == "tracking"
    after = tracker.update(frame(104, 100)[0])
    assert after.state == "tracking"
    assert overlap(after.box, frame(104, 100)[1]) > 0.6
    # No second target was started.
    assert len(tracker._manager.targets) == 1


def test_motion_noise_changes_while_tracking():
    tracker = Tracker.from_preset("li2007")
    tracker.start(*frame(100, 100))
    narrow = np.trace(tracker.update(BACKGROUND, dt=0.04).covariance)
    tracker.set_parameters({"motion.position_noise": 20.0})
    assert np.trace(tracker.update(BACKGROUND, dt=0.04).covariance) > 5 * narrow


def test_an_image_that_is_reused_by_the_caller_does_no_harm():
    """Camera drivers reuse one buffer."""
    frames = walk(10)
    buffer = np.empty_like(frames[0][0])
    fresh = run(Tracker.from_preset("default"), frames)
    tracker = Tracker.from_preset("default")
    buffer[:] = frames[0][0]
    tracker.start(buffer, frames[0][1])
    for (image, _), expected in zip(frames[1:], fresh, strict=True):
        buffer[:] = image
        assert tracker.update(buffer).box == expected.box


def test_the_name_of_a_preset_is_no_set_of_parameters():
    with pytest.raises(TypeError, match=r"parameters is 'default'; .* Tracker\.from_preset"):
        Tracker("default")


def test_a_copied_tracker_does_not_contain_images():
    image = np.random.default_rng(0).integers(0, 256, (1000, 1000, 3), dtype=np.uint8)
    tracker = Tracker.from_preset("default", seed=5)
    tracker.start(image, (400.0, 400.0, 40.0, 40.0))
    tracker.update(image)
    for copied in (copy.copy(tracker), copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))):
        assert len(pickle.dumps(copied)) < image.nbytes / 3


def sixteen_bit(image):
    return image.mean(axis=2).astype(np.uint16) * 30 + 7000


@pytest.mark.parametrize("kind", ["color", "sixteen bit", "reduced"])
@every_preset
def test_an_old_frame_is_released_at_once(preset, kind, couple):
    """Without the garbage collector, which does not know how large an image is."""
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
        for image in images[1:]:
            tracker.update(image)
            seen.append(weakref.ref(tracker._manager.last_frame))
        assert sum(one() is not None for one in seen) == 1
    finally:
        gc.enable()
