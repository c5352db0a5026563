"""Positions of people whose place is known, their covariances, and what gives no position."""

import numpy as np
import pytest

from pf_tracker_ros.world import CameraModel, GroundPlane, Localizer, in_fixed_frame
from pf_tracker_ros.world.fusion import TO_MIDDLE


def onward(foot, plane):
    """The horizontal direction from below the camera to a foot."""
    horizontal = foot - (foot @ plane.down) * plane.down
    return horizontal / np.linalg.norm(horizontal)


def middle(foot, plane):
    """The middle of a target whose foot's near side is at `foot`."""
    return foot + TO_MIDDLE * onward(foot, plane)


def depth_of(box, distance, background=9.0, size=(480, 640)):
    depth = np.full(size, background, np.float32)
    x, y, width, height = np.rint(box).astype(int)
    depth[max(y, 0) : y + height, max(x, 0) : x + width] = distance
    return depth


@pytest.mark.parametrize("methods", [("ground",), ("height",), ("ground", "height")])
@pytest.mark.parametrize(
    ("height", "pitch", "roll"), [(1.2, 0.0, 0.0), (0.4, -0.2, 0.1), (6.0, 0.5, -0.05)]
)
@pytest.mark.parametrize(
    ("distortion", "model"),
    [((), "plumb_bob"), ((-0.3, 0.1, 0.001, 0.0, 0.0), "plumb_bob"), ((0.02,) * 4, "equidistant")],
)
def test_a_box_gives_the_position(box_of, methods, height, pitch, roll, distortion, model):  # noqa: PLR0917
    camera = CameraModel(400.0, 410.0, 330.0, 235.0, 640, 480, distortion, model)
    plane = GroundPlane.from_angles(height, pitch, roll)
    # In the middle column, where a person's foot and head have the same column without roll.
    box, foot = box_of(camera, plane, 8.0, 0.0)
    localizer = Localizer(camera, height, pitch, roll)
    place = localizer.locate(box, methods=methods)
    assert place.method == "+".join(methods)
    # With roll, the head is beside the column of the foot.
    tolerance = 1e-6 if roll == 0.0 else 0.1
    np.testing.assert_allclose(place.position, middle(foot, plane), atol=tolerance)


def test_the_bearing_is_that_of_the_center_of_the_box(camera):
    localizer = Localizer(camera)
    box = np.array([400.0, 100.0, 60.0, 160.0])
    covariance = np.diag([16.0, 25.0, 4.0, 4.0])
    bearing = localizer.bearing(box, covariance)
    center = camera.rays([[429.5, 179.5]])[0]
    np.testing.assert_allclose(bearing.direction, center)
    # Angles between rays through pixels that are drawn.
    pixels = np.random.default_rng(0).multivariate_normal(
        [429.5, 179.5], np.diag([16.25, 25.125]), 20_000
    )
    rays = camera.rays(pixels)
    right = np.array([1.0, 0.0, 0.0]) - center[0] * center
    right /= np.linalg.norm(right)
    angles = np.column_stack([rays @ right, rays @ np.cross(center, right)])
    np.testing.assert_allclose(bearing.covariance, np.cov(angles.T), rtol=0.05, atol=1e-6)
    place = localizer.locate(box, covariance)
    np.testing.assert_allclose(place.bearing, bearing.direction)
    np.testing.assert_allclose(place.bearing_covariance, bearing.covariance)


@pytest.mark.parametrize("methods", [("ground",), ("height",), ("ground", "height")])
@pytest.mark.parametrize("distance", [7.0, 15.0])
def test_the_covariance_is_that_of_the_errors(camera, box_of, methods, distance):
    generator = np.random.default_rng(3)
    covariance = np.diag([36.0, 9.0, 4.0, 9.0])
    nees, vertical = [], []
    localizer = Localizer(camera, 2.5, 0.1, tilt_sd=0.004)
    for _ in range(400):
        plane = GroundPlane.from_angles(2.5, 0.1 + generator.normal(0.0, 0.004))
        near = distance - TO_MIDDLE - generator.normal(0.0, 0.15)
        box, foot = box_of(camera, plane, near, 0.1, height=generator.normal(1.75, 0.1))
        true = foot + (distance - near) * onward(foot, plane)
        x, y, width, height = box
        dx, dy, dw, dh = generator.multivariate_normal(np.zeros(4), covariance)
        drawn = (x + dx - dw / 2, y + dy - dh / 2, width + dw, height + dh)
        place = localizer.locate(drawn, covariance, methods=methods)
        # Across and along: the vertical error is that of a foot on the ground, nearly none.
        error, horizontal = (place.position - true)[[0, 2]], place.covariance[::2, ::2]
        nees.append(error @ np.linalg.solve(horizontal, error))
        vertical.append((place.position - true)[1] ** 2 / place.covariance[1, 1])
        assert np.linalg.eigvalsh(place.covariance).min() > 0.0
    # The mean of 400 values with two degrees of freedom has a standard deviation of .05.
    assert np.mean(nees) / 2.0 == pytest.approx(1.0, abs=0.2)
    assert np.mean(np.array(nees) < 4.61) == pytest.approx(0.9, abs=0.04)
    assert np.mean(vertical) < 1.2


