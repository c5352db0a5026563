"""Written videos: the codec and layout that browsers need, and the images in them."""

from fractions import Fraction

import cv2
import numpy as np
import pytest

from pf_tracker_ros.footage import video_encoding
from pf_tracker_ros.footage.video_encoding import OpencvEncoder, PyavEncoder, open_encoder

av = pytest.importorskip("av", reason="needs PyAV")

BLUE_GREEN_RED = (40, 160, 220)


def write(path, encoder, size=(65, 49), count=30):
    """Write gray images with a colored square that moves by a pixel a frame."""
    with_encoder = encoder(path, 12.5, size)
    for number in range(count):
        image = np.full((size[1], size[0], 3), 90, np.uint8)
        image[10:26, number : number + 16] = BLUE_GREEN_RED
        with_encoder.write(image)
    with_encoder.close()
    with_encoder.close()


def check(path, codec):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == codec
        assert (stream.width, stream.height, stream.pix_fmt) == (66, 50, "yuv420p")
        assert stream.average_rate == Fraction(25, 2)
        frames = list(container.decode(stream))
    assert [frame.time for frame in frames] == [number / 12.5 for number in range(30)]
    for number in (0, 29):
        image = frames[number].to_ndarray(format="bgr24")
        assert np.abs(image[18, number + 8] - np.array(BLUE_GREEN_RED)).max() <= 8
        assert np.abs(image[40, 5].astype(int) - 90).max() <= 4


@pytest.mark.parametrize(("codec", "library"), [("h264", "libx264"), ("vp9", "libvpx-vp9")])
def test_it_is_h264_or_vp9_that_browsers_play_while_it_loads(tmp_path, monkeypatch, codec, library):
    available = av.codecs_available if codec == "h264" else av.codecs_available - {"libx264"}
    if library not in available:
        pytest.skip(f"this PyAV has no {library}")
    monkeypatch.setattr(av, "codecs_available", available)
    video_encoding._pyav_codec.cache_clear()
    path = tmp_path / "a.mp4"
    try:
        write(path, open_encoder)
    finally:
        video_encoding._pyav_codec.cache_clear()
    check(path, codec)
    # The index comes first.
    assert path.read_bytes().index(b"moov") < path.read_bytes().index(b"mdat")


def test_without_pyav_opencv_writes_it(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(video_encoding, "_pyav_codec", lambda: None)
    assert PyavEncoder.is_for_browsers
    encoder = open_encoder(tmp_path / "a.mp4", 12.5, (64, 48))
    assert isinstance(encoder, OpencvEncoder)
    for _ in range(3):
        encoder.write(np.full((48, 64, 3), 90, np.uint8))
    encoder.close()
    with av.open(str(tmp_path / "a.mp4")) as container:
        codec = container.streams.video[0].codec_context.name
    assert encoder.is_for_browsers == (codec == "h264")
    assert cv2.VideoCapture(str(tmp_path / "a.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert capfd.readouterr().err == ""


def test_an_unwritable_file_is_an_oserror(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        write(tmp_path / "missing" / "a.mp4", open_encoder)
