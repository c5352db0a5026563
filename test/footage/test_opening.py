import pytest

from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.footage.opening import existing_path


def test_what_cannot_be_opened_is_told(tmp_path, write_bag, make_message):
    for opened in (open_footage, existing_path):
        with pytest.raises(FootageError, match=r"there is no .*nowhere; accepted are a video file"):
            opened(tmp_path / "nowhere")
    image = make_message("sensor_msgs/msg/Image", 5)
    bag = write_bag(tmp_path / "talk", [("/image", "sensor_msgs/msg/Image", 5, image)])
    (tmp_path / "empty").mkdir()
    for path, reason in (
        ("", "no source is given"),
        (tmp_path / "empty", r"has no images.*accepted are a video file"),
        ("~nobody_of_that_name/x", "~nobody_of_that_name/x names no folder"),
        (bag, "is a bag"),
    ):
        with pytest.raises(FootageError, match=reason):
            open_footage(path)


def test_storage_without_its_metadata_is_explained(tmp_path):
    (tmp_path / "talk_0.db3").write_bytes(b"")
    with pytest.raises(FootageError, match=r"has talk_0\.db3 but no metadata\.yaml.*reindex"):
        open_footage(tmp_path)
