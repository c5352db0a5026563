"""Which pixels of a depth image are the target's."""

import numpy as np
import pytest

from pf_tracker_ros.world.box_samples import BoxSamples
from pf_tracker_ros.world.depth import ExpectedDepth, read_depth
from pf_tracker_ros.world.target_colors import color_probability

SIZE = (640, 480)
# A box, and the target in its middle that covers half of its width.
BOX = (260.0, 120.0, 120.0, 240.0)
TARGET = np.s_[120:360, 290:350]


def scene(target=4.0, background=8.0):
    depth = np.full((480, 640), background, np.float32)
    depth[TARGET] = target
    return depth


def read(depth, **arguments):
    return read_depth(depth, BoxSamples.of(BOX, SIZE, depth.shape), **arguments)


@pytest.mark.parametrize("hole", [0.0, np.nan, np.inf, -np.inf])
def test_background_in_half_of_the_box_and_holes(hole):
    depth = scene()
    depth[np.random.default_rng(0).random(depth.shape) < 0.3] = hole
    reading = read(depth)
    assert reading.depth == pytest.approx(4.0)
    assert reading.occlusion == 0.0
    assert reading.row == pytest.approx(0.5, abs=0.03)


def test_millimeters_and_saturated_values():
    """Drivers write 65535 where there is no measurement, or one beyond their range."""
    depth = np.full((480, 640), 65535, np.uint16)
    assert read(depth) is None
    depth[TARGET] = 4000
    assert read(depth).depth == pytest.approx(4.0)
    assert read((scene() * 1000).astype(np.uint16)).depth == pytest.approx(4.0)


def test_the_target_is_not_the_largest_mode_but_the_one_inside_the_box():
    """Background in three quarters of the box goes on around it."""
    depth = scene()
    depth[:, 320:350] = 8.0
    assert read(depth).depth == pytest.approx(4.0)
    # Too few pixels with depth say nothing.
    depth[:] = 0.0
    depth[200, 300:305] = 4.0
    assert read(depth) is None


def test_the_prediction_chooses_between_modes():
    depth = scene()
    depth[100:380, 290:335] = 2.0
    occluder = read(depth, expected=[ExpectedDepth(2.0, 0.2)])
    target = read(depth, expected=[ExpectedDepth(4.1, 0.2)])
    assert occluder.depth == pytest.approx(2.0)
    assert target.depth == pytest.approx(4.0)
    # Of the columns of the box's 120, 45 show what is before the target.
    assert target.occlusion == pytest.approx(45 / 120, abs=0.02)
    assert occluder.occlusion == 0.0
    # Without a prediction, either may be the target.
    assert read(depth).occlusion == pytest.approx(45 / 120, abs=0.02)


def test_noise_leaves_the_median_and_the_prediction_does_not_move_it():
    generator = np.random.default_rng(0)
    depths = []
    for _ in range(30):
        depth = scene()
        depth += generator.normal(0.0, 0.04, depth.shape)
        depth[np.random.default_rng(0).random(depth.shape) < 0.3] = 0.0
        depths.append(read(depth).depth)
    assert np.mean(depths) == pytest.approx(4.0, abs=0.005)
    assert np.std(depths) < 0.01
    for predicted in (3.6, 4.0, 4.4):
        assert read(depth, expected=[ExpectedDepth(predicted, 0.2)]).depth == depths[-1]


def test_nothing_at_the_predicted_distance_is_a_hidden_target():
    depth = scene()
    depth[100:380, 240:400] = 1.5
    reading = read(depth, expected=[ExpectedDepth(4.0, 0.1)])
    assert (reading.depth, reading.occlusion) == (None, 1.0)
    # A guess from the box excludes nothing.
    reading = read(scene(), expected=[ExpectedDepth(1.0, 0.05, floor=0.05)])
    assert reading.depth == pytest.approx(4.0)


