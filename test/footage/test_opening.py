import pytest

from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.footage.opening import existing_path


@pytest.mark.parametrize("open_path", [open_footage, existing_path])
def test_a_missing_path_is_refused(tmp_path, open_path):
    with pytest.raises(FootageError, match=r"there is no .*nowhere; accepted are a video file"):
        open_path(tmp_path / "nowhere")


def test_no_path_is_refused():
    with pytest.raises(FootageError, match="no source is given"):
        open_footage("")


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(FootageError, match=r"has no images.*accepted are a video file"):
        open_footage(tmp_path)


def test_storage_without_its_metadata_is_explained(tmp_path):
    (tmp_path / "talk_0.db3").write_bytes(b"")
    with pytest.raises(FootageError, match=r"has talk_0\.db3 but no metadata\.yaml.*reindex"):
        open_footage(tmp_path)


def test_a_user_that_does_not_exist_is_named():
    with pytest.raises(FootageError, match="~nobody_of_that_name/x names no folder"):
        open_footage("~nobody_of_that_name/x")


def test_a_bag_is_not_footage(tmp_path, write_bag, make_message):
    image = make_message("sensor_msgs/msg/Image", 5)
    bag = write_bag(tmp_path / "talk", [("/image", "sensor_msgs/msg/Image", 5, image)])
    with pytest.raises(FootageError, match="is a bag"):
        open_footage(bag)
