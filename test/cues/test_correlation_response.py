"""The correlation response cue finds a target that moved."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from common import grain

from pf_tracker_ros.cues.correlation_response import (
    CoarseCorrelationResponse,
    CoarseCorrelationResponseParameters,
    CorrelationResponse,
    CorrelationResponseParameters,
)
from pf_tracker_ros.cues.cue import PredictedTarget
from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors
from pf_tracker_ros.frames import Frame, Region

BOX = np.array([140.0, 100.0, 40.0, 32.0])
CUE = CorrelationResponse(CorrelationResponseParameters())


def cue_with(**settings):
    """The cue with other values of its class attributes."""
    return type("Cue", (CorrelationResponse,), settings)(CorrelationResponseParameters())


ONE_SIZE = cue_with(size_span=1.0)


def texture(seed, height, width):
    return grain(seed, height, width).astype(np.uint8)


def frame(x=140, y=100, seed=0):
    """A textured target of 40 x 32 px at (x, y) before a textured background."""
    image = texture(seed, 240, 320)
    image[y : y + 32, x : x + 40] = texture(99, 32, 40)
    return image


def region_of(image, boxes=BOX):
    return Region(Frame(image), np.atleast_2d(boxes))


def boxes_around(box, reach=24):
    """(49 * 49, 4) boxes at every whole pixel up to `reach` from a box, and their offsets."""
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    return box + np.column_stack([offsets, np.zeros_like(offsets)]), offsets


@pytest.fixture(scope="module")
def template():
    return CUE.learn(region_of(frame()), BOX)


def test_the_learned_box_has_response_one(template):
    """Exactly in its own size; almost when interpolated between two sizes."""
    region = region_of(frame())
    assert ONE_SIZE.response(region, BOX[None], template)[0] == pytest.approx(1.0, abs=1e-4)
    assert ONE_SIZE.log_likelihood(region, BOX[None], template)[0] == pytest.approx(0.0, abs=0.01)
    assert 0.97 < CUE.response(region, BOX[None], template)[0] <= 1.0


@pytest.mark.parametrize(("right", "down"), [(0, 0), (12, -8), (-7, 5), (20, 15), (-16, -19)])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_target_that_moved_is_found_at_its_displacement(template, right, down, seed):
    """With the learned background and with another; within the map's resolution of 2 px."""
    boxes, offsets = boxes_around(BOX)
    region = region_of(frame(140 + right, 100 + down, seed), boxes)
    responses = CUE.response(region, boxes, template)
    found = offsets[responses.argmax()]
    assert np.abs(found - (right, down)).max() <= 2
    far = np.hypot(*(offsets - (right, down)).T) > 12
    assert responses.max() > 2 * responses[far].max()
    np.testing.assert_allclose(
        CUE.log_likelihood(region, boxes, template), -100.0 * (1.0 - responses), atol=1e-9
    )


def test_a_gray_target_that_moved_is_found_in_images_of_one_channel_and_of_three():
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (frame(), frame(131, 110))]
    boxes, offsets = boxes_around(BOX)
    by_channels = []
    for first, second in (gray, [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in gray]):
        template = CUE.learn(region_of(first), BOX)
        by_channels.append(CUE.response(region_of(second, boxes), boxes, template))
    np.testing.assert_array_equal(*by_channels)
    assert np.abs(offsets[by_channels[0].argmax()] - (-9, 10)).max() <= 2


@pytest.mark.parametrize("second_kind", ["gray", "colored"])
def test_a_camera_may_switch_between_colors_and_gray(second_kind):
    """As with a night mode; the features stay those of the template."""
    colored = [frame(), frame(131, 110)]
    gray = [
        cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        for image in colored
    ]
    first, second = (colored[0], gray[1]) if second_kind == "gray" else (gray[0], colored[1])
    template = CUE.learn(region_of(first), BOX)
    boxes, offsets = boxes_around(BOX)
    region = region_of(second, boxes)
    found = offsets[CUE.response(region, boxes, template).argmax()]
    assert np.abs(found - (-9, 10)).max() <= 2
    blended = CUE.blend(template, CUE.observe(region, BOX + [-9, 10, 0, 0]))
    assert blended.filter.shape == template.filter.shape


def sized(factor):
    """BOX with its sides multiplied around its center."""
    center, sides = BOX[:2] + BOX[2:] / 2, factor * BOX[2:]
    return np.concatenate([center - sides / 2, sides])