def test_a_box_that_shows_only_what_is_before_or_behind_the_target_is_told():
    """A target at 4 m hides what is behind it, whatever covers a part of itself."""
    expected, wall = [ExpectedDepth(4.0, 0.1)], np.full((480, 640), 8.0, np.float32)
    gone = read(wall, expected=expected)
    assert (gone.depth, gone.occlusion, gone.is_unseen) == (None, 0.0, True)
    half_hidden = wall.copy()
    half_hidden[:, :320] = 1.5
    reading = read(half_hidden, expected=expected)
    assert (reading.depth, reading.is_unseen) == (None, True)
    three_quarters_hidden = wall.copy()
    three_quarters_hidden[:, :350] = 1.5
    assert read(three_quarters_hidden, expected=expected).is_unseen
    # A pole at its distance is a tenth of the box; a drone would be a fifth.
    pole, drone = wall.copy(), wall.copy()
    pole[:, 314:326] = drone[:, 308:332] = 4.0
    assert read(pole, expected=expected).is_unseen
    assert read(drone, expected=expected).depth == pytest.approx(4.0)
    # Without depth on three quarters, as of black clothes, the rest is beside the target.
    black = wall.copy()
    black[:, 260:350] = 0.0
    assert not read(black, expected=expected).is_unseen
    assert not read(scene(), expected=expected).is_unseen
    # Nor is a target of colors that are not its own.
    nothing = np.zeros((4, 4))
    samples = BoxSamples.of(BOX, SIZE, wall.shape)
    unknown = read_depth(scene(), samples, samples.resample(nothing), expected)
    assert (unknown.depth, unknown.is_unseen) == (None, False)


def test_what_box_and_depth_say_together_is_no_background():
    wall, predicted = np.full((480, 640), 8.0, np.float32), ExpectedDepth(4.0, 0.1)
    reading = read(wall, expected=[predicted, ExpectedDepth(7.5, 0.8, floor=0.05)])
    assert reading.depth == pytest.approx(8.0)
    assert not reading.is_unseen
    # Something nearer hides the target, even if the box is as large as its own.
    expected = [ExpectedDepth(12.0, 0.3), ExpectedDepth(7.5, 0.8, floor=0.05)]
    reading = read(wall, expected=expected)
    assert (reading.depth, reading.occlusion) == (None, 1.0)


def test_a_part_of_a_target_may_be_nearer_than_its_height_says():
    expected = ExpectedDepth(8.0, 0.3, floor=0.05, is_farthest=True)
    np.testing.assert_allclose(
        expected.log_likelihoods(np.array([1.0, 4.0, 8.0])), np.log(1.05), atol=1e-9
    )
    assert expected.log_likelihoods(np.array([12.0]))[0] < np.log(0.06)


def test_the_map_of_the_target_chooses():
    """Two people of the same size side by side."""
    depth = scene()
    depth[120:360, 320:350] = 5.0
    samples = BoxSamples.of(BOX, SIZE, depth.shape)
    for shares, expected in (((0.9, 0.1), 4.0), ((0.1, 0.9), 5.0)):
        probability = samples.resample(np.array([shares]))
        assert read_depth(depth, samples, probability).depth == pytest.approx(expected)
    nothing = read_depth(depth, samples, samples.resample(np.zeros((4, 4))))
    assert nothing.depth is nothing.occlusion is None


@pytest.mark.parametrize("shape", [(480, 640), (240, 320), (960, 1280), (30, 40)])
@pytest.mark.parametrize("box", [BOX, (0.0, 0.0, 640.0, 480.0), (638.0, 479.0, 2.0, 1.0)])
def test_samples_are_inside_the_array_and_the_box(shape, box):
    samples = BoxSamples.of(box, SIZE, shape)
    assert 0 <= samples.rows.min() <= samples.rows.max() < shape[0]
    assert 0 <= samples.columns.min() <= samples.columns.max() < shape[1]
    inside = samples.take(np.ones(shape))[samples.inside]
    assert inside.shape == (len(samples.down), len(samples.across))
    assert inside.size > 0
    assert 0.0 <= samples.across.min() <= samples.across.max() <= 1.0


def test_the_color_of_the_target_is_more_probable_than_that_around_it():
    image = np.full((480, 640, 3), (200, 60, 60), np.uint8)
    image[TARGET] = (40, 40, 220)
    probability = color_probability(image, BOX, SIZE)
    across = (np.arange(probability.shape[1]) + 0.5) / probability.shape[1]
    is_target = np.abs(across - 0.5) < 0.2
    assert probability[:, is_target].min() > 0.95
    assert probability[:, np.abs(across - 0.5) > 0.3].max() < 0.1