def test_together_is_surer_than_either(camera, box_of, level):
    box, foot = box_of(camera, level, 6.0)
    localizer = Localizer(camera, level.height)
    one, other, both = (
        np.linalg.det(localizer.locate(box, methods=methods).covariance)
        for methods in (["ground"], ["height"], ["ground", "height"])
    )
    assert both < min(one, other)
    # Without ground, there is the height.
    place = Localizer(camera, None).locate(box)
    assert place.method == "height"
    np.testing.assert_allclose(place.position, middle(foot, level), atol=1e-6)


def test_the_ground_loses_accuracy_with_a_lower_camera(camera, box_of):
    sds = []
    for height in (0.4, 1.2, 3.0):
        plane = GroundPlane.from_angles(height, 0.0, 0.0, 0.0)
        box, _ = box_of(camera, plane, 8.0)
        place = Localizer(camera, plane=plane).locate(box, methods=["ground"])
        sds.append(place.covariance[2, 2] ** 0.5)
    # The relative error is that of the foot over the box, times target's over camera's height.
    assert sds[0] / sds[1] == pytest.approx(3.0, rel=0.05)
    assert sds[0] > sds[1] > sds[2]


@pytest.mark.parametrize(
    ("height", "box", "methods", "method"),
    [
        pytest.param(1.65, (300, 300, 60, 180), None, None, id="a cut foot"),
        pytest.param(1.65, (300, 0, 60, 380), None, "ground", id="a cut head leaves the ground"),
        pytest.param(None, (300, 0, 60, 380), None, None, id="a cut head without ground"),
        pytest.param(1.65, (300, 40, 60, 150), None, "height", id="a foot above the horizon"),
        pytest.param(1.65, (300, 40, 60, 150), ["ground"], None, id="its ground alone"),
        pytest.param(1.65, (900, 100, 40, 100), None, None, id="outside the image"),
    ],
)
def test_what_is_not_seen_leaves_the_other_method(camera, height, box, methods, method):
    given = {} if methods is None else {"methods": methods}
    place = Localizer(camera, height).locate(box, **given)
    assert (place and place.method) == method
    assert Localizer(camera).bearing((900, 100, 40, 100)) is None


def test_a_box_cut_at_the_side_is_less_sure_across(camera, box_of):
    plane = GroundPlane.from_angles(1.65)
    box, _ = box_of(camera, plane, 6.0)
    whole = Localizer(camera).locate((10.0, *box[1:]))
    cut = Localizer(camera).locate((-15.0, *box[1:]))
    assert cut.covariance[0, 0] > 2.0 * whole.covariance[0, 0]
    assert cut.method == "ground+height"


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
def test_depth_gives_the_distance(camera, box_of, level, dtype):
    box, foot = box_of(camera, level, 4.0, 0.2)
    depth = depth_of(box, foot[2])
    depth = (depth * 1000 if dtype == np.uint16 else depth).astype(dtype)
    place = Localizer(camera, level.height).locate(box, depth=depth)
    assert place.method == "ground+height+depth"
    np.testing.assert_allclose(place.position, middle(foot, level), atol=0.01)
    assert place.occlusion == 0.0
    # Without anything else, a target of unknown height is as far, and lower center as high.
    alone = Localizer(camera, None).locate(box, depth=depth, methods=["depth"])
    assert alone.method == "depth"
    np.testing.assert_allclose(alone.position, middle(foot, level), atol=0.01)
    half = Localizer(camera, None).locate(box, depth=depth[::2, ::2], methods=["depth"])
    np.testing.assert_allclose(half.position, alone.position, atol=0.02)