def zoomed(growth):
    """The frame, scaled around the center of BOX."""
    zoom = cv2.getRotationMatrix2D(tuple(BOX[:2] + BOX[2:] / 2), 0.0, growth)
    return cv2.warpAffine(frame(), zoom, (320, 240), flags=cv2.INTER_LINEAR)


@pytest.mark.parametrize("growth", [1.02, 1 / 1.02])
def test_a_target_that_grew_or_shrank_has_the_largest_response_in_its_new_size(growth):
    cue = cue_with(size_span=1.04)
    template = cue.learn(region_of(frame()), BOX)
    boxes = np.array([sized(factor) for factor in (1 / growth, 1.0, growth)])
    responses = cue.response(region_of(zoomed(growth), BOX), boxes, template)
    assert np.array_equal(np.argsort(responses), [0, 1, 2])


def test_a_target_of_the_same_size_has_equal_responses_in_a_smaller_and_a_larger_one(template):
    """The difference is much smaller than for a target that grew or shrank.

    With the bias of this texture; that of footage differs by its own.
    """
    cue = cue_with(size_bias=0.002)
    boxes = np.array([sized(1 / 1.02), sized(1.02)])
    differences = {
        growth: np.diff(cue.response(region_of(zoomed(growth)), boxes, template))[0]
        for growth in (1 / 1.02, 1.0, 1.02)
    }
    assert differences[1 / 1.02] < 0.0 < differences[1.02]
    assert abs(differences[1.0]) < 0.2 * min(differences[1.02], -differences[1 / 1.02])


def test_responses_are_interpolated_between_the_sizes_and_constant_beyond(template):
    region = region_of(zoomed(1.01))
    at = {
        power: CUE.response(region, sized(1.02**power)[None], template)[0]
        for power in (-5, -1, -0.5, 0, 0.5, 1, 5)
    }
    assert at[1] - at[-1] > 0.001
    # The size ratio of the two windows, 1.04, is a little less than 1.02 squared.
    assert at[0] == pytest.approx((at[-1] + at[1]) / 2, abs=1e-4)
    assert at[-0.5] == pytest.approx(0.75 * at[-1] + 0.25 * at[1], abs=1e-4)
    assert at[0.5] == pytest.approx(0.25 * at[-1] + 0.75 * at[1], abs=1e-4)
    assert (at[-5], at[5]) == pytest.approx((at[-1], at[1]), abs=1e-4)


@pytest.mark.parametrize("growth", [-0.1, -0.05, 0.05, 0.1])
def test_responses_tell_how_much_the_target_grew(template, growth):
    image = zoomed(np.exp(growth))
    assert 0.3 < CUE.log_growth(region_of(image), BOX, template) / growth < 2.0
    assert abs(CUE.log_growth(region_of(frame()), BOX, template)) < 0.02
    # One window tells nothing.
    assert ONE_SIZE.log_growth(region_of(image), BOX, template) == 0.0
    fixed = Region(Frame(image), BOX[None], estimates_size=False)
    assert CUE.log_growth(fixed, BOX, template) == 0.0


def test_when_the_size_is_not_estimated_boxes_are_read_in_the_predicted_size(template):
    region = Region(Frame(zoomed(1.02)), BOX[None], estimates_size=False)
    boxes = np.array([sized(1.02**power) for power in (-1, 0, 1)])
    expected = ONE_SIZE.response(region_of(zoomed(1.02)), boxes, template)
    assert np.array_equal(CUE.response(region, boxes, template), expected)
    assert np.ptp(expected) < 1e-6


def test_the_largest_number_of_particles_is_read(template):
    few, _ = boxes_around(BOX, 24)
    region = region_of(frame(), few)
    responses = CUE.response(region, few, template)
    many = np.resize(few, (100_000, 4))
    expected = np.resize(responses, 100_000)
    np.testing.assert_array_equal(CUE.response(region, many, template), expected)


def test_far_outside_of_the_window_there_is_no_response(template):
    region = region_of(frame())
    CUE.response(region, BOX[None], template)
    far = BOX + [[90, 0, 0, 0], [0, -90, 0, 0], [1000, 1000, 0, 0]]
    np.testing.assert_array_equal(CUE.response(region, far, template), 0.0)


def test_a_target_at_the_image_s_corner_is_learned_and_found():
    image = frame(0, 0)[4:, 6:]
    box = np.array([-6.0, -4.0, 40.0, 32.0])
    template = CUE.learn(region_of(image, box), box)
    boxes, offsets = boxes_around(box, 8)
    responses = CUE.response(region_of(image, boxes), boxes, template)
    assert np.abs(offsets[responses.argmax()]).max() <= 1


