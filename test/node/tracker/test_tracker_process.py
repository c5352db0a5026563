"""The node as a process, as `ros2 run` starts it."""

import itertools
import signal

import pytest
from generate import generated_files

from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

DEADLINE = 60.0


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_file_is_a_valid_ros_parameter_file(graph, client, images, tmp_path, preset):
    path = tmp_path / "preset.yaml"
    path.write_text(generated_files()[f"config/{preset}.yaml"])
    arguments = ["--ros-args", "--params-file", str(path), "-p", "image_reliability:=reliable"]
    graph.tracker(client, cli_args=arguments)
    assert client.tunables() == preset_parameters(preset)
    assert client.get_parameters("preset") == [preset]
    status = client.show(images[0], client.at(0))
    assert (status.level, status.message) == ("OK", "waiting for a target")


@pytest.mark.parametrize(
    ("moment", "number"), [("starting", signal.SIGTERM), ("busy", signal.SIGINT)]
)
def test_a_signal_ends_the_process_cleanly_at_any_moment(graph, client, images, moment, number):
    process = graph.process(
        *("-p", "image_reliability:=reliable", "-p", "particles:=500"),
        *("-p", "target_box:=[20, 30, 24, 24]"),
    )
    if moment == "starting":
        # The signal arrives while the node creates its endpoints.
        client.wait_for(lambda: client.count_publishers("/parameter_events") > 1, "node")
    else:
        client.meet()
        indices = itertools.count()

        def is_busy():
            index = next(indices)
            client.images.publish(client.message(images[index % len(images)], client.at(index)))
            return client.boxes

        client.wait_for(is_busy, "box")
    process.send_signal(number)
    output, _ = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0, output
    assert "Traceback" not in output
    assert "xception" not in output
