import pytest

from pf_tracker_ros.evaluation import EvaluationError, find_sequences, read_sequences
from pf_tracker_ros.evaluation.sequences import open_sequences
from pf_tracker_ros.footage import FootageError


def test_sequences_in_a_folder_are_found_one_level_deep(write_short, tmp_path):
    sequences = [write_short(name) for name in ("c", "a", "b")]
    write_short("d", parent=tmp_path / "group")
    (tmp_path / "video").mkdir()
    (tmp_path / "video" / "clip.avi").touch()
    (tmp_path / "README.md").touch()
    assert find_sequences([tmp_path]) == sorted(sequences)
    # Given twice, it counts once; the order is kept.
    assert find_sequences([sequences[2], tmp_path, str(sequences[1])])[:2] == [
        sequences[2], sequences[1],
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["lacking", "lost+found"])
def test_what_cannot_be_opened_leaves_the_others(write_short, tmp_path, make_unreadable, name):
    whole = write_short("whole")
    if name == "lacking":
        (write_short(name) / "groundtruth.txt").unlink()
    else:
        make_unreadable(tmp_path / name)
    sequences, (failure,) = open_sequences([tmp_path])
    assert [footage.name for footage in sequences] == [whole.name]
    assert failure.name == name
    reason = "groundtruth.txt" if name == "lacking" else "may not be read by this user"
    assert reason in str(failure.error)
    with pytest.raises(FootageError, match=reason):
        read_sequences([tmp_path])


def test_missing_folders_and_sequences_of_one_name_are_refused(write_short, tmp_path):
    (tmp_path / "file.txt").touch()
    for name in ("absent", "file.txt"):
        with pytest.raises(EvaluationError, match=f"no folder '.*{name}'; allowed: a sequence"):
            find_sequences([tmp_path / name])
    for parent in ("one", "two"):
        write_short("a", parent=tmp_path / parent)
    with pytest.raises(EvaluationError, match="several sequences are named 'a'"):
        read_sequences([tmp_path / "one", tmp_path / "two"])


def test_real_sequences_are_found(sequences_directory):
    sequences = read_sequences([sequences_directory])
    assert len(sequences) >= 32
    assert "video" not in [footage.name for footage in sequences]
    assert all(footage.frame_count == len(footage.ground_truth) for footage in sequences)
