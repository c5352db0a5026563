"""`track` with the node's parameter file."""

import pytest
from common import read_boxes

BOX = ("--box", "20,30,24,24")
OWN = """\
/pf_tracker:
  ros__parameters:
    preset: "li2007"
    seed: 3
    click_size: 20.0
    particles: 20
    cues: ["color_histogram", "hog"]
    template: {update_above: 1.5e-1}
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(OWN)
    return path


@pytest.fixture
def tracked(track, moving_square_sequence, tmp_path):
    """The rows of boxes.csv with some arguments."""

    def run(*arguments):
        output = tmp_path / f"out{len(list(tmp_path.iterdir()))}"
        code, _, errors = track(moving_square_sequence, "--output", output, *arguments)
        assert (code, errors) == (0, "")
        return read_boxes(output)

    return run


def test_a_file_equals_typed_options(tracked, own):
    typed = tracked(
        *BOX,
        *("--preset", "li2007", "--seed", 3, "--parameter", "particles=20"),
        *("--parameter", "cues=color_histogram,hog", "--parameter", "template.update_above=0.15"),
    )
    assert tracked(*BOX, "--params-file", own) == typed
    assert tracked(*BOX, "--params-file", own, "--seed", 4) != typed
    # Typed options override the file.
    over = ("--parameter", "particles=30", "--parameter", "template.update_above=0.5")
    typed = ("--preset", "li2007", "--seed", 3, "--parameter", "cues=color_histogram,hog")
    assert tracked(*BOX, "--params-file", own, *over) == tracked(*BOX, *typed, *over)


def test_a_file_for_another_node_causes_a_warning(track, moving_square_sequence, own, tmp_path):
    other = tmp_path / "other.yaml"
    other.write_text(OWN.replace("/pf_tracker", "front_tracker"))
    found = []
    for path in (own, other):
        arguments = ("--output", tmp_path / path.stem, *BOX, "--params-file", path)
        code, _, errors = track(moving_square_sequence, *arguments)
        assert code == 0
        found.append((read_boxes(tmp_path / path.stem), errors))
    assert found[0] == (found[1][0], "")
    assert f"{other} is for the node /front_tracker, and is used for" in found[1][1]


def test_two_presets_are_refused(refusal, moving_square_sequence, own):
    error = refusal(moving_square_sequence, "--params-file", own, "--preset", "default")
    assert "--preset default and" in error
    assert "(preset li2007) both set the preset; remove one of them" in error


def test_a_file_with_max_targets_tracks_a_single_target_as_one_of_several(tracked, own):
    own.write_text(OWN.replace("preset:", "max_targets: 5\n    preset:"))
    found = tracked(*BOX, "--params-file", own)
    # The label is a column of several targets.
    assert found[0]["label"] == ""
    several = ("--preset", "li2007", "--seed", 3, "--parameter", "max_targets=5")
    cues = ("--parameter", "cues=color_histogram,hog", "--parameter", "particles=20")
    update = ("--parameter", "template.update_above=0.15")
    assert tracked(*BOX, *several, *cues, *update) == found
    assert tracked(*BOX, "--params-file", own, "--parameter", "max_targets=7") == found


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("particels: 5", "did you mean 'particles'"),
        ("particles:", "parameter 'particles' is 'None'"),
        ('detector: {labels: ["a, b"]}', "allowed here: strings without commas"),
        ("", "parameter 'particles' is 'none'"),
    ],
)
def test_an_invalid_value_is_reported_with_its_file_or_without_if_it_was_typed(
    refusal, moving_square_sequence, own, line, said
):
    typed = () if line else ("--parameter", "particles=none")
    if line:
        own.write_text(f"/**:\n  ros__parameters:\n    {line}\n")
    error = refusal(moving_square_sequence, "--params-file", own, *typed)
    assert said in error
    assert (f"{own}: " in error) == bool(line)
