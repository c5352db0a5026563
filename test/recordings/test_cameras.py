"""`track` on a camera: a real RTSP stream over the loopback."""

import http.client
import json
import re
import signal
import time

import pytest
from common import QUICK, read_boxes

DEADLINE = 60
BOX = ("--box", "10,10,24,24")


def test_ctrl_c_ends_it_well_with_all_results(send_stream, start_track, wait_for_rows, tmp_path):
    pytest.importorskip("matplotlib")
    output = tmp_path / "out"
    outputs = ("--output", output, "--video", "--report")
    before = time.time_ns()
    process = start_track(send_stream(400), *QUICK, *BOX, *outputs)
    wait_for_rows(process, output, 5)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, errors) == (0, "")
    assert "secret" not in printed
    assert printed.startswith("opening rtsp://127.0.0.1:")
    found = read_boxes(output)
    # A busy machine may skip some, and lose the target by that.
    share = [row["state"] for row in found].count("tracking") / len(found)
    assert f"live: {len(found)} frames ({share:.0%} tracking)" in printed
    stamps = [int(row["stamp"]) for row in found]
    assert before < stamps[0] < stamps[-1] < time.time_ns()
    assert (output / "overlay.mp4").stat().st_size > 0
    page = (output / "report.html").read_text()
    assert "secret" not in page
    # The pictures are gone, but the timeline and the video are there.
    assert "data:image/jpeg" not in page
    assert 'id="timeline"' in page


def test_a_camera_that_ends_is_an_error_with_results(send_stream, start_track, tmp_path):
    output = tmp_path / "out"
    process = start_track(send_stream(20), *QUICK, *BOX, "--output", output)
    _, errors = process.communicate(timeout=DEADLINE)
    assert process.returncode == 3
    assert "sends no pictures; check its cable or network; " in errors
    assert re.search(rf"; {len(read_boxes(output))} frames? (was|were) tracked\n$", errors)


def test_a_target_is_drawn_on_a_picture(send_stream, start_track, wait_for_rows, tmp_path):
    pytest.importorskip("aiohttp")
    output = tmp_path / "out"
    process = start_track(send_stream(400), *QUICK, "--output", output, "--draw")
    process.stdout.readline()
    port = int(re.search(r"127.0.0.1:(\d+)/ \(", process.stdout.readline())[1])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=DEADLINE)

    def ask(path, method="GET", body=None):
        connection.request(method, path, body, {"Origin": f"http://127.0.0.1:{port}"})
        response = connection.getresponse()
        return dict(response.getheaders()), response.read()

    headers, _ = ask("/frame?number=0")
    # The next picture is another first frame.
    newer, _ = ask("/frame?number=1")
    assert (headers["X-Frame"], newer["X-Frame"], newer["X-Size"]) == ("0", "0", "64 48")
    target = {"frame": 0, "box": [10, 10, 24, 24]}
    answer = ask("/targets", "POST", json.dumps({"targets": [target]}))[1]
    assert answer == b"tracking; the outcome comes here"
    wait_for_rows(process, output, 5)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, errors) == (0, "")
    assert "not saved, because a camera sees it only now" in printed
    assert [float(read_boxes(output)[0][name]) for name in ("x", "y")] == [10, 10]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "no target for 127.0.0.1:"),
        (("--keyframes", "boxes.csv"), "--keyframes needs a recording, and "),
        (("--detections", "d.csv"), "--detections needs a recording, and "),
        (("--bag-topic", "/eye"), "--bag-topic applies to bags"),
    ],
)
def test_what_a_camera_cannot_do_is_refused(track, send_stream, tmp_path, options, message):
    code, _, errors = track(send_stream(20), "--output", tmp_path / "out", *options)
    assert (code, message in errors) == (2, True), errors
    assert "secret" not in errors
