"""When a frame goes out: lockstep, loop, pause and rate."""

import itertools
import time

import pytest
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from pf_tracker_ros.node.replay import replay_node


def test_lockstep_has_one_frame_under_way_and_waits_for_the_tracker(pictures, stand_in, replay):
    tracker = stand_in()
    replay(source=pictures.folder, lockstep=True, target_box=[1.0, 2.0, 3.0, 4.0])
    # Until somebody takes images, not even the target comes.
    tracker.spin_until(lambda: tracker.count_publishers("/image") == 1)
    assert tracker.events == []
    tracker.listen()
    tracker.spin_until(lambda: len(tracker.seen("answer")) == 6)
    kinds = [kind for kind, _ in tracker.events]
    assert kinds == ["target", *["image", "answer"] * 6]
    assert tracker.stamps() == pictures.stamps
    assert tracker.stamps("target") == pictures.stamps[:1]


def test_lockstep_publishes_an_unanswered_frame_again(pictures, stand_in, replay, capfd):
    tracker = stand_in()
    tracker.listen()
    tracker.deaf_to = {pictures.stamps[2]: 2}
    node = replay(source=pictures.folder, lockstep=True, lockstep_timeout=0.5)
    tracker.spin_until_ended(node)
    assert [stamp for stamp, _ in itertools.groupby(tracker.stamps())] == pictures.stamps
    assert tracker.stamps().count(pictures.stamps[2]) >= 3
    log = capfd.readouterr().err
    assert "no status for frame 2" in log
    assert log.count("publishing it again") == 1, "the warning is throttled"


def test_a_loop_begins_again_with_the_target_until_it_is_switched_off(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, lockstep=True, loop=True, target_box=[1.0, 2.0, 3.0, 4.0])
    tracker.spin_until(lambda: len(tracker.seen("image")) >= 14)
    tracker.set_replay_parameter("loop", False)
    tracker.spin_until_ended(node)
    passes = len(tracker.seen("target"))
    assert passes >= 3
    assert tracker.stamps() == pictures.stamps * passes
    kinds = [kind for kind, _ in tracker.events if kind != "answer"]
    assert kinds == ["target", *["image"] * 6] * passes


def test_nothing_comes_while_paused(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, start_paused=True, rate=1000.0, publish_clock=True)
    tracker.spin_until(lambda: tracker.count_publishers("/image") == 1)
    assert tracker.pause().message == "paused, 0 frames published"
    assert tracker.seen("image") == []
    tracker.go_on()
    tracker.spin_until(lambda: pictures.stamps[-1] in tracker.stamps())
    assert tracker.stamps() == sorted(tracker.stamps())
    tracker.spin_until(lambda: pictures.stamps[-1] in tracker.stamps("clock"))
    tracker.spin_until_ended(node)


