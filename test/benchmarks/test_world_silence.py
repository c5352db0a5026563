"""The benchmark of poses told of somebody else: which frames count, by hand, and a whole run."""

import json

import numpy as np
import pytest


@pytest.fixture
def silence(benchmark):
    return benchmark("world_silence")


TARGET = np.array([100.0, 100.0, 20.0, 60.0])
PEOPLE = np.array([TARGET, TARGET + [30, 0, 0, 0]])


@pytest.mark.parametrize(
    ("right", "true_box", "wrong"),
    [
        (0.0, TARGET, False),
        # Twelve pixels to the right, it overlaps the target by 8 and the other one by 2 of them.
        (12.0, TARGET, False),
        (25.0, TARGET, True),
        # In the open it is on nobody.
        (80.0, TARGET, False),
        (30.0, np.full(4, np.nan), True),
    ],
)
def test_a_box_is_wrong_where_it_overlaps_another_person_more(silence, right, true_box, wrong):
    assert silence.is_wrong(TARGET + [right, 0, 0, 0], true_box, PEOPLE) is wrong
    assert not silence.is_wrong(TARGET, TARGET, PEOPLE[:0])


CALIBRATION = """<Camera><Geometry width="160" height="120" dpx="0.01" dpy="0.01"/>
<Intrinsic focal="1.5" kappa1="0" cx="80" cy="60" sx="1"/>
<Extrinsic tx="0" ty="3000" tz="8000" rx="1.5707963" ry="0" rz="0"/></Camera>"""


def test_the_command_writes_its_table(silence, moving_square_sequence, moving_square, tmp_path):
    (tmp_path / "view.xml").write_text(CALIBRATION)
    (moving_square_sequence / "meta.json").write_text(json.dumps({"first_frame": 3}))
    rows = [
        [4 + index, 1, *box, 1, 0.1 * index, 5] for index, box in enumerate(moving_square.boxes)
    ]
    np.savetxt(tmp_path / "gt.txt", rows, delimiter=",")
    options = [f"--people={tmp_path / 'gt.txt'}", f"--calibration={tmp_path / 'view.xml'}"]
    assert (
        silence.main([str(moving_square_sequence), *options, "--seeds=1", f"--output={tmp_path}"])
        == 0
    )
    row, _ = [
        line
        for line in (tmp_path / "world_silence.md").read_text().splitlines()
        if "moving_square" in line
    ]
    _, name, _, tracking, wrong, _, posed, *_ = (cell.strip() for cell in row.split("|"))
    assert (name, wrong) == ("moving_square", "0")
    assert int(tracking) >= int(posed) > 10


def test_a_missing_file_is_reported(silence, tmp_path, capsys):
    with pytest.raises(SystemExit):
        silence.main([str(tmp_path), "--people=none.txt", "--calibration=none.xml"])
    assert "none" in capsys.readouterr().err
