"""The closed loop: geometry of its worlds, its figures by hand, and whole short runs."""

import json
import math
from contextlib import closing
from dataclasses import replace
from itertools import pairwise

import follow
import numpy as np
import pytest
from follow_parts import (
    chain,
    controller,
    detector,
    layout,
    loop,
    metrics,
    people,
    rendering,
    robot,
    world,
)
from follow_parts.scenarios import SCENARIOS

from pf_tracker_ros.boxes import iou

INTERVAL = 0.1


@pytest.fixture
def room():
    """A room of 10 by 8 m with a wall from (6, 0.5) to (6, 4)."""
    outline = np.array([[0.5, 0.5], [10.5, 0.5], [10.5, 8.5], [0.5, 8.5]])
    sides = [[outline[i], outline[(i + 1) % 4]] for i in range(4)]
    walls = np.array([*sides, [[6.0, 0.5], [6.0, 4.0]]])
    return layout.Layout(outline, walls, np.arange(5), ())


@pytest.fixture
def look(room):
    """Returns what a level camera sees that looks along x from (1.5, 6)."""
    generator = np.random.default_rng(1)
    renderer = rendering.Renderer(room, generator, 0)
    body, clothes = people.Body.draw(generator), people.Clothes.draw(generator)
    sprites = people.Sprites(replace(body, height=1.7), clothes, 0)

    def seen(*places):
        people = [rendering.Placed(sprites, x, y, 0.0, 0.0, False) for x, y in places]
        return renderer.render(rendering.CameraState(1.5, 6.0, 0.0, 0.0, 0.0), people, 1.0)

    return seen


def test_a_door_at_the_end_of_a_wall_is_as_wide_as_is_left():
    """The walls of seed 108 end in one."""
    assert world.World.draw(108, SCENARIOS["depth_alone"], 1.0)


def test_a_person_is_where_the_pinhole_camera_shows_them(look):
    """3 m away, the feet are f * 0.8 / 3 below the center, and 1.7 m are f * 1.7 / 3 pixels."""
    view = look((4.5, 6.0), (4.5, 7.0))
    (person, left), depth = view.people, view.depth / 1000.0
    x, y, width, height = person.box
    assert y + height == pytest.approx(239.5 + 460.0 * 0.8 / 3.0, abs=6.0)
    assert height == pytest.approx(460.0 * 1.7 / 3.0, rel=0.04)
    assert x + width / 2.0 == pytest.approx(319.5, abs=4.0)
    assert left.box[0] + left.box[2] / 2.0 == pytest.approx(319.5 - 460.0 / 3.0, abs=4.0)
    assert person.visible == person.in_view == person.shown == 1.0
    patch = depth[110:130, 155:165]
    assert np.median(patch[patch > 0.0]) == pytest.approx(3.0, rel=0.01)
    # The floor below, where a row's ray meets it.
    row = depth[220, 20:60]
    assert np.median(row[row > 0.0]) == pytest.approx(460.0 * 0.8 / (440.5 - 239.5), rel=0.02)


def test_what_is_in_front_hides(look):
    behind, front = look((5.5, 6.0), (3.5, 6.0)).people
    assert behind.visible < 0.2
    assert front.visible == 1.0
    # The wall hides all of the first; the other one is behind the camera.
    hidden, gone = look((8.0, 2.0), (0.8, 6.0)).people
    assert hidden.shown == gone.shown == 0.0
    assert gone.box is None


def test_ways_go_around_walls(room):
    begin, end = np.array([4.0, 2.0]), np.array([8.0, 2.0])
    assert not room.sees(begin, end)
    way = [begin, *room.way(begin, end)]
    assert np.allclose(way[-1], end)
    for one, other in pairwise(way):
        assert room.is_open(one, other, 0.3)
    (distance,), (number,) = room.ranges(begin, np.array([[1.0, 0.0]]))
    assert (distance, number) == (pytest.approx(2.0), 4)


@pytest.mark.parametrize("kind", ["", "door", "corner"])
def test_drawn_rooms_have_ways_to_everywhere(kind):
    for seed in range(3):
        generator = np.random.default_rng(seed)
        drawn = layout.Layout.draw(generator, kind)
        points = [drawn.free_point(generator) for _ in range(6)]
        assert all(drawn.way(points[0], one) for one in points[1:])


