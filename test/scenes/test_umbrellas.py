"""The umbrella scene: exact ground truth, like colors, unlike texture, the same bits."""

import itertools

import cv2
import numpy as np
import pytest
from scenes import UmbrellaScene
from scenes.stage import Stage
from scenes.walkers import PATTERNS, Canopy

# Shading takes their red channels nowhere near each other.
PALE, STRONG = (210.0, 170.0, 160.0), (150.0, 50.0, 40.0)


def shot_difference(scene, stage_of, index):
    """How much of each pixel shows an actor: frame with it in white minus the same in black."""
    white, black = (
        scene.camera.shoot(stage_of((level, level, level)).paint(index), index).astype(float)
        for level in (255.0, 0.0)
    )
    return (white - black).mean(axis=2) / 255.0


def alone(scene, actor):
    """Stages with nothing but the actor, painted, before a gray wall."""
    gray = np.full_like(scene.stage.backdrop, 128)
    clear = np.zeros_like(scene.stage.foreground)
    return lambda color: Stage(gray, (actor.painted(color),), clear)


def among_all(scene, actor):
    """The scene's stages with the actor painted."""

    def stage_of(color):
        painted = actor.painted(color)
        actors = tuple(painted if one is actor else one for one in scene.stage.actors)
        return Stage(scene.stage.backdrop, actors, scene.stage.foreground)

    return stage_of


def ellipse_histogram(image, box):
    """RGB 16 x 16 x 16 histogram of the inner part of a canopy, by OpenCV alone."""
    mask = np.zeros(image.shape[:2], np.uint8)
    center = tuple(np.round(box[:2] + box[2:] / 2 - 0.5).astype(int).tolist())
    cv2.ellipse(mask, center, (17, 14), 0, 0, 360, 255, -1)
    histogram = cv2.calcHist([image], [0, 1, 2], mask, [16] * 3, [0, 256] * 3)
    return histogram / histogram.sum()


def box_histogram(image, x, y):
    histogram = cv2.calcHist(
        [image[y : y + 40, x : x + 40]], [0, 1, 2], None, [16] * 3, [0, 256] * 3
    )
    return histogram / histogram.sum()


def bhattacharyya(first, second):
    return cv2.compareHist(first, second, cv2.HISTCMP_BHATTACHARYYA)


def orientation_vector(image, box):
    """4 x 4 x 8 gradient orientation vector of unit length of a box, straight from the paper."""
    x, y = np.round(box[:2]).astype(int)
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[y : y + 40, x : x + 40].astype(float)
    down, right = np.gradient(gray)
    direction = (np.arctan2(down, right) % (2 * np.pi) / (2 * np.pi) * 8).astype(int) % 8
    cells = np.arange(40) // 10
    vector = np.zeros((4, 4, 8))
    np.add.at(vector, (cells[:, None], cells[None], direction), np.hypot(down, right))
    return vector / np.linalg.norm(vector)


def clear_frames(scene):
    """Frames in which nothing hides either umbrella."""
    return np.flatnonzero((scene.visibility > 0.99).all(axis=1))


def test_same_seed_gives_the_same_bits_and_another_seed_does_not():
    first, again, other = UmbrellaScene(5), UmbrellaScene(5), UmbrellaScene(6)
    # In another order, too: a frame does not depend on what was rendered before.
    for index in (170, 0, 96):
        assert np.array_equal(first.render(index), again.render(index))
        assert not np.array_equal(first.render(index), other.render(index))
    assert np.array_equal(first.target_boxes, again.target_boxes)
    assert np.array_equal(first.other_boxes, again.other_boxes)
    assert np.array_equal(first.visibility, again.visibility)
    frames = list(itertools.islice(again.frames(), 3))
    assert all(np.array_equal(first.render(index), frames[index]) for index in range(3))


def test_frames_are_as_many_and_as_large_as_said(scene):
    frames = list(scene.frames())
    assert len(frames) == len(scene) == 180
    assert {(frame.shape, frame.dtype) for frame in frames} == {((576, 768, 3), np.dtype(np.uint8))}
    assert scene.target_boxes.shape == scene.other_boxes.shape == (180, 4)
    assert scene.visibility.shape == (180, 2)


@pytest.mark.parametrize("name", ["target", "other"])
def test_true_box_is_centered_on_what_is_drawn_to_a_fraction_of_a_pixel(bare_scene, name):
    actor, boxes = getattr(bare_scene, name), getattr(bare_scene, f"{name}_boxes")
    for index in range(0, len(bare_scene), 11):
        seen = shot_difference(bare_scene, alone(bare_scene, actor), index)
        rows, columns = np.indices(seen.shape) + 0.5
        center = (columns * seen).sum() / seen.sum(), (rows * seen).sum() / seen.sum()
        assert center == pytest.approx(boxes[index, :2] + 20.0, abs=0.02)


@pytest.mark.parametrize("name", ["target", "other"])
def test_the_region_holds_the_canopy_and_little_else(bare_scene, name):
    actor, boxes = getattr(bare_scene, name), getattr(bare_scene, f"{name}_boxes")
    seen = shot_difference(bare_scene, alone(bare_scene, actor), 10)
    x, y = np.round(boxes[10, :2]).astype(int)
    inside = seen[y : y + 40, x : x + 40]
    assert inside.sum() > 0.95 * seen.sum()
    assert inside.mean() > 0.7


