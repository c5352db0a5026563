"""Cameras: what is one, and a real RTSP stream over the loopback."""

import socket

import numpy as np
import pytest

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.cameras import Camera, camera_name, is_camera


def test_a_number_a_device_and_an_rtsp_address_are_cameras(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "7").write_bytes(b"a file")
    (tmp_path / "8").mkdir()
    cameras = ("0", "12", "/dev/video3", "rtsp://eye/live", "rtsps://eye:8554/live?x=1")
    others = ("", "7", "8", "-1", "drive.mp4", "00.mp4", "https://eye/live", "/dev/videox")
    assert [is_camera(one) for one in cameras] == [True] * len(cameras)
    assert [is_camera(one) for one in others] == [False] * len(others)
    # The name of a camera has no password.
    assert camera_name("rtsp://user:secret@eye:8554/live?token=x") == "rtsp://eye:8554/live"
    assert camera_name("0") == camera_name("/dev/video0") == "camera 0"


def test_a_camera_that_is_not_there_is_an_error():
    with pytest.raises(FootageError, match=r"^camera 999 cannot be opened; (cameras here|this ma)"):
        Camera("999")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(FootageError, match="check address, user and password") as error:
        Camera(f"rtsp://user:secret@127.0.0.1:{port}/live")
    assert "secret" not in str(error.value)


def test_pictures_have_rising_stamps_until_the_camera_ends(send_stream):
    camera = Camera(send_stream(20))
    pictures = []
    with pytest.raises(FootageError, match="sends no pictures; check its cable or network"):
        pictures.extend(iter(camera.next, None))
    camera.close()
    assert 1 <= len(pictures) <= 20
    assert pictures[0].image.shape == (48, 64, 3)
    assert float(np.std(pictures[0].image)) > 20
    stamps = [picture.stamp for picture in pictures]
    assert stamps == sorted(set(stamps))
    assert camera.interval == pytest.approx(0.04)
