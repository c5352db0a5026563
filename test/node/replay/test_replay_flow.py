"""Timing of the frames: lockstep, loop, pause and rate."""

import itertools
import time

from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from pf_tracker_ros.node.replay import playback, replay_node


def test_lockstep_waits_for_the_tracker_after_each_frame(pictures, stand_in, replay):
    tracker = stand_in()
    replay(source=pictures.folder, lockstep=True, target_box=[1.0, 2.0, 3.0, 4.0])
    # Without image subscriber, not even the target is published.
    tracker.spin_until(lambda: tracker.count_publishers("/image") == 1)
    assert tracker.events == []
    tracker.listen()
    tracker.spin_until(lambda: len(tracker.seen("status")) == 6)
    kinds = [kind for kind, _ in tracker.events]
    assert kinds == ["target", *["image", "status"] * 6]
    assert tracker.stamps() == pictures.stamps
    assert tracker.stamps("target") == pictures.stamps[:1]


def test_lockstep_publishes_a_frame_without_status_again(
    pictures, tracker, replay, monkeypatch, capfd
):
    monkeypatch.setattr(replay_node, "_WARNING_INTERVAL", 60.0)
    tracker.ignored = {pictures.stamps[2]: 2}
    node = replay(source=pictures.folder, lockstep=True, start_paused=True)

    def limit(index):
        # The others have time also where this machine is busy.
        timeout = Parameter("lockstep_timeout", value=0.1 if index == 2 else 60.0)
        node.set_parameters([timeout])

    node.before_frame = limit
    tracker.resume()
    tracker.spin_until_ended(node)
    assert [stamp for stamp, _ in itertools.groupby(tracker.stamps())] == pictures.stamps
    assert tracker.stamps().count(pictures.stamps[2]) >= 3
    log = capfd.readouterr().err
    assert "no status for frame 2" in log
    assert log.count("publishing it again") == 1, "the warning is throttled"


def test_a_loop_repeats_with_the_target_until_switched_off(pictures, tracker, replay):
    node = replay(source=pictures.folder, lockstep=True, loop=True, target_box=[1.0, 2.0, 3.0, 4.0])
    tracker.spin_until(lambda: len(tracker.seen("image")) >= 14)
    tracker.set_replay_parameter("loop", False)
    tracker.spin_until_ended(node)
    passes = len(tracker.seen("target"))
    assert passes >= 3
    assert tracker.stamps() == pictures.stamps * passes
    kinds = [kind for kind, _ in tracker.events if kind != "status"]
    assert kinds == ["target", *["image"] * 6] * passes


def test_nothing_is_published_while_paused(pictures, tracker, replay):
    node = replay(source=pictures.folder, start_paused=True, rate=1000.0, publish_clock=True)
    tracker.spin_until(lambda: tracker.count_publishers("/image") == 1)
    assert tracker.pause().message == "paused, 0 frames published"
    assert tracker.seen("image") == []
    tracker.resume()
    tracker.spin_until(lambda: pictures.stamps[-1] in tracker.stamps())
    assert tracker.stamps() == sorted(tracker.stamps())
    tracker.spin_until(lambda: pictures.stamps[-1] in tracker.stamps("clock"))
    tracker.spin_until_ended(node)


def test_a_new_rate_applies_at_once(pictures, tracker, replay):
    # At this rate a frame would come every 16 minutes.
    node = replay(source=pictures.folder, frame_rate=0.1, rate=0.01, start_paused=True)
    tracker.resume()
    tracker.spin_until(lambda: tracker.seen("image"))
    tracker.set_replay_parameter("rate", 1000.0)
    tracker.spin_until(lambda: len(tracker.seen("image")) == len(pictures.stamps))
    tracker.spin_until_ended(node)


def test_images_are_stamped_with_the_time_of_publication(pictures, tracker, replay, monkeypatch):
    # So that only the target and the pause restart the schedule, however busy the machine is.
    monkeypatch.setattr(playback, "TOLERATED_LAG", 60.0)
    began = time.time_ns()
    node = replay(source=pictures.folder, target_box=[1.0, 2.0, 3.0, 4.0], start_paused=True)

    def pause_after_the_fourth_image(index):
        node.playback.paused = index == 3

    node.before_frame = pause_after_the_fourth_image
    tracker.resume()
    tracker.spin_until(lambda: len(tracker.seen("image")) == 4)
    assert node.playback.wait_until_held(30.0)
    paused = time.time_ns()
    tracker.resume()
    tracker.spin_until_ended(node)
    stamps = tracker.stamps()
    assert began < stamps[0]
    assert paused < stamps[4]
    assert stamps[-1] < time.time_ns() + 10**9
    assert tracker.stamps("target") == stamps[:1]
    waits = [second - first for first, second in itertools.pairwise(stamps)]
    # The intervals are the source's, but for the acknowledgment of the target and the pause.
    assert waits[0] >= 40_000_000
    assert [waits[1], waits[2], waits[4]] == [40_000_000] * 3


