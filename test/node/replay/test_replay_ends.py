"""Invalid starts, failures during the playback, and stopping."""

import math
import re
import signal

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.parameter import Parameter

from pf_tracker_ros.node.replay.playback import PlaybackStopped

DEADLINE = 60.0


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({}, "no source is given; .*; start 'replay drive.mcap', or .* param set /replay source"),
        ({"source": "/nowhere/at_all"}, "there is no /nowhere/at_all; accepted are"),
        ({"source": "{folder}", "rate": math.nan}, "'rate' is nan; allowed: float, 0.01 to 1000"),
        (
            {"source": "{folder}", "target_from_ground_truth": True},
            "has no ground truth for the target",
        ),
        (
            {"source": "{folder}", "target_box": [1.0, 1.0, 2.0, 2.0], "target_topic": "a b"},
            "topic name",
        ),
    ],
)
def test_an_invalid_start_logs_one_line_and_the_node_stays_up(
    pictures, replay, capfd, parameters, complaint
):
    if parameters.get("source") == "{folder}":
        parameters = {**parameters, "source": str(pictures.folder)}
    node = replay(**parameters)
    log = capfd.readouterr().err
    assert log.count("[ERROR]") == 1
    assert re.search(complaint, log), log
    assert "Traceback" not in log
    assert node.context.ok()


@pytest.mark.parametrize(
    "wrong", [{"source": "/nowhere"}, {"rate": -1.0}, {"target_topic": "a b"}], ids=str
)
def test_an_invalid_start_can_be_corrected(pictures, tracker, replay, wrong):
    right = {"source": str(pictures.folder), "rate": 1.0, "target_topic": "pf_tracker/target"}
    box = [1.0, 1.0, 2.0, 2.0]
    node = replay(**{"source": pictures.folder, "lockstep": True, "target_box": box} | wrong)
    (name,) = wrong
    node.set_parameters([Parameter(name, value=right[name])])
    tracker.spin_until_ended(node)
    assert tracker.stamps() == pictures.stamps
    assert node.exit_code == 0


def test_a_frame_that_cannot_be_decoded_ends_the_replay(pictures, tracker, replay, capfd):
    (pictures.folder / "3.png").write_bytes(b"broken")
    node = replay(source=pictures.folder, lockstep=True)
    tracker.spin_until_ended(node)
    assert node.exit_code == 1
    # Nobody waits on.
    with pytest.raises(PlaybackStopped):
        node.playback.wait_until_due(0, None)
    log = capfd.readouterr().err
    assert "3.png cannot be decoded" in log
    assert "Traceback" not in log
    assert tracker.stamps() == pictures.stamps[:3]


def test_a_damaged_video_is_played_as_far_as_it_goes(write_clip, tracker, replay, capfd, tmp_path):
    images = np.random.default_rng(5).integers(0, 256, (20, 48, 64, 3), dtype=np.uint8)
    web = {"movflags": "faststart"}
    whole = write_clip(tmp_path / "w.mp4", images, range(0, 800, 40), container_options=web)
    path = tmp_path / "cut.mp4"
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    node = replay(source=path, lockstep=True)
    tracker.spin_until_ended(node)
    assert node.exit_code == 0
    assert f"video {path} is damaged: it contains " in capfd.readouterr().err
    assert 0 < len(tracker.stamps()) < 20


@pytest.mark.parametrize(
    ("state", "number", "line"),
    [
        ({"lockstep": True}, signal.SIGINT, "replaying bag"),
        ({"start_paused": True}, signal.SIGTERM, "replaying bag"),
        ({"rate": 0.01}, signal.SIGINT, "replaying bag"),
        ({"bag_topic": "/nose"}, signal.SIGINT, "no image topic /nose; image topics are: /eye"),
    ],
    ids=["waiting for the tracker", "paused", "between two frames", "invalid"],
)
def test_it_can_be_stopped_in_every_state(recordings, replay_process, number, state, line):
    process = replay_process(source=recordings.write(), **state)
    # Fast DDS may tell first what killed processes left in shared memory.
    assert any(line in printed for printed in process.stdout)
    process.send_signal(number)
    log, _ = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0, log
    assert "Traceback" not in log