def test_a_half_figure_is_as_far_as_its_depth(camera, level):
    box = (200.0, 100.0, 240.0, 380.0)
    depth = depth_of(box, 0.9)
    place = Localizer(camera, level.height).locate(box, depth=depth)
    assert place.method == "depth"
    assert place.position[1:] == pytest.approx((level.height, 0.9 + TO_MIDDLE), abs=0.01)
    unknown = Localizer(camera, None).locate(box, depth=depth)
    # The head at 100 px is .206 m above the camera.
    assert unknown.position[1:] == pytest.approx((1.75 - 0.206, 0.9 + TO_MIDDLE), abs=0.01)
    assert unknown.covariance[1, 1] > 0.01
    # Without foot and head, the height is open.
    box = (200.0, 0.0, 240.0, 480.0)
    place = Localizer(camera, None).locate(box, depth=depth_of(box, 0.9))
    assert place.position[2] == pytest.approx(0.9 + TO_MIDDLE, abs=0.01)
    assert place.covariance[1, 1] ** 0.5 > 0.3


def test_the_width_of_a_half_figure_tells_it_from_an_occluder(camera):
    """A pole before the middle of a person whose box is cut at the foot."""
    box = (200.0, 100.0, 300.0, 380.0)
    depth = depth_of(box, 1.0)
    depth[90:, 270:420] = 0.4
    place = Localizer(camera, None).locate(box, depth=depth)
    assert place.position[2] == pytest.approx(1.0 + TO_MIDDLE, abs=0.01)
    assert place.occlusion == pytest.approx(0.5, abs=0.05)


def test_the_box_chooses_a_surface_where_the_prediction_is_vague(camera, box_of, level):
    """Somebody before a wall who was last seen long ago, walking away."""
    box, foot = box_of(camera, level, 4.0)
    x, y, width, height = box
    depth = depth_of((x + 0.3 * width, y, 0.4 * width, height), foot[2], background=7.0)
    # Their map is of the wall as well.
    place = Localizer(camera, level.height).locate(
        box,
        depth=depth,
        target_probability=np.tile([1.0, 0.2, 1.0], (3, 1)),
        predicted_range=(20.0, 10.0),
    )
    np.testing.assert_allclose(place.position, middle(foot, level), atol=0.05)
    # Nor does it tell what is nearer than they are.
    assert place.occlusion == 0.0
    assert Localizer(camera, level.height).covered_share(box, depth, (20.0, 10.0)) is None
    assert Localizer(camera, level.height).covered_share(box, depth, (20.0, 1.0)) == 1.0


@pytest.mark.parametrize(("sd", "covered"), [(0.1, 0.4), (0.8, 0.0), (3.0, None)])
def test_who_may_be_as_near_is_not_covered_by_themselves(camera, box_of, level, sd, covered):
    """Predicted at 5 m, seen at 4 m in 0.4 of the box; 2 deviations count, and no vague one."""
    (x, y, width, height), foot = box_of(camera, level, 4.0)
    depth = depth_of((x + 0.3 * width, y, 0.4 * width, height), foot[2], background=7.0)
    localizer = Localizer(camera, level.height)
    share = localizer.covered_share((x, y, width, height), depth, (5.0, sd))
    assert share == (covered and pytest.approx(covered, abs=0.05))


def test_depth_wins_over_what_it_contradicts(camera, box_of, level):
    """A child: the ground agrees with the depth, the height does not."""
    box, foot = box_of(camera, level, 4.0, height=1.0)
    place = Localizer(camera, level.height).locate(box, depth=depth_of(box, foot[2]))
    assert place.method == "ground+depth"
    np.testing.assert_allclose(place.position, middle(foot, level), atol=0.01)


@pytest.mark.parametrize("hole", [0.0, np.nan, np.inf, -1.0])
def test_holes_everywhere_leave_ground_and_height(camera, box_of, level, hole):
    box, _ = box_of(camera, level, 4.0)
    depth = np.full((480, 640), hole, np.float32)
    place = Localizer(camera, level.height).locate(box, depth=depth)
    assert (place.method, place.occlusion) == ("ground+height", None)


