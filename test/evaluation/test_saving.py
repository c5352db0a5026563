"""Completed results are kept whatever happens to later sequences or to the output."""

import json
import os

import cv2
import pytest
from common import full_disk

from pf_tracker_ros.evaluation import EvaluationError
from pf_tracker_ros.evaluation.output_files import OutputFile

RUN = ("--preset", "li2007", "--seeds", "2", "--output", "r.json")


@pytest.fixture
def document(tmp_path):
    return lambda: json.loads((tmp_path / "r.json").read_text())


def test_a_sequence_that_fails_does_not_stop_the_others(evaluate, write_short, tmp_path, document):
    _, broken, _ = map(write_short, "abc")
    (broken / "img" / "0003.png").write_bytes(b"not a picture")
    code, table, errors = evaluate("a", "b", "c", *RUN, "--plot", "p.png")
    assert code == 1
    (line,) = errors.splitlines()
    assert line.startswith("evaluate: error: image ")
    assert "0003.png cannot be decoded" in line
    assert list(document()["sequences"]) == ["a", "c"]
    assert document()["mean"]["frames"] == 5
    assert all(f"│ {name} " in table for name in ("a", "c", "mean"))
    assert "│ b " not in table
    # The preset's curve is the only thing in color.
    image = cv2.imread(str(tmp_path / "p.png"))
    assert min(image.shape[:2]) >= 400
    assert (image.max(axis=2) - image.min(axis=2) > 60).any()


@pytest.mark.parametrize("others", [True, False])
def test_a_sequence_that_cannot_be_opened_does_not_stop_the_others(
    evaluate, write_short, document, tmp_path, others
):
    broken, empty = map(write_short, ("broken", "empty"))
    (broken / "groundtruth.txt").write_text("1,2,3,4\n5,6,seven,8\n")
    (empty / "groundtruth.txt").write_text("nan,nan,nan,nan\n" * 5)
    for name in ("a", "c") if others else ():
        write_short(name)
    code, output, errors = evaluate(".", *RUN)
    first, second = errors.splitlines()
    assert "broken/groundtruth.txt, line 2" in first
    assert second.startswith("evaluate: error: empty: the target is absent in the first frame")
    if others:
        assert code == 1
        for line in (first, second):
            assert line.endswith("; the figures are without this sequence")
        assert list(document()["sequences"]) == ["a", "c"]
        assert all(f"│ {name} " in output for name in ("a", "c", "mean"))
    else:
        assert (code, output) == (2, "")
        assert not (tmp_path / "r.json").exists()


def test_without_any_success_there_is_no_result(evaluate, short_sequence, tmp_path):
    (short_sequence / "groundtruth.txt").write_text("900,900,20,20\n" * 5)
    (tmp_path / "r.json").write_text("of last time")
    code, output, errors = evaluate("short", *RUN)
    assert (code, output) == (1, "")
    first, second = errors.splitlines()
    assert first.startswith("evaluate: error: short, frame 1: ")
    assert "outside the image" in first
    assert second == "evaluate: error: no sequence could be evaluated"
    assert (tmp_path / "r.json").read_text() == "of last time"


@pytest.mark.usefixtures("short_sequence")
@pytest.mark.parametrize(
    ("output", "code", "said"),
    [
        ("closed", 141, ""),
        ("full", 1, "evaluate: error: the table cannot be printed (No space left on device)\n"),
    ],
)
def test_results_are_written_though_no_table_is(start_evaluate, document, output, code, said):
    if output == "closed":
        reading, writing = os.pipe()
        os.close(reading)
    else:
        writing = os.open("/dev/full", os.O_WRONLY)
    process = start_evaluate("short", *RUN, stdout=writing)
    os.close(writing)
    _, errors = process.communicate(timeout=120)
    assert (process.returncode, errors) == (code, said)
    assert list(document()["sequences"]) == ["short"]


def test_an_output_in_ascii_gets_a_table_in_ascii(start_evaluate, write_short, document):
    write_short("Tür")
    process = start_evaluate("Tür", *RUN, PYTHONIOENCODING="ascii")
    output, errors = process.communicate(timeout=120)
    assert (process.returncode, errors) == (0, "")
    assert output.isascii()
    lines = output.splitlines()
    assert any(line.startswith("| sequence") and " +- |" in line for line in lines)
    assert any(line.startswith(r"| T\xfcr ") for line in lines)
    assert list(document()["sequences"]) == ["Tür"]


def test_a_full_disk_keeps_the_last_whole_file(evaluate, write_short, tmp_path, document):
    names = [f"sequence_{number}" for number in range(4)]
    for name in names:
        write_short(name)
    # Room for two sequences, not for three.
    with full_disk(650):
        code, output, errors = evaluate(*names, *RUN)
    assert (code, errors.count("\n")) == (1, 1)
    assert "r.json cannot be written (File too large); its last version is kept" in errors
    assert list(document()["sequences"]) == names[:2]
    assert all(f"│ {name} " in output for name in names)
    assert {path.name for path in tmp_path.iterdir()} == {*names, "r.json"}


def test_help_lists_the_exit_codes(evaluate):
    _, output, _ = evaluate("--help")
    for code in ("0", "1", "2", "130", "141", "143"):
        assert any(line.split()[:1] == [code] for line in output.splitlines())


def test_a_link_is_followed_and_a_failed_write_tells_once(tmp_path):
    (tmp_path / "disk").mkdir()
    link = tmp_path / "r.json"
    link.symlink_to("disk/r.json")
    file = OutputFile(link)

    def fail(draft):
        raise OSError(28, "No space left on device")

    assert "No space left on device" in file.write(fail)
    assert file.write(fail) is None
    assert file.error is not None
    assert file.write(lambda draft: draft.write_text("new")) is None
    assert file.error is None
    assert link.is_symlink()
    assert (tmp_path / "disk" / "r.json").read_text() == "new"


def test_checking_a_file_leaves_it_unchanged(tmp_path):
    path = tmp_path / "r.json"
    OutputFile(path)
    assert list(tmp_path.iterdir()) == []
    os.mkfifo(path)
    with pytest.raises(EvaluationError, match="no regular file"):
        OutputFile(path)
