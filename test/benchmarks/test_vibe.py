"""The benchmark of the background model: what it counts, and what it writes."""

import numpy as np
import pytest


@pytest.fixture
def vibe(benchmark):
    return benchmark("vibe")


def test_only_pixels_in_the_box_are_counted(vibe):
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 10:30] = 255
    assert vibe.count_inside(mask, np.array([5.0, 15.0, 10.0, 10.0])) == (5 * 5, 10 * 10)
    # What is outside the mask is no pixel.
    assert vibe.count_inside(mask, np.array([-10.0, -10.0, 30.0, 25.0])) == (5 * 10, 20 * 15)


@pytest.mark.parametrize("options", [[], ["--gray", "--reduction", "4"]])
def test_a_square_that_has_moved_is_found(vibe, options, moving_square_sequence, tmp_path):
    output = tmp_path / "new" / "vibe.md"
    arguments = [str(moving_square_sequence), "--skip", "8", "--output", str(output), *options]
    assert vibe.main(arguments) == 0
    heading, _, row = (
        [cell.strip() for cell in line.strip("| ").split("|")]
        for line in output.read_text().splitlines()
    )
    assert heading == list(vibe.HEADINGS)
    figures = dict(zip(heading, row, strict=True))
    assert (figures["sequence"], figures["image"]) == ("moving_square", "160x120")
    assert figures["detected %"] == "100.0"
    assert float(figures["recall %"]) > 40.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--skip", "20"], "--skip is 20; allowed for"),
        (["--reduction", "17"], "argument --reduction: invalid choice"),
    ],
)
def test_wrong_arguments_are_refused(vibe, options, message, moving_square_sequence, capsys):
    with pytest.raises(SystemExit):
        vibe.main([str(moving_square_sequence), *options])
    assert message in " ".join(capsys.readouterr().err.split())
