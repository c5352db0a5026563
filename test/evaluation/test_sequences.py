import pytest

from pf_tracker_ros.evaluation import EvaluationError, find_sequences, read_sequences
from pf_tracker_ros.evaluation.sequences import open_sequences
from pf_tracker_ros.footage import FootageError


@pytest.fixture
def write_short(write_sequence, moving_square):
    """Writes the first 3 frames of the moving square."""

    def write(name, **options):
        return write_sequence(name, moving_square.images[:3], moving_square.boxes[:3], **options)

    return write


def test_sequences_in_a_folder_are_found(write_short, tmp_path):
    sequences = [write_short(name) for name in ("c", "a", "b")]
    (tmp_path / "video").mkdir()
    (tmp_path / "video" / "clip.avi").touch()
    (tmp_path / "README.md").touch()
    assert find_sequences([tmp_path]) == sorted(sequences)


def test_a_sequence_without_ground_truth_is_reported(write_short, tmp_path):
    whole, lacking = write_short("whole"), write_short("lacking")
    (lacking / "groundtruth.txt").unlink()
    sequences, failures = open_sequences([tmp_path])
    assert [footage.name for footage in sequences] == [whole.name]
    (failure,) = failures
    assert failure.name == "lacking"
    assert "groundtruth.txt" in str(failure.error)


def test_a_folder_that_may_not_be_read_leaves_the_others(write_short, tmp_path, make_unreadable):
    whole = write_short("whole")
    make_unreadable(tmp_path / "lost+found")
    sequences, failures = open_sequences([tmp_path])
    assert [footage.name for footage in sequences] == [whole.name]
    (failure,) = failures
    assert failure.name == "lost+found"
    assert "may not be read by this user" in str(failure.error)


def test_sequence_given_twice_counts_once_and_order_is_kept(write_short, tmp_path):
    first, second = write_short("a"), write_short("b")
    assert find_sequences([second, tmp_path, str(first)]) == [second, first]


def test_folders_are_not_searched_deeper_than_one_level(write_short, tmp_path):
    write_short("a", parent=tmp_path / "group")
    with pytest.raises(EvaluationError, match="no sequence in"):
        find_sequences([tmp_path])
    assert len(find_sequences([tmp_path / "group"])) == 1


@pytest.mark.parametrize("name", ["absent", "file.txt"])
def test_a_missing_folder_is_named(tmp_path, name):
    (tmp_path / "file.txt").touch()
    with pytest.raises(EvaluationError, match=f"no folder '.*{name}'; allowed: a sequence"):
        find_sequences([tmp_path / name])


def test_sequences_of_one_name_are_refused(write_short, tmp_path):
    write_short("a", parent=tmp_path / "one")
    write_short("a", parent=tmp_path / "two")
    with pytest.raises(EvaluationError, match="several sequences are named 'a'"):
        read_sequences([tmp_path / "one", tmp_path / "two"])


def test_broken_ground_truth_is_refused_on_opening(write_short):
    folder = write_short("a")
    (folder / "groundtruth.txt").write_text("1,2,3,4\n5,6,seven,8\n9,10,11,12\n")
    with pytest.raises(FootageError, match="line 2"):
        read_sequences([folder])


def test_real_sequences_are_found(sequences_directory):
    sequences = read_sequences([sequences_directory])
    assert len(sequences) >= 32
    assert "video" not in [footage.name for footage in sequences]
    assert all(footage.frame_count == len(footage.ground_truth) for footage in sequences)