def test_the_robot_keeps_its_distance_and_turns():
    driver = controller.FollowController()
    base, still = robot.Pose2D(1.0, 1.0, math.pi / 2.0), np.zeros(2)

    def command(time, position, heading, is_free=lambda angle, distance: True):
        position = None if position is None else np.array(position)
        bearing = None if heading is None else heading - base.yaw
        report = chain.Report("tracking", 1.0, None, {}, position, None, still, bearing=bearing)
        driver.take(time, base, report)
        return driver.command(time, base, is_free)

    assert command(0.0, (1.0, 3.0), None) == (0.0, 0.0)
    speed, turn = command(0.1, (1.0, 4.0), None)
    assert speed > 0.5
    assert turn == pytest.approx(0.0)
    # Around what is ahead.
    speed, turn = command(0.2, (1.0, 4.0), None, lambda angle, distance: angle < -0.1)
    assert speed > 0.5
    assert turn < 0.0
    # The bearing alone turns it; without anything it waits, and searches then.
    assert command(1.0, None, math.pi / 2.0 + 0.5) == (0.0, pytest.approx(1.0))
    assert command(2.0, None, None)[0] == 0.0
    assert command(9.0, None, None) == (0.0, pytest.approx(0.7))


def test_a_pose_leads_into_its_frame_and_back():
    pose = robot.Pose2D(1.0, 2.0, math.pi / 2.0)
    assert pose.outward(np.array([3.0, 1.0])) == pytest.approx([0.0, 5.0])
    assert pose.inward(np.array([0.0, 5.0])) == pytest.approx([3.0, 1.0])


def test_detections_of_two_in_one_place_are_merged():
    seen = rendering.Seen((100.0, 100.0, 80.0, 200.0), 1.0, 1.0)
    other = seen._replace(box=(110.0, 100.0, 80.0, 200.0))
    far = seen._replace(box=(400.0, 100.0, 80.0, 200.0))
    hidden = far._replace(visible=0.1)
    generator = np.random.default_rng(0)
    counts = [
        [len(detector.detect(people, generator).boxes) for _ in range(300)]
        for people in ([seen, other, hidden], [seen, far])
    ]
    # Nine of ten are found, and one of fifty is false.
    assert np.mean(counts, axis=1) == pytest.approx([0.92, 1.82], abs=0.06)


@pytest.fixture
def row():
    """A row of a person who walks along x 2 m before the robot, and is tracked without error."""

    def made(index, said=None, **changes):
        time = 2.0 + INTERVAL * index
        box = (100.0, 100.0, 50.0, 100.0)
        ahead, at = np.array([1.0, 0.0]), np.array([time, 0.0])
        given = {"time": time, "distance": 2.0, "visible": 1.0, "state": "tracking"}
        given |= {"confidence": 0.9, "box": box, "true_box": box, "own": 1.0, "other": 0.0}
        given |= {"person": at, "robot": robot.Pose2D(time - 2.0, 0.0, 0.0)}
        given |= {"said": at if said is None else np.array([said, 0.0]), "said_distance": 2.0}
        given |= {"measured_distance": 2.1, "nees": 1.0, "velocity": ahead}
        given |= {"said_velocity": ahead, "stands_for": 0.0}
        return metrics.Row(**(given | changes))

    return made


SILENT = {"said": math.nan, "said_distance": math.nan, "nees": math.nan}
SILENT |= {"said_velocity": np.full(2, math.nan)}


def test_figures_of_a_run_without_errors(row):
    figures = metrics.figures([row(index) for index in range(50)], INTERVAL)
    assert (figures["right"], figures["pose"], figures["off"], figures["kept"]) == (1, 1, 0, 1)
    assert (figures["astray"], figures["silence"]) == (0, 0)
    assert figures["raw_rms"] == pytest.approx(0.1)
    assert (figures["rms"], figures["lag"], figures["nees"]) == pytest.approx((0.0, 0.0, 1.0))