@pytest.mark.parametrize("column", [0, 1])
def test_visibility_is_the_share_of_the_canopy_that_is_seen(bare_scene, column):
    actor = (bare_scene.target, bare_scene.other)[column]
    for index in range(0, len(bare_scene), 12):
        whole = shot_difference(bare_scene, alone(bare_scene, actor), index).sum()
        seen = shot_difference(bare_scene, among_all(bare_scene, actor), index).sum()
        assert seen / whole == pytest.approx(bare_scene.visibility[index, column], abs=0.01)


def test_umbrellas_cross_near_frame_96_from_left_and_from_right(scene):
    target, other = scene.target_boxes, scene.other_boxes
    assert target[0, 0] < other[0, 0] - 200
    assert target[-1, 0] > other[-1, 0] + 100
    assert abs(scene.meeting_frame - 96) <= 8
    # They pass close: the boxes overlap there, one above the other.
    meeting = target[scene.meeting_frame] - other[scene.meeting_frame]
    assert np.abs(meeting[0]) < 10
    assert 8 < np.abs(meeting[1]) < 30


@pytest.mark.parametrize("seed", range(0, 30, 3))
def test_every_scene_of_the_experiment_is_fair(seed):
    scene = UmbrellaScene(seed)
    target = scene.visibility[:, 0]
    for boxes in (scene.target_boxes, scene.other_boxes):
        assert boxes[:, :2].min() >= 0.0
        assert (boxes[:, :2] + boxes[:, 2:] <= (768, 576)).all()
    # Clear where it is picked, hidden in part before, at and after the meeting, never wholly.
    assert target[:5].min() > 0.98
    assert target.min() > 0.2
    apart = np.abs(np.arange(len(scene)) - scene.meeting_frame) > 25
    hidden_by_trees = (target < 0.7) & apart
    assert 5 <= hidden_by_trees.sum() <= 70
    assert target[scene.meeting_frame - 20 : scene.meeting_frame + 21].min() < 0.75


def test_colors_are_as_alike_as_an_umbrella_is_to_itself_and_unlike_the_street(scene):
    generator = np.random.default_rng(0)
    index = clear_frames(scene)[0]
    image = scene.render(index)
    target, other = scene.target_boxes[index], scene.other_boxes[index]
    between = bhattacharyya(ellipse_histogram(image, target), ellipse_histogram(image, other))
    assert between < 0.35
    x, y = np.round(target[:2]).astype(int)
    template = box_histogram(image, x, y)
    street = []
    for left, top in zip(
        generator.integers(0, 728, 200), generator.integers(230, 400, 200), strict=True
    ):
        if min(np.hypot(left - b[0], top - b[1]) for b in (target, other)) > 60:
            street.append(bhattacharyya(template, box_histogram(image, left, top)))
    assert np.median(street) > 2 * between
    # Clutter of the umbrellas' color is there, yet it is not another umbrella.
    assert min(street) > 1.3 * between


def test_textures_differ_more_than_one_does_over_time(scene):
    clear = clear_frames(scene)
    first, last = clear[0], clear[-1]
    vectors = {
        (name, index): orientation_vector(
            scene.render(index), getattr(scene, f"{name}_boxes")[index]
        )
        for name in ("target", "other")
        for index in (first, last)
    }
    for name in ("target", "other"):
        own = np.linalg.norm(vectors[name, first] - vectors[name, last])
        between = np.linalg.norm(vectors["target", first] - vectors["other", first])
        assert between > 1.4 * own
        assert between > 0.7


@pytest.mark.parametrize(("first", "second"), itertools.combinations(PATTERNS, 2))
def test_any_two_patterns_share_their_colors_about_evenly(first, second):
    shares = []
    for pattern in (first, second):
        pixels = Canopy(pattern, (PALE, STRONG)).sprite(0.0).pixels
        covered = pixels[..., 3] > 0.99
        shares.append((pixels[covered][:, 2] > 90.0).mean())
    assert shares[0] == pytest.approx(0.5, abs=0.12)
    assert shares[0] == pytest.approx(shares[1], abs=0.12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": -1.0}, r"'noise' is -1.*0 to 30"),
        ({"noise": float("nan")}, "'noise' is nan"),
        ({"frames": 20}, r"'frames' is 20.*150 to 210"),
        ({"trees": 3}, "no parameter 'trees'; there are: frames"),
    ],
)
def test_wrong_settings_are_refused_with_what_is_allowed(settings, message):
    with pytest.raises(ValueError, match=message):
        UmbrellaScene(0, settings)


def test_a_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed is -1; allowed: 0 or more"):
        UmbrellaScene(-1)


def test_a_setting_of_the_camera_leaves_the_world_as_it_is():
    quiet, noisy = UmbrellaScene(3, {"noise": 0.0}), UmbrellaScene(3, {"noise": 9.0})
    assert np.array_equal(quiet.stage.paint(50), noisy.stage.paint(50))
    assert np.array_equal(quiet.target_boxes, noisy.target_boxes)


@pytest.mark.parametrize("frames", [150, 210])
def test_shortest_and_longest_scene_stay_inside_the_image(frames):
    scene = UmbrellaScene(4, {"frames": frames, "shake": 5.0})
    assert scene.render(frames - 1).shape == (576, 768, 3)
    assert scene.target_boxes[:, :2].min() >= 0.0
    assert (scene.other_boxes[:, :2] + 40.0 <= (768, 576)).all()
