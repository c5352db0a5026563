"""The example for `launch_testing`, run by `launch_test` as it is documented."""

import csv
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]


@pytest.fixture
def launch_test(shell, drive):
    """Runs the example on a recording and the boxes that `track` finds in it."""
    pytest.importorskip("launch_testing", reason="comes with a ROS from apt, and PyPI has none")
    (shell.folder / "drive.target.yaml").write_text("target_box: [42, 188, 44, 132]\n")
    assert shell.run("track drive.mcap --output tracked").returncode == 0

    def run(boxes):
        example = REPOSITORY / "examples" / "replay_launch_test.py"
        return shell.run(f"launch_test {example} source:={drive} boxes:={boxes}")

    return run


def test_the_boxes_of_the_nodes_are_those_that_were_stored(launch_test):
    outcome = launch_test("tracked/boxes.csv")
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    assert "test_the_boxes_are_those_of_before" in outcome.stdout + outcome.stderr


def test_boxes_elsewhere_fail_the_test_and_name_the_frame(launch_test, shell):
    path = shell.folder / "tracked" / "boxes.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    # From the second frame on: the first one tells the target.
    for row in rows[1:]:
        row["x"] = str(float(row["x"]) + 60.0)
    with (shell.folder / "moved.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    outcome = launch_test("moved.csv")
    assert outcome.returncode == 1
    assert ", least at " in outcome.stdout + outcome.stderr
