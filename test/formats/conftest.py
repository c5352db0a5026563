"""Writes tracks in a format, and reads them back."""

import pytest

from pf_tracker_ros.formats import FORMATS, RecordingInfo, read_tracks


# YOLO's labels have neither ids nor confidences: they have tests of their own.
@pytest.fixture(params=[name for name in FORMATS if name != "yolo"])
def format_name(request):
    """Each format."""
    return request.param


@pytest.fixture
def write_and_read(tmp_path, format_name):
    """Writes tracks of a recording with a number of frames, and reads them back."""

    def run(tracks, frame_count=40):
        info = RecordingInfo("drive.mp4", frame_count, {0: (640, 480)})
        for name, write in FORMATS[format_name].items():
            write(tmp_path / name, tracks, info)
        return read_tracks(tmp_path / next(iter(FORMATS[format_name])))

    return run
