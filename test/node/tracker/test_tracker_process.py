"""The node as a process, as `ros2 run` starts it."""

import itertools
import signal

import pytest
from generate import generated_files

from pf_tracker_ros import Tracker
from pf_tracker_ros.tracking.presets import SELF_CONTAINED, preset_parameters

DEADLINE = 60.0


@pytest.mark.parametrize("preset", SELF_CONTAINED)
def test_a_preset_file_is_a_valid_ros_parameter_file(graph, client, images, tmp_path, preset):
    path = tmp_path / "preset.yaml"
    path.write_text(generated_files()[f"config/{preset}.yaml"])
    arguments = ["--ros-args", "--params-file", str(path), "-p", "image_reliability:=reliable"]
    graph.tracker(client, cli_args=arguments)
    assert client.tunables() == preset_parameters(preset)
    assert client.get_parameters("preset") == [preset]
    status = client.show(images[0], client.at(0))
    assert (status.level, status.message) == ("OK", "waiting for a target")


def test_two_processes_and_the_library_give_identical_boxes(graph, client, images, box):
    arguments = [
        *("-p", "preset:=li2007", "-p", "seed:=9", "-p", "image_reliability:=reliable"),
        *("-p", "motion.position_noise:=1", "-p", "track.wrong_box_cost:=0"),
        *("-p", f"target_box:={box}"),
    ]
    runs = []
    for _ in range(2):
        client.boxes.clear()
        client.statuses.clear()
        process = graph.process(*arguments)
        client.meet()
        client.show_all(images)
        stamps = [client.at(index) for index in range(len(images))]
        runs.append([client.box_at(stamp) for stamp in stamps])
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE) == 0
        client.wait_for(lambda: not client.images.get_subscription_count(), "end of the process")
    assert runs[0] == runs[1]

    tracker = Tracker.from_preset(
        "li2007", seed=9, parameters={"motion.position_noise": 1, "track.wrong_box_cost": 0.0}
    )
    boxes = [tracker.start(images[0], box).box]
    boxes += [tracker.update(image, 0.04).box for image in images[1:]]
    for message, (x, y, width, height) in zip(runs[0], boxes, strict=True):
        corner, opposite = message.polygon.points[0], message.polygon.points[2]
        assert (corner.x, corner.y) == pytest.approx((x, y), rel=1e-6)
        assert (opposite.x, opposite.y) == pytest.approx((x + width, y + height), rel=1e-6)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_process_cleanly_at_any_moment(graph, client, images, number):
    for moment in ("starting", "idle", "busy"):
        client.statuses.clear()
        client.boxes.clear()
        process = graph.process(
            *("-p", "image_reliability:=reliable", "-p", "particles:=500"),
            *("-p", "target_box:=[20, 30, 24, 24]"),
        )
        if moment == "starting":
            # The signal arrives while the node creates its endpoints.
            client.wait_for(lambda: client.count_publishers("/parameter_events") > 1, "node")
        else:
            client.meet()
        if moment == "busy":
            indices = itertools.count()

            def busy(indices=indices):
                # The awaited status may be a late one of the process before.
                index = next(indices)
                image = images[index % len(images)]
                client.images.publish(client.message(image, client.at(index)))
                return client.boxes

            client.wait_for(busy, "box")
        process.send_signal(number)
        output, _ = process.communicate(timeout=DEADLINE)
        assert process.returncode == 0, (moment, output)
        assert "Traceback" not in output
        assert "xception" not in output
        client.wait_for(lambda: client.count_publishers("/parameter_events") == 1, "end")


def test_an_invalid_parameter_is_logged_and_the_process_runs(graph, client, images):
    process = graph.process("-p", "particles:=0", "-p", "image_reliability:=reliable")
    client.meet()
    assert client.show(images[0], client.at(0)).level == "ERROR"
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0
    assert output.count("parameter 'particles' is 0; allowed: int, 1 to 100000") == 1
    assert output.count("its encoding is 'ping'") == 1


def test_invalid_ros_arguments_end_the_process_with_a_reason(graph, ros_domain):
    process = graph.process("-p", "target_box:=[1, 2.5, 3, 4]")
    output, _ = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert "target_box:=[1, 2.5, 3, 4]" in output
    assert "Traceback" not in output
