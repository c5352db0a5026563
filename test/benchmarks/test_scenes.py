"""The drawn scenes: the same bits for a seed, and the truth where it is drawn."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import ClutteredStreet, UmbrellaScene
from scenes.camera import HandheldCamera
from scenes.clutter import MOST_DISTRACTORS, MOST_PATCHES
from scenes.sprites import Drawing, Placement, Sprite

SCENES = (ClutteredStreet, UmbrellaScene)


@pytest.mark.parametrize("scene", SCENES)
def test_a_seed_gives_the_same_bits_and_the_target_stays_in_the_image(scene):
    one, same, other = (scene(seed) for seed in (3, 3, 4))
    image = one.render(30)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, same.render(30))
    assert (image != other.render(30)).mean() > 0.5
    height, width = image.shape[:2]
    assert one.ground_truth.shape == (one.frame_count, 4)
    assert (one.ground_truth[:, :2] >= 0.0).all()
    assert (one.ground_truth[:, :2] + one.ground_truth[:, 2:] <= (width, height)).all()


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("index", [0, 90])
def test_the_box_holds_one_of_the_actors_and_little_else(scene, index):
    made = scene(1)
    x, y, width, height = made.ground_truth[index]
    shares = []
    for actor in made.stage.actors:
        drawn = actor.placed(index)
        white = 255.0 * np.repeat(drawn.pixels[..., 3:], 4, axis=2)
        canvas = np.zeros(made.stage.backdrop.shape, np.float32)
        Placement(white / (1.0, 1.0, 1.0, 255.0), drawn.column, drawn.row).draw(canvas)
        seen = made.camera.shoot(canvas.astype(np.uint8), index)[..., 0] > 127
        rows, columns = np.indices(seen.shape)
        inside = (columns >= x) & (columns < x + width) & (rows >= y) & (rows < y + height)
        shares.append(((seen & inside).sum() / max(seen.sum(), 1), seen[inside].mean()))
    held, filled = max(shares)
    assert held > 0.9
    assert filled > 0.3


def test_more_clutter_has_more_patches_and_people():
    streets = [ClutteredStreet(0, level) for level in (0.0, 0.5, 1.0)]
    assert [len(one.stage.actors) for one in streets] == [1, 1 + MOST_DISTRACTORS // 2, 5]
    assert MOST_PATCHES == 200
    for street, further in pairwise(streets):
        np.testing.assert_array_equal(street.ground_truth, further.ground_truth)
        assert street.stage.backdrop.std() < further.stage.backdrop.std()


def test_umbrellas_cross_near_frame_96():
    scene = UmbrellaScene(0)
    apart = np.hypot(*(scene.ground_truth - scene.other_boxes)[:, :2].T)
    assert 88 <= int(apart.argmin()) <= 104
    assert apart[0] > 200.0


def test_a_camera_shakes_and_drifts_as_it_says():
    camera = HandheldCamera(
        np.random.default_rng(3),
        size=(160, 120),
        margin=8,
        frames=60,
        shake=2.0,
        lighting=0.1,
        noise=0.0,
    )
    rows, columns = np.indices((136, 176), dtype=float)
    bump = np.exp(-0.5 * ((rows - 66.3) ** 2 + (columns - 85.7) ** 2) / 6.0**2)
    world = np.repeat((200.0 * bump)[..., None], 3, axis=2).astype(np.uint8)
    assert np.ptp(camera.offsets, axis=0).min() > 3.0
    for index in range(0, 60, 20):
        light = camera.shoot(world, index)[..., 0].astype(float)
        rows, columns = np.indices(light.shape)
        found = (columns * light).sum() / light.sum(), (rows * light).sum() / light.sum()
        assert found == pytest.approx(np.array([85.7, 66.3]) - camera.offsets[index], abs=0.1)
    gray = np.full((136, 176, 3), 100, np.uint8)
    assert camera.shoot(gray, 5).mean() == pytest.approx(100 * camera.gains[5], abs=0.51)


@pytest.mark.parametrize("place", [(20.3, 25.8), (-3.5, 20.0), (48.7, 49.2)])
def test_a_sprite_is_where_it_was_placed(place):
    drawing = Drawing(16, 14)
    drawing.ellipse((8.0, 7.0), (5.0, 4.0), (255.0, 255.0, 255.0), angle=20.0)
    sprite = Sprite(drawing.pixels(), (0.0, 0.0)).held_at_centroid()
    canvas = np.zeros((90, 90, 3), np.float32)
    sprite.placed(place[0] + 20, place[1] + 20).draw(canvas)
    shares = canvas[..., 0] / 255.0
    rows, columns = np.indices(shares.shape)
    found = (columns * shares).sum() / shares.sum(), (rows * shares).sum() / shares.sum()
    assert found == pytest.approx((place[0] + 20, place[1] + 20), abs=1e-3)
    # What juts out of a canvas is cut off.
    small = np.zeros((50, 50, 3), np.float32)
    sprite.placed(*place).draw(small)
    np.testing.assert_allclose(small, canvas[20:70, 20:70], atol=1e-3)