def test_images_have_reproducible_stamps_with_a_clock(pictures, tracker, replay):
    # With a target it waits for an image subscriber.
    box = [1.0, 2.0, 3.0, 4.0]
    tracker.spin_until_ended(replay(source=pictures.folder, target_box=box, publish_clock=True))
    assert tracker.stamps() == pictures.stamps


def test_only_the_last_stamps_of_a_loop_are_indexed(pictures, tracker, replay, monkeypatch):
    monkeypatch.setattr(replay_node, "_MAX_INDEXED_STAMPS", 8)
    node = replay(source=pictures.folder, loop=True, rate=10.0)
    tracker.spin_until(lambda: len(tracker.stamps()) >= 24)
    node.playback.paused = True
    assert node.playback.wait_until_held(30.0)

    def known():
        return [stamp for stamp in tracker.stamps() if node.index_of(stamp) is not None]

    tracker.spin_until(lambda: len(known()) == 8)
    assert known() == tracker.stamps()[-8:]


def test_steps_publish_single_frames_during_a_pause(pictures, tracker, replay):
    replay(source=pictures.folder, start_paused=True, lockstep=True, loop=True)

    def step():
        future = tracker.replay_services.ask(Trigger, "step")
        tracker.spin_until(future.done)
        return future.result()

    for count in (1, 2, 3):
        assert step().success
        tracker.spin_until(lambda count=count: len(tracker.seen("status")) == count)
    assert tracker.stamps() == pictures.stamps[:3]
    going_on = tracker.resume()
    tracker.spin_until(going_on.done)
    assert going_on.result().success
    refusal = step()
    assert not refusal.success
    assert "~/pause" in refusal.message


def test_a_paused_replay_reports_a_missing_subscriber(pictures, tracker, replay):
    node = replay(source=pictures.folder, start_paused=True, lockstep=True)
    tracker.resume()
    tracker.spin_until(lambda: tracker.seen("status"))
    tracker.pause()
    tracker.spin_until(lambda: node.wait_reason == "")
    (images,) = [s for s in tracker.subscriptions if s.topic_name == "/image"]
    tracker.destroy_subscription(images)
    tracker.spin_until(lambda: node.wait_reason == "waiting for a subscriber of /image")


def test_nothing_is_played_for_a_spectator_alone(pictures, stand_in, replay, graph):
    tracker = stand_in()
    spectator = Node("spectator", context=graph.context())
    graph.run(spectator)
    spectator.create_subscription(Image, "image", lambda image: None, 10)
    node = replay(spectator=spectator, source=pictures.folder, lockstep=True)
    tracker.spin_until(lambda: node.count_subscribers("/image") == 1)
    tracker.spin_until(lambda: node.wait_reason == "waiting for a subscriber of /image")
    assert node.position == -1
    tracker.listen()
    tracker.spin_until_ended(node)
    assert tracker.stamps() == pictures.stamps


def test_it_waits_at_the_end_with_stay_at_end(pictures, tracker, replay):
    node = replay(source=pictures.folder, lockstep=True, stay_at_end=True)
    tracker.spin_until(lambda: len(tracker.seen("status")) == 6)
    assert node.playback.wait_until_held(30.0)
    assert node.playback.paused
    assert (node.position, node.frame_count) == (5, 6)
    assert node.index_of(pictures.stamps[2]) == 2
    node.playback.seek(2)
    tracker.spin_until(lambda: len(tracker.seen("status")) == 7)
    assert node.playback.wait_until_held(30.0)
    assert tracker.stamps() == [*pictures.stamps, pictures.stamps[2]]
    assert node.position == 2


def test_lockstep_goes_no_faster_than_its_rate(pictures, tracker, replay, monkeypatch):
    rates = []
    monkeypatch.setattr(
        playback.Playback, "wait_until_due", lambda self, time, rate: rates.append(rate()) or 0.0
    )
    tracker.spin_until_ended(replay(source=pictures.folder, lockstep=True, lockstep_rate=0.5))
    assert rates == [0.5] * len(pictures.stamps)
