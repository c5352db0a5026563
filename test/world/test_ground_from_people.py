"""The plane of people who were placed on a known one."""

import math

import numpy as np
import pytest

from pf_tracker_ros.world import CameraModel, GroundPlane, fit_ground_plane
from pf_tracker_ros.world.height_line import HeightLine


def people(camera, box_of, plane, count, *, noise=0.0, height_sd=0.0, seed=0, distances=(5, 25)):
    generator = np.random.default_rng(seed)
    boxes = []
    while len(boxes) < count:
        height = 1.75 * math.exp(generator.normal(0.0, height_sd))
        bearing = generator.uniform(-0.3, 0.3)
        box, _ = box_of(camera, plane, generator.uniform(*distances), bearing, height)
        x, y, width, height = box
        upper, lower = generator.normal(0.0, noise * height, 2)
        box = (x, y + upper, width, height + lower - upper)
        if y > 10 and y + box[3] < camera.height - 10 and box[3] > 5:
            boxes.append(box)
    return np.array(boxes)


@pytest.mark.parametrize(
    ("height", "pitch", "roll"), [(7.0, 0.3, 0.0), (2.5, 0.05, 0.0), (1.0, -0.02, 0.0)]
)
def test_exact_boxes_give_the_plane(camera, box_of, height, pitch, roll):
    boxes = people(camera, box_of, GroundPlane.from_angles(height, pitch, roll), 50)
    fitted = fit_ground_plane(camera, boxes)
    assert fitted.plane.height == pytest.approx(height, rel=0.01)
    assert fitted.plane.pitch == pytest.approx(pitch, abs=0.003)
    assert fitted.boxes == 50


def test_noisy_boxes_give_it_within_its_uncertainty(camera, box_of):
    true = GroundPlane.from_angles(5.0, 0.25)
    errors = []
    for seed in range(12):
        boxes = people(camera, box_of, true, 60, noise=0.03, height_sd=0.05, seed=seed)
        # A tenth are no people on the ground.
        boxes[:6, 3] *= 2.5
        plane = fit_ground_plane(camera, boxes).plane
        rays = camera.rays([[320.0, 300.0]])
        ratio = plane.distances(rays)[0] / true.distances(rays)[0]
        slope = float(rays[0] @ true.down)
        tilt = plane.tilt_sd / slope
        errors.append(math.log(ratio) / math.hypot(plane.height_sd / plane.height, tilt))
    assert np.abs(errors).max() < 3.0
    assert np.abs(errors).mean() > 0.1


def test_a_roll_is_found_and_the_height_of_people_sets_the_scale(camera, box_of):
    """People at both sides: with a roll, those of one side are higher in the image."""
    true = GroundPlane.from_angles(6.0, 0.3, 0.08)
    boxes = people(camera, box_of, true, 150)
    assert fit_ground_plane(camera, boxes).plane.roll == pytest.approx(0.08, abs=0.02)
    boxes = people(camera, box_of, GroundPlane.from_angles(5.0, 0.25), 50)
    assert fit_ground_plane(camera, boxes, 0.875).plane.height == pytest.approx(2.5, rel=0.01)


@pytest.mark.parametrize("distances", [(12, 12.01), (6, 20)])
def test_with_a_known_direction_down_boxes_at_one_distance_are_enough(camera, box_of, distances):
    true, errors = GroundPlane.from_angles(3.0, 0.15, -0.1), []
    for seed in range(8):
        boxes = people(
            camera, box_of, true, 60, noise=0.03, height_sd=0.03, seed=seed, distances=distances
        )
        # A tenth are no people on the ground.
        boxes[:6, 3] *= 2.5
        fitted = fit_ground_plane(camera, boxes, down=7.0 * true.down)
        np.testing.assert_allclose(fitted.plane.down, true.down)
        assert fitted.boxes <= 54
        errors.append((fitted.plane.height - 3.0) / fitted.plane.height_sd)
    assert np.abs(errors).max() < 2.0


def test_each_box_has_its_own_direction_down(camera, box_of):
    """The camera nods: no one plane is right for all."""
    pitches = np.linspace(0.05, 0.25, 50)
    planes = [GroundPlane.from_angles(2.0, pitch) for pitch in pitches]
    boxes = [box_of(camera, plane, 9.0)[0] for plane in planes]
    # One that is not whole has its direction, too.
    boxes.insert(20, (300.0, -5.0, 40.0, 100.0))
    planes.insert(20, GroundPlane.from_angles(2.0, 1.0))
    fitted = fit_ground_plane(camera, boxes, down=[plane.down for plane in planes])
    assert fitted.plane.height == pytest.approx(2.0, rel=0.01)
    assert fitted.plane.pitch == pytest.approx(0.25)