def test_the_rate_counts_at_once(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    # At this rate a frame would come every 4 s, the last one after 20 s.
    began = time.monotonic()
    node = replay(source=pictures.folder, rate=0.01, start_paused=True)
    tracker.go_on()
    tracker.spin_until(lambda: tracker.seen("image"))
    tracker.set_replay_parameter("rate", 1000.0)
    tracker.spin_until(lambda: len(tracker.seen("image")) == len(pictures.stamps))
    assert time.monotonic() - began < 20.0
    tracker.spin_until_ended(node)


def test_pictures_are_stamped_with_the_time_at_which_they_go_out(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    began = time.time_ns()
    node = replay(source=pictures.folder, target_box=[1.0, 2.0, 3.0, 4.0], start_paused=True)
    tracker.go_on()
    tracker.spin_until(lambda: len(tracker.seen("image")) == 3)
    tracker.pause()
    paused = time.time_ns()
    tracker.go_on()
    tracker.spin_until_ended(node)
    stamps = tracker.stamps()
    assert began < stamps[0]
    assert stamps[-1] < time.time_ns() + 10**9
    assert tracker.stamps("target") == stamps[:1]
    steps = [second - first for first, second in itertools.pairwise(stamps)]
    # Between two frames the source's time goes by, and once that of the pause.
    assert sorted(steps)[:4] == [40_000_000] * 4
    assert stamps[-1] > paused


@pytest.mark.parametrize("exact", ["lockstep", "publish_clock"])
def test_pictures_have_the_same_stamps_in_each_run_where_that_matters(
    pictures, stand_in, replay, exact
):
    tracker = stand_in()
    tracker.listen()
    # With a target it waits for who takes its images.
    box = [1.0, 2.0, 3.0, 4.0]
    tracker.spin_until_ended(replay(source=pictures.folder, target_box=box, **{exact: True}))
    assert tracker.stamps() == pictures.stamps


def test_of_a_loop_the_last_frames_alone_are_remembered(pictures, stand_in, replay, monkeypatch):
    monkeypatch.setattr(replay_node, "_MOST_REMEMBERED", 8)
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, loop=True, rate=10.0)
    tracker.spin_until(lambda: len(tracker.stamps()) >= 24)
    node.playback.paused = True
    assert node.playback.wait_until_held(30.0)

    def known():
        return [stamp for stamp in tracker.stamps() if node.index_of(stamp) is not None]

    tracker.spin_until(lambda: len(known()) == 8)
    assert known() == tracker.stamps()[-8:]


def test_each_pass_of_a_loop_goes_on_in_time(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, loop=True)
    tracker.spin_until(lambda: len(tracker.seen("image")) >= 13)
    tracker.set_replay_parameter("loop", False)
    tracker.spin_until_ended(node)
    stamps = tracker.stamps()
    assert stamps == sorted(set(stamps))


def test_steps_play_single_frames_of_a_pause(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    replay(source=pictures.folder, start_paused=True, lockstep=True, loop=True)

    def step():
        future = tracker.replay_services.ask(Trigger, "step")
        tracker.spin_until(future.done)
        return future.result()

    for count in (1, 2, 3):
        assert step().success
        tracker.spin_until(lambda count=count: len(tracker.seen("answer")) == count)
    assert tracker.stamps() == pictures.stamps[:3]
    going_on = tracker.go_on()
    tracker.spin_until(going_on.done)
    assert going_on.result().success
    refusal = step()
    assert not refusal.success
    assert "~/pause" in refusal.message


def test_a_replay_that_stands_still_tells_who_has_gone(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, start_paused=True, lockstep=True)
    tracker.go_on()
    tracker.spin_until(lambda: tracker.seen("answer"))
    tracker.pause()
    tracker.spin_until(lambda: node.wait_reason == "")
    (heard,) = [s for s in tracker.subscriptions if s.topic_name == "/image"]
    tracker.destroy_subscription(heard)
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


def test_it_waits_at_its_end_where_it_is_to_stay(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, lockstep=True, stay_at_end=True)
    tracker.spin_until(lambda: len(tracker.seen("answer")) == 6)
    assert node.playback.wait_until_held(30.0)
    assert node.playback.paused
    assert (node.position, node.frame_count) == (5, 6)
    assert node.index_of(pictures.stamps[2]) == 2
    node.playback.seek(2)
    tracker.spin_until(lambda: len(tracker.seen("answer")) == 7)
    assert node.playback.wait_until_held(30.0)
    assert tracker.stamps() == [*pictures.stamps, pictures.stamps[2]]
    assert node.position == 2


def test_lockstep_goes_no_faster_than_its_rate(pictures, stand_in, replay):
    tracker = stand_in()
    tracker.listen()
    node = replay(source=pictures.folder, lockstep=True, lockstep_rate=0.5)
    tracker.spin_until(lambda: tracker.seen("answer"))
    began = time.monotonic()
    tracker.spin_until_ended(node)
    # Five intervals of 40 ms at half the speed; the first frame may have been noted late.
    assert time.monotonic() - began > 0.3
