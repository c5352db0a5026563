"""The cluttered street: exact ground truth, and a level of clutter that does what it says."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from scenes import ClutteredStreet
from scenes.clutter import MOST_DISTRACTORS, MOST_PATCHES
from scenes.stage import Stage

LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
BARE = {"noise": 0.0, "lighting": 0.0}


@pytest.fixture(scope="module", params=[0, 1])
def streets(request):
    """The same street at growing levels of clutter, without noise."""
    return [ClutteredStreet(request.param, BARE | {"clutter": level}) for level in LEVELS]


def test_same_seed_same_bits_another_seed_another_scene():
    one, same, other = (ClutteredStreet(seed).render(30) for seed in (3, 3, 4))
    assert one.shape == (480, 640, 3)
    assert one.dtype == np.uint8
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.5


def test_the_level_sets_the_numbers_of_patches_and_of_people(streets):
    assert [street.patches for street in streets] == [
        round(level * MOST_PATCHES) for level in LEVELS
    ]
    counts = [len(street.distractors) for street in streets]
    assert counts == [round(level * MOST_DISTRACTORS) for level in LEVELS]
    assert [len(street.stage.actors) for street in streets] == [count + 1 for count in counts]


def test_patches_cover_more_and_stand_out_more_with_the_level(streets):
    """Nothing is covered at level 0; each level covers more pixels and changes each more."""
    covered, change = [], []
    for street in streets:
        plain = street.plain_backdrop.astype(int)
        difference = np.abs(street.stage.backdrop.astype(int) - plain).max(axis=2)
        covered.append((difference > 4).mean())
        change.append(difference[difference > 4].mean() if difference.any() else 0.0)
    assert covered[0] == 0.0
    assert np.all(np.diff(covered) > 0.01)
    assert np.all(np.diff(change) > 0.0)


def test_patches_lie_in_the_rows_that_the_target_passes(streets):
    street = streets[-1]
    changed = (street.stage.backdrop != street.plain_backdrop).any(axis=(1, 2))
    first, last = np.flatnonzero(changed)[[0, -1]]
    top = street.target_boxes[:, 1].min()
    bottom = (street.target_boxes[:, 1] + street.target_boxes[:, 3]).max()
    assert top - 40 < first < top
    assert bottom < last < bottom + 50


def test_the_backdrop_has_more_of_the_colors_of_the_target_with_the_level(streets):
    """Counted in the coarse colors of the target's own sprite, without what few pixels have."""
    sprite = streets[0].target.sprites[0].pixels
    solid = sprite[sprite[..., 3] > 0.99][:, :3].astype(np.uint8)
    names, counts = np.unique(solid // 24, axis=0, return_counts=True)
    worn = {tuple(name) for name, count in zip(names, counts, strict=True) if count > 20}
    shares = []
    for street in streets:
        lane = street.stage.backdrop[220:340:2, ::2].reshape(-1, 3) // 24
        shares.append(np.mean([tuple(color) in worn for color in lane]))
    assert shares[-1] > shares[0] + 0.02
    assert shares[-1] > shares[2] > shares[0]


def test_the_street_grows_sharper_with_the_level(streets):
    grays = [cv2.cvtColor(street.plain_backdrop, cv2.COLOR_BGR2GRAY) for street in streets]
    sharpness = [cv2.Laplacian(gray, cv2.CV_64F).var() for gray in grays]
    assert np.all(np.diff(sharpness) > 0.0)
    assert sharpness[0] < 0.05 * sharpness[-1]


def test_the_level_leaves_the_target_and_the_people_of_lower_levels_as_they_are(streets):
    for street, next_street in pairwise(streets):
        np.testing.assert_array_equal(street.target_boxes, next_street.target_boxes)
        np.testing.assert_array_equal(
            street.target.sprites[3].pixels, next_street.target.sprites[3].pixels
        )
        for one, same in zip(street.distractors, next_street.distractors, strict=False):
            np.testing.assert_array_equal(one.positions, same.positions)


def test_the_people_wear_the_colors_of_the_target_in_patterns_of_their_own(streets):
    street = streets[-1]

    def mean_color(actor):
        pixels = actor.sprites[0].pixels
        return pixels[..., :3].sum(axis=(0, 1)) / pixels[..., 3].sum()

    wanted = mean_color(street.target)
    for distractor in street.distractors:
        seen = mean_color(distractor)
        assert seen / seen.sum() == pytest.approx(wanted / wanted.sum(), abs=0.02)
        assert seen.sum() == pytest.approx(wanted.sum(), rel=0.2)
        assert (distractor.sprites[0].pixels != street.target.sprites[0].pixels).any()


@pytest.mark.parametrize("index", [0, 40, 119])
def test_the_box_holds_the_target_and_little_else(streets, index):
    street = streets[-1]
    black = np.zeros_like(street.stage.backdrop)
    alone = Stage(black, (street.target.painted((255.0, 255.0, 255.0)),), street.stage.foreground)
    seen = street.camera.shoot(alone.paint(index), index)[..., 0] > 127
    x, y, width, height = street.target_boxes[index]
    rows, columns = np.indices(seen.shape)
    inside = (columns >= x) & (columns < x + width) & (rows >= y) & (rows < y + height)
    assert (seen & inside).sum() > 0.97 * seen.sum()
    assert 0.3 < seen[inside].mean() < 0.7
    assert np.flatnonzero(seen.any(axis=1))[[0, -1]] == pytest.approx([y, y + height], abs=3)


def test_the_target_stays_in_the_image_and_is_seen_where_it_starts():
    for seed in range(8):
        street = ClutteredStreet(seed, {"clutter": 1.0})
        boxes = street.target_boxes
        assert boxes.shape == (120, 4)
        assert (boxes[:, :2] >= 0.0).all()
        assert (boxes[:, :2] + boxes[:, 2:] <= [640.0, 480.0]).all()
        assert street.visibility[0] > 0.9


def test_the_camera_stands_still(streets):
    """Without noise only rows in which people walk change."""
    first, later = streets[-1].render(0), streets[-1].render(90)
    np.testing.assert_array_equal(first[:200], later[:200])
    np.testing.assert_array_equal(first[370:], later[370:])
    assert (first[200:370] != later[200:370]).any()


def test_a_wrong_seed_or_setting_is_refused():
    with pytest.raises(ValueError, match="seed is -1"):
        ClutteredStreet(-1)
    with pytest.raises(ValueError, match="clutter"):
        ClutteredStreet(0, {"clutter": 1.5})
