"""The benchmark of positions: what it reads, what it renders, its figures by hand."""

import cv2
import numpy as np
import pytest
import world
import world_room
from world_parts.depth_camera import corrupted, depth_table
from world_parts.errors import Errors, auroc
from world_parts.ground_from_people import aligned
from world_parts.kitti import read_kitti
from world_parts.pets import read_ground_tracks, read_tsai

from pf_tracker_ros.world import GroundPlane

KITTI = (
    "# fx 700 fy 700 cx 600 cy 180 offset_x 0.06\n"
    "frame,id,class,truncated,occluded,x,y,width,height,height_m,width_m,length_m,X,Y,Z\n"
    "0,1,Pedestrian,0,0,600,176.5,30,120,1.75,0.5,0.5,0.1,1.65,10\n"
    "0,2,Pedestrian,0,1,640,176.5,30,120,1.75,0.5,0.5,0.6,1.65,10\n"
    "1,3,Cyclist,1,0,1180,176.5,44,120,1.75,0.5,0.5,6.6,1.65,8\n"
)


def test_kitti_labels(tmp_path):
    (tmp_path / "0001.csv").write_text(KITTI)
    labels = read_kitti(tmp_path / "0001.csv")
    assert labels.is_whole.tolist() == [True, False, False]
    assert labels.at_border.tolist() == [False, False, True]
    # Moved from the left reference to this camera.
    np.testing.assert_allclose(labels.positions[0], (0.16, 1.65, 10.0))
    assert (labels.camera.fx, labels.camera.width) == (700.0, 1225)


TSAI = (
    '<Camera><Geometry width="768" height="576" dpx="0.005" dpy="0.004"/>'
    '<Intrinsic focal="5" kappa1="{kappa}" cx="380" cy="290" sx="1.1"/>'
    '<Extrinsic tx="0" ty="0" tz="7000" rx="3.141592653589793" ry="0" rz="0"/></Camera>'
)


def test_a_tsai_calibration_that_looks_down(tmp_path):
    path = tmp_path / "view.xml"
    path.write_text(TSAI.format(kappa=0.005))
    camera = read_tsai(path)
    # Half a turn about x: the optical axis points down from 7 m.
    np.testing.assert_allclose(camera.translation, (0.0, 0.0, 7.0), atol=1e-9)
    plane = GroundPlane.from_pose(camera.rotation, camera.translation)
    np.testing.assert_allclose(plane.down, (0.0, 0.0, 1.0), atol=1e-9)
    # Tsai's equations by hand: on the sensor 200 * .005 / 1.1 and 100 * .004 mm.
    x, y = 200 * 0.005 / 1.1, 100 * 0.004
    factor = 1.0 + 0.005 * (x * x + y * y)
    ray = camera.model.rays([[580.0, 390.0]])[0]
    np.testing.assert_allclose(ray[:2] / ray[2], (x * factor / 5.0, y * factor / 5.0), atol=1e-6)


def test_detections_on_people(tmp_path):
    truth = "".join(f"{frame},1,{100 + frame},50,20,60,1,{frame},0,0\n" for frame in range(1, 9))
    found = "".join(f"{frame},-1,{101 + frame},50,20,60,0.9\n" for frame in range(1, 9))
    (tmp_path / "gt.txt").write_text(truth)
    (tmp_path / "det.txt").write_text(found + "1,-1,500,50,20,60,0.9\n")
    tracks = read_ground_tracks(tmp_path, 7.0)
    assert len(tracks.frames) == 8
    np.testing.assert_allclose(tracks.boxes[0], (101, 49, 20, 60))
    # A meter a frame; the ends have no frames before or after.
    assert np.isnan(tracks.velocities[:, 0]).tolist() == [True] * 3 + [False] * 2 + [True] * 3
    np.testing.assert_allclose(tracks.velocities[3], (7.0, 0.0))


def test_a_room_shows_walkers_where_they_are_put():
    """Ahead of the camera, 4 m away: 1.75 m are f * 1.75 / 4 pixels; then the first hides them."""
    walkers = [world_room.Walker(world_room.standing(x, 0.0), (9, 9, 99), (9,) * 3) for x in (4, 3)]
    one, other = (
        next(world_room.Room(some, world_room.driving(0.0, 0.1, 0.0)).frames(1))
        for some in (walkers[:1], walkers)
    )
    (x, _, width, height), (visible,) = one.boxes[0], one.visible
    assert height == pytest.approx(460.0 * 1.75 / 4.0, rel=0.04)
    assert x + width / 2 == pytest.approx(319.5, abs=4.0)
    assert visible == 1.0
    assert np.median(one.depth[110:130, 155:165]) == pytest.approx(4000, rel=0.02)
    assert other.visible[0] < 0.2
    assert other.visible[1] == 1.0


def test_a_depth_image_is_spoiled():
    far = np.full((480, 640), 8.0)
    holed = corrupted(far, 0.3, np.random.default_rng(0))
    assert np.isnan(holed).mean() == pytest.approx(0.3, abs=0.03)
    known = np.isfinite(holed)
    assert np.std(holed[known] - far[known]) < 0.15


def test_figures_by_hand():
    errors = Errors.of(
        np.array([[3.0, 4.0], [0.0, 1.0]]), np.array([np.eye(2) * 5.0, np.eye(2)]), 10.0
    )
    np.testing.assert_allclose(errors.sizes, (0.5, 0.1))
    np.testing.assert_allclose(errors.nees, (5.0, 1.0))
    # The 90 % region of two dimensions ends at 4.61.
    assert errors.cells() == ["2", "0.30", "0.46", "1.50", "0.500"]
    assert auroc(np.array([0.1, 0.4, 0.4, 0.9]), np.array([0, 0, 1, 1], bool)) == "0.875"
    assert auroc(np.ones(2), np.zeros(2, bool)) == "-"
    points = np.random.default_rng(0).normal(size=(20, 2))
    turned = points @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + (3.0, 4.0)
    np.testing.assert_allclose(aligned(points, turned), turned, atol=1e-9)


def test_the_command_prints_its_table(tmp_path, capsys):
    (tmp_path / "0001.csv").write_text(KITTI)
    world.main(["--kitti", str(tmp_path)])
    assert "\nground and height, whole  1 " in capsys.readouterr().out


def test_frames_of_a_depth_camera(tmp_path):
    depth = np.full((480, 640), 3000, np.uint16)
    mask = np.zeros((480, 640), np.uint8)
    mask[100:400, 250:400] = 255
    depth[mask > 0] = 1500
    image = np.full((480, 640, 3), 90, np.uint8)
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"{index}.jpg"), image)
        cv2.imwrite(str(tmp_path / f"{index}_depth.png"), depth)
        cv2.imwrite(str(tmp_path / f"{index}_mask.jpg"), mask)
    (row,) = depth_table(tmp_path, lambda name, done: None).rows
    assert row[1] == "0.0"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kitti", "."], "no tables of KITTI labels"),
        (["--pets", "."], "needs --calibration"),
    ],
)
def test_missing_data_is_told(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        world.main(arguments)
    assert message in capsys.readouterr().err