def test_people_of_all_sizes_determine_no_height(camera, box_of):
    true = GroundPlane.from_angles(3.0, 0.15)
    boxes = people(camera, box_of, true, 60, height_sd=0.5)
    with pytest.raises(ValueError, match=r"differ by \d+ %; expected people who stand"):
        fit_ground_plane(camera, boxes, down=true.down)


def test_too_few_whole_boxes_say_so(camera, box_of):
    boxes = people(camera, box_of, GroundPlane.from_angles(5.0, 0.25), 50)
    boxes[0, 1] = 0.0
    with pytest.raises(ValueError, match="49 of 50 boxes are whole; a plane needs at least 50"):
        fit_ground_plane(camera, boxes)
    lens = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480, (-0.3, 0.1, 0.0, 0.0, 0.0))
    # 3 px from the border are less than 2 % of the height.
    with pytest.raises(ValueError, match="0 of 60 boxes are whole"):
        fit_ground_plane(lens, [(300.0, 3.0, 80.0, 300.0)] * 60)


def test_boxes_that_determine_no_plane_say_so(camera, box_of):
    plane = GroundPlane.from_angles(5.0, 0.25)
    same = people(camera, box_of, plane, 50, noise=0.03, height_sd=0.05, distances=(15, 15.01))
    generator = np.random.default_rng(0)
    # The higher in the image, the larger.
    rows = generator.uniform(20, 250, 60)
    upside_down = np.column_stack(
        [generator.uniform(50, 550, 60), rows, np.full(60, 40.0), 180.0 - rows / 2.0]
    )
    one = [box_of(camera, plane, 12.0)[0]] * 50
    for boxes, reason in ((same, ""), (upside_down, ""), (one, r".*here 1\.00 times")):
        with pytest.raises(ValueError, match=f"do not determine the ground{reason}"):
            fit_ground_plane(camera, boxes)


@pytest.mark.parametrize("height", [1.0, 2.0])
def test_a_person_who_sways_determines_no_plane(camera, box_of, height):
    """A detector's edge errors are as large as the variety of the distances."""
    plane = GroundPlane.from_angles(height, 0.1)
    for seed in range(10):
        boxes = people(camera, box_of, plane, 50, noise=0.043, seed=seed, distances=(4.5, 5.5))
        with pytest.raises(ValueError, match="do not determine the ground"):
            fit_ground_plane(camera, boxes)


@pytest.mark.parametrize(
    ("boxes", "options", "message"),
    [
        (np.zeros((60, 3)), {}, r"expected \(N, 4\)"),
        (np.ones((60, 4)), {"target_height": 0.0}, "target_height"),
        (np.full((60, 4), np.nan), {}, "four finite numbers"),
        (np.empty((0, 4)), {}, "0 of 0"),
        (None, {"down": (0.0, -1.0, 0.0)}, "0 of 60 boxes have their foot below the horizon"),
        (None, {"down": (0.0, 1.0)}, r"down has shape \(2,\); expected \(3,\) or \(60, 3\)"),
        (None, {"down": (0.0, np.nan, 0.0)}, "finite"),
        (None, {"down": (0.0, 0.0, 0.0)}, "zero"),
    ],
)
def test_wrong_arguments_are_rejected(camera, box_of, boxes, options, message):
    if boxes is None:
        boxes = people(camera, box_of, GroundPlane.from_angles(5.0, 0.25), 60)
    with pytest.raises(ValueError, match=message):
        fit_ground_plane(camera, boxes, **options)


def test_before_a_level_camera_the_line_of_heights_is_the_ground(camera, box_of):
    """Slope and horizon by the geometry, and by the plane that is learned from the same people."""
    places = [(distance, 0.02 * distance - 0.2) for distance in np.linspace(4.0, 20.0, 60)]
    boxes = np.array([box_of(camera, GroundPlane.from_angles(1.4), *place)[0] for place in places])
    line = HeightLine.fit(boxes[:, 1] + boxes[:, 3], boxes[:, 3])
    assert line.slope == pytest.approx(1.75 / 1.4, rel=1e-4)
    # Edges count half a pixel more than the calibration.
    horizon = line.lower_edge - line.height / line.slope
    assert horizon == pytest.approx(camera.cy + 0.5, abs=0.02)
    learned = fit_ground_plane(camera, boxes).plane
    assert 1.75 / line.slope == pytest.approx(learned.height, rel=1e-3)
    assert learned.pitch == pytest.approx(0.0, abs=1e-3)