def test_match_has_the_likelihood_of_the_one_box(template):
    boxes, _ = boxes_around(BOX, 4)
    region = region_of(frame(), boxes)
    log_likelihood = CUE.log_likelihood(region, boxes, template)
    for number in (0, 17, 40):
        match = CUE.match(CUE.observe(region, boxes[number]), template)
        assert match.log_likelihood == pytest.approx(log_likelihood[number])


def test_the_similarity_is_high_for_a_single_clear_peak(template):
    """High for the target in any position; low without it, and lower among copies of it."""

    def similarity(image):
        return CUE.match(CUE.observe(region_of(image), BOX), template).similarity

    assert similarity(frame()) > 0.95
    assert similarity(frame(150, 95)) > 0.9
    assert similarity(texture(0, 240, 320)) < 0.1
    copies = frame()
    for x, y in ((95, 100), (185, 100), (140, 62), (140, 138), (95, 62), (185, 138)):
        copies[y : y + 32, x : x + 40] = texture(99, 32, 40)
    assert 1 - similarity(copies) > 1.5 * (1 - similarity(frame()))


def test_each_of_the_first_blends_trains_with_decreasing_effect(template):
    """With the default of 25 frames."""
    observation = CUE.observe(region_of(frame(seed=1)), BOX)
    changes = []
    for frames in (1, 5, 24):
        trained = CUE.blend(replace(template, frames=frames), observation)
        assert (trained.frames, trained.frames_since_training) == (frames + 1, 0)
        changes.append(np.abs(trained.filter - template.filter).mean())
    assert changes == sorted(changes, reverse=True)
    assert changes[0] > 1.5 * changes[-1]


def test_a_window_of_the_frame_serves_for_training_near_it_and_no_other(template, monkeypatch):
    """Within a cell and 3 % of the size; read anew elsewhere, and for the first 25 frames."""
    reads = []
    read = CorrelationResponse._features_of

    def features(self, patches, colored):
        reads.append(len(patches))
        return read(self, patches, colored)

    due = replace(template, frames=25, frames_since_training=2)
    cell = 4.0 * np.sqrt(40.0 * 32.0) / 40
    region = region_of(frame())
    CUE.response(region, BOX[None], template)
    monkeypatch.setattr(CorrelationResponse, "_features_of", features)

    def trained(shift, template=due, growth=1.0):
        box = BOX + [shift, 0.0, 0.0, 0.0]
        box[2:] *= growth
        reads.clear()
        return CUE.blend(template, CUE.observe(region, box)), list(reads)

    near, is_read = trained(0.9 * cell)
    assert (near.frames_since_training, is_read) == (0, [])
    apart, is_read = trained(1.2 * cell)
    assert is_read == [1]
    assert trained(0.0, growth=1.03)[1] == [1]
    assert trained(0.0, replace(due, frames=24))[1] == [1]
    # Both filters are of nearly the same windows.
    own = CUE.response(region, BOX[None] + [cell, 0.0, 0.0, 0.0], near)
    assert own == pytest.approx(
        CUE.response(region, BOX[None] + [cell, 0.0, 0.0, 0.0], apart), abs=0.05
    )


def test_then_only_every_third_blend_trains(template):
    """With the default interval of 3; the frames between have no effect."""
    template = replace(template, frames=25)
    others = []
    for between in (frame(), frame(seed=5)):
        observation = CUE.observe(region_of(between), BOX)
        first = CUE.blend(template, observation)
        second = CUE.blend(first, observation)
        assert (first.frames_since_training, second.frames_since_training) == (1, 2)
        for untrained in (first, second):
            assert untrained.filter is template.filter
            assert untrained.reference == template.reference
        trained = CUE.blend(second, CUE.observe(region_of(frame(seed=1)), BOX))
        assert trained.frames_since_training == 0
        assert trained.target_cells == template.target_cells
        others.append(trained)
    assert np.abs(others[0].filter - template.filter).max() > 0
    np.testing.assert_array_equal(others[0].filter, others[1].filter)
    # Response 1 is that to the last training window.
    region = region_of(frame(seed=1))
    assert ONE_SIZE.response(region, BOX[None], others[0])[0] == pytest.approx(1.0, abs=1e-4)