def test_a_target_behind_something_is_not_where_that_is(camera, box_of, level):
    box, foot = box_of(camera, level, 4.0)
    depth = depth_of(box, 2.0)
    hidden = Localizer(camera, level.height).locate(
        box, depth=depth, predicted_range=(float(np.linalg.norm(foot)), 0.2)
    )
    assert hidden.method == "ground+height"
    assert hidden.occlusion == 1.0
    assert hidden.range == pytest.approx(np.linalg.norm(foot), rel=0.02)


def test_a_place_in_the_fixed_frame(camera, box_of, level):
    box, foot = box_of(camera, level, 5.0, 0.1)
    place = Localizer(camera, level.height).locate(box)
    # The camera looks along y, 1.2 m above the ground.
    rotation = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    fixed = in_fixed_frame(place, rotation, (10.0, 20.0, 1.2))
    expected = np.array([10.0 + foot[0], 20.0 + foot[2], 0.0])
    np.testing.assert_allclose(fixed.mean, expected, atol=TO_MIDDLE + 1e-6)
    assert fixed.covariance[1, 1] == pytest.approx(place.covariance[2, 2])
    # A plane of the frame replaces that of the localizer.
    pitched = GroundPlane.from_angles(1.2, 0.15)
    box, foot = box_of(camera, pitched, 5.0)
    place = Localizer(camera, 3.0).locate(box, plane=pitched, methods=["ground"])
    np.testing.assert_allclose(place.position, middle(foot, pitched), atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"methods": ["sonar"]}, "'sonar'; allowed: ground, height, depth"),
        ({"predicted_range": (-1.0, 0.1)}, "predicted_range"),
        ({"predicted_range": (np.nan, 0.1)}, "predicted_range"),
        ({"predicted_range": 4.0}, "predicted_range is 4.0; expected a positive distance"),
        ({"depth": np.zeros((480, 640), np.uint8)}, "uint8; expected float32"),
        ({"depth": np.zeros((480, 640, 3), np.float32)}, "rows and columns"),
        ({"depth": np.zeros((480, 480), np.float32)}, "480 x 480 px and the image 640 x 480"),
        ({"depth": [[1.0]]}, "expected an array"),
        ({"image": np.zeros((480, 640), np.uint8)}, "BGR"),
        ({"target_probability": np.full((4, 4), 2.0)}, "between 0 and 1"),
        ({"target_probability": np.full((4, 4), np.nan)}, "between 0 and 1"),
        ({"target_probability": np.zeros(4)}, "rows and columns"),
        ({"box_covariance": np.eye(3)}, "box_covariance"),
    ],
)
def test_wrong_arguments_are_rejected(camera, arguments, message):
    arguments = {"depth": np.full((480, 640), 3.0, np.float32), **arguments}
    with pytest.raises(ValueError, match=message):
        Localizer(camera).locate((300, 100, 60, 200), **arguments)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("camera_height", (0.0, np.nan, 1e200)),
        ("camera_pitch", (np.inf,)),
        ("target_height", (-1.0, 1e200, 1e-200)),
        ("target_height_sd", (1e200, np.nan)),
        ("tilt_sd", (-1.0,)),
    ],
)
def test_wrong_parameters_are_rejected(camera, name, values):
    for value in values:
        with pytest.raises(ValueError, match=r"expected|finite"):
            Localizer(camera, **{name: value})


def test_a_range_above_10_km_is_no_position():
    camera = CameraModel(1e6, 1e6, 319.5, 239.5, 640, 480)
    # 1.75 m over 170 px, and over 200 px.
    box, near = (300, 100, 60, 170), (300, 100, 60, 200)
    assert Localizer(camera, None).locate(box) is None
    assert Localizer(camera, None).locate(near).range == pytest.approx(8750.0, rel=1e-3)


def test_any_box_gives_a_place_or_none(camera):
    generator = np.random.default_rng(0)
    depth = generator.uniform(0.0, 6.0, (480, 640)).astype(np.float32)
    depth[generator.random(depth.shape) < 0.3] = np.nan
    localizers = [
        Localizer(camera, height, pitch) for height in (None, 0.3, 8.0) for pitch in (0, 1.4)
    ]
    for _ in range(150):
        box = (*generator.uniform(-300, 700, 2), *np.exp(generator.uniform(-3, 7, 2)))
        for localizer in localizers:
            for given in (None, depth):
                place = localizer.locate(box, depth=given)
                if place is not None:
                    assert np.isfinite(place.position).all()
                    assert np.linalg.eigvalsh(place.covariance).min() > 0.0
                    assert np.linalg.norm(place.bearing) == pytest.approx(1.0)