def test_occlusions_and_absences_end_with_the_first_right_pose(row):
    rows = [row(index) for index in range(100)]
    # Hidden for 0.5 s, without a pose for 0.3 s more; then for 3 s, and a wrong pose for 1 s.
    rows[10:15] = [row(index, visible=0.1, **SILENT) for index in range(10, 15)]
    rows[15:18] = [row(index, **SILENT) for index in range(15, 18)]
    rows[40:70] = [row(index, visible=0.0, **SILENT) for index in range(40, 70)]
    rows[70:80] = [row(index, said=99.0) for index in range(70, 80)]
    figures = metrics.figures(rows, INTERVAL)
    assert figures["first_50"] == figures["first_90"] == pytest.approx(0.3)
    assert figures["late_50"] == pytest.approx(1.0)
    assert figures["back"] == 1.0
    assert figures["silence"] == pytest.approx(3.0)
    assert figures["pose"] == pytest.approx(62 / 65)
    assert figures["off"] == pytest.approx(10 / 62)


def test_somebody_else_counts_after_a_second(row):
    other = {"own": 0.0, "other": 0.8}
    rows = [row(index, **(other if index < 9 or index >= 30 else {})) for index in range(60)]
    figures = metrics.figures(rows, INTERVAL)
    assert figures["astray"] == pytest.approx(3.0)
    assert figures["right"] == pytest.approx(21 / 60)
    occluded = [replace(one, state="occluded") for one in rows]
    assert metrics.figures(occluded, INTERVAL)["astray"] == 0.0


def test_a_late_pose_has_its_lag(row):
    rows = [row(index, said=2.0 + INTERVAL * index - 0.2) for index in range(50)]
    assert metrics.figures(rows, INTERVAL)["lag"] == pytest.approx(0.2)


def test_speed_while_the_person_stands(row):
    still = {"stands_for": 2.0, "said_velocity": np.array([0.04, 0.0])}
    rows = [row(index, **(still if index >= 20 else {})) for index in range(60)]
    figures = metrics.figures(rows, INTERVAL)
    assert figures["stands_speed"] == pytest.approx(0.04)
    assert figures["stands_acceleration"] == pytest.approx(0.0)


def test_a_seed_gives_the_same_run(tmp_path, capsys):
    options = ["--scenario", "depth_hand", "--seeds", "3", "1", "--seconds", "2.5"]
    for name in ("one", "other"):
        follow.main([*options, f"--output={tmp_path / name}"])
    one, other = ((tmp_path / name / "follow.json").read_text() for name in ("one", "other"))
    assert one == other
    figures = json.loads(one)["depth_hand"]["3"]
    assert figures["right"] == figures["pose"] == 1.0
    assert "depth_hand  mean  1.00   1.00" in capsys.readouterr().out


def test_worlds_of_other_seeds_differ():
    scenario = SCENARIOS["door"]
    one, other = (world.World.draw(seed, scenario, 20.0) for seed in (1, 2))
    assert one.layout.opening != other.layout.opening
    assert not np.array_equal(one.observe().view.image, other.observe().view.image)


def test_whoever_is_alike_wears_the_same():
    scenario = SCENARIOS["alike"]
    walkers = world.World.draw(1, scenario, 20.0).cast.walkers
    assert len(walkers) > 3
    assert len({walker.sprites.clothes for walker in walkers}) == 1


@pytest.mark.parametrize("name", ["depth_select", "image_hand"])
def test_the_nodes_say_what_the_library_says(name):
    pytest.importorskip("rclpy")
    from follow_parts.nodes import NodeChain

    scenario, reports = SCENARIOS[name], []
    for chain_of in (chain.LibraryChain, NodeChain):
        drawn = world.World.draw(3, scenario, 3.0)
        with closing(chain_of(scenario, 3, has_imu=drawn.has_imu)) as made:
            moments = loop.moments(drawn, scenario, 3, 3.0, made)
            reports.append([moment.report for moment in moments])
    # The topic of a box has single precision, and each draw of particles enlarges the difference.
    assert [one.state for one in reports[0]] == [one.state for one in reports[1]]
    posed = [pair for pair in zip(*reports, strict=True) if pair[0].position is not None]
    assert len(posed) > 20
    for one, other in posed:
        assert iou(np.array(one.box), np.array(other.box)) > 0.7
        np.testing.assert_allclose(one.position, other.position, atol=0.3)