def test_more_memory_adapts_slower(template):
    changes = []
    for memory in (0.0, 10.0, 300.0, 10000.0):
        cue = cue_with(memory=memory, training_interval=1, settling_frames=1)
        trained = cue.blend(template, cue.observe(region_of(frame(seed=1)), BOX))
        changes.append(np.abs(trained.filter - template.filter).mean())
    assert changes == sorted(changes, reverse=True)
    assert changes[0] > 10 * changes[-1]


def test_the_template_of_an_observation_equals_the_learned_one(template):
    region = region_of(frame())
    converted = CUE.template_from(CUE.observe(region, BOX))
    np.testing.assert_array_equal(converted.filter, template.filter)
    assert converted.reference == template.reference
    assert converted.target_cells == template.target_cells


def test_templates_do_not_depend_on_an_image_buffer_overwritten_later(template):
    buffer = frame()
    cue = cue_with(training_interval=1)
    learned = replace(cue.learn(region_of(buffer), BOX), frames=25)
    untrained = CUE.blend(learned, CUE.observe(region_of(buffer), BOX))
    trained = cue.blend(learned, cue.observe(region_of(buffer), BOX))
    buffer[:] = 0
    for kept in (learned, untrained, trained):
        boxes, offsets = boxes_around(BOX, 6)
        responses = ONE_SIZE.response(region_of(frame(), boxes), boxes, kept)
        assert np.abs(offsets[responses.argmax()]).max() <= 1
        assert responses.max() == pytest.approx(1.0, abs=1e-2)
    np.testing.assert_array_equal(learned.filter, CUE.learn(region_of(frame()), BOX).filter)


@pytest.mark.parametrize("cells", [24, 32])
def test_the_window_has_the_given_number_of_cells(cells):
    cue = cue_with(cells=cells)
    learned = cue.learn(region_of(frame()), BOX)
    assert learned.filter.shape == (16, cells, cells // 2 + 1)
    boxes, offsets = boxes_around(BOX, 8)
    responses = cue.response(region_of(frame(), boxes), boxes, learned)
    assert np.abs(offsets[responses.argmax()]).max() <= 1


def test_templates_do_not_share_a_response(template):
    """Two templates read the same region."""
    region = region_of(frame())
    other = CUE.learn(region_of(frame(170, 120)), BOX)
    own = CUE.response(region, BOX[None], template)
    assert CUE.response(region, BOX[None], other)[0] < own[0]
    assert CUE.response(region, BOX[None], template)[0] == own[0]


def test_precomputing_for_several_targets_does_not_change_results(monkeypatch):
    """Also when one is gray and another does not estimate its size; in fewer, larger batches."""
    cue = CoarseCorrelationResponse(CoarseCorrelationResponseParameters())
    gray = np.ascontiguousarray(frame()[..., 1])
    targets = [
        (image, BOX + offset, estimates_size)
        for image, offset, estimates_size in (
            (frame(), (0.0, 0.0, 0.0, 0.0), True),
            (gray, (0.0, 0.0, 0.0, 0.0), True),
            (frame(), (9.0, 4.0, 6.0, -3.0), False),
            (frame(), (-120.0, -90.0, 0.0, 9.0), True),
            (frame(), (40.0, 20.0, -9.0, -9.0), True),
        )
    ]
    learned = [cue.learn(region_of(image, box), box) for image, box, _ in targets]
    calls = []
    extract = GradientsAndColors.extract

    def counted(self, windows):
        calls.append(len(windows))
        return extract(self, windows)

    monkeypatch.setattr(GradientsAndColors, "extract", counted)

    def results(precomputes):
        calls.clear()
        regions = [
            Region(Frame(image), box[None], estimates_size=sized) for image, box, sized in targets
        ]
        predicted_targets = [PredictedTarget(*one) for one in zip(regions, learned, strict=True)]
        if precomputes:
            cue.precompute(predicted_targets)
        found = []
        for predicted, (_, box, _) in zip(predicted_targets, targets, strict=True):
            region, template = predicted
            boxes, _ = boxes_around(box, 3)
            observation = cue.observe(region, box)
            found.append(cue.response(region, boxes, template).tolist())
            found.append(cue.match(observation, template))
            found.append(cue.log_odds(observation, template))
        return found, [*calls]

    apart, together = results(False), results(True)
    assert together[0] == apart[0]
    # The four colored ones share a call; the gray one is alone.
    assert apart[1] == [1, 1, 1, 1, 1]
    assert together[1] == [4, 1]
