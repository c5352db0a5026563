"""The ablation: which variants follow from a preset, its figures by hand, what it writes."""

import csv
import shutil

import numpy as np
import pytest

from pf_tracker_ros.evaluation import EvaluationError, SequenceResult


@pytest.fixture
def ablation(benchmark):
    return benchmark("ablation")


@pytest.mark.parametrize(
    ("preset", "cues"),
    [
        ("li2007", ["color_histogram", "gradient_orientation"]),
        ("default", ["color_contrast", "correlation_response"]),
        ("zhang_bo", ["foreground_color_histogram", "gradient_orientation", "foreground"]),
        ("zhang2015", []),
    ],
)
def test_each_active_cue_is_switched_off_unless_it_is_the_only_one(ablation, preset, cues):
    variants = ablation.cue_variants(preset)
    assert [variant.name for variant in variants] == [f"without {cue}" for cue in cues]
    assert [variant.parameters for variant in variants] == [{f"{cue}.weight": 0.0} for cue in cues]


def test_a_cue_in_use_is_chosen_and_has_a_power_above_0(ablation, monkeypatch):
    values = {"smell.weight": 0.5, "noise.weight": 0.0, "taste.weight": 1.0, "sound.weight": 0.5}
    values["cues"] = ("smell", "noise", "sound")
    monkeypatch.setattr(ablation, "preset_parameters", lambda preset: values)
    variants = ablation.cue_variants("any")
    assert [variant.parameters for variant in variants] == [
        {"smell.weight": 0.0},
        {"sound.weight": 0.0},
    ]


def test_further_variants_and_numbers_of_particles_follow_the_cues(ablation):
    off = ["template.update_above=1", " motion.position_noise=1  template.similarity_above=0.1"]
    variants = ablation.variants("zhang2015", (30, 100, 30), off)
    # zhang2015 has 100 particles and a single cue.
    assert [(variant.name, dict(variant.parameters)) for variant in variants] == [
        ("zhang2015", {}),
        ("template.update_above=1", {"template.update_above": 1.0}),
        (
            "motion.position_noise=1 template.similarity_above=0.1",
            {"motion.position_noise": 1.0, "template.similarity_above": 0.1},
        ),
        ("N = 30", {"particles": 30}),
    ]


def test_a_variant_may_select_other_parts_and_set_their_parameters(ablation):
    off = "cues=hog,color_histogram hog.keep=0.5"
    variant = ablation.variants("li2007", (), [off])[-1]
    assert variant.parameters == {"cues": ("hog", "color_histogram"), "hog.keep": 0.5}
    assert variant.name == off


def result(name, true_frames):
    """Of two seeds and 11 frames; each seed is right in so many frames and far off in the rest."""
    true_boxes = np.tile([0.0, 0.0, 10.0, 10.0], (11, 1))
    boxes = np.tile(true_boxes, (2, 1, 1))
    for seed, count in enumerate(true_frames):
        boxes[seed, count:, 0] = 100.0
    return SequenceResult(
        name, (0, 1), true_boxes, boxes, np.zeros((2, 11), bool), np.full((2, 10), 0.002)
    )


def test_figures_by_hand(ablation):
    """In a frame that is right 20 of 21 thresholds are passed, so AUC = 20/21 * share."""
    base = ablation.Outcome("base", [result("a", (11, 11)), result("b", (11, 11))])
    worse = ablation.Outcome("worse", [result("a", (11, 10)), result("b", (7, 8))])
    (first,), (second,) = ablation.summary([base, worse], "").groups
    unit = 20 / 21 / 11
    assert first == ["base", f"{11 * unit:.3f}", "", "0.000", "0.000", "1.000", "2.00"]
    # Changes of -0.5 and -3.5 frames. Both sequences' seeds differ by one frame, the other way.
    assert second == [
        "worse",
        f"{9 * unit:.3f}",
        f"**{-2 * unit:+.3f} [{-3.5 * unit:+.3f}, {-0.5 * unit:+.3f}]**",
        f"{unit / np.sqrt(2):.3f}",
        "0.000",
        f"{9 / 11:.3f}",
        "2.00",
    ]


def test_the_command_writes_tables_that_do_not_hang_on_the_number_of_processes(
    ablation, moving_square_sequence, tmp_path, capsys
):
    rows = []
    for jobs in ("1", "2"):
        output = tmp_path / "new" / jobs
        arguments = [str(moving_square_sequence), "--preset", "li2007", "--seeds", "2"]
        arguments += ["--particles", "30", "--off", "template.update_above=1", "--jobs", jobs]
        assert ablation.main([*arguments, "--output", str(output)]) == 0
        with (output / "ablation.csv").open() as file:
            rows.append(list(csv.DictReader(file)))
        table = (output / "ablation.md").read_text()
        assert ("times are not comparable" in table) == (jobs == "2")
    names = [
        "li2007",
        "without color_histogram",
        "without gradient_orientation",
        "template.update_above=1",
        "N = 30",
    ]
    assert [row["variant"] for row in rows[0]] == names
    assert {(row["sequence"], row["frames"], row["seeds"]) for row in rows[0]} == {
        ("moving_square", "20", "2")
    }
    assert rows[0][0]["cpu_ratio_to_li2007"] == "1.0000"
    shown = capsys.readouterr().out
    for name in names:
        assert f"| {name} |" in table
        assert name in shown
    for one, other in zip(*rows, strict=True):
        for column in ("success_auc", "success_auc_std", "precision_20px"):
            assert one[column] == other[column]


def test_what_is_chosen_without_a_group_by_hand(benchmark, ablation):
    """In frames that are right of 11: unit 20/21/11."""
    cross_validation = benchmark("cross_validation")
    frames = {"base": (8, 8, 5), "one": (11, 11, 1), "two": (2, 2, 9)}
    outcomes = [
        ablation.Outcome(
            name,
            [result(at, (n, n)) for at, n in zip(("a_1", "a_2", "b_1"), counts, strict=True)],
        )
        for name, counts in frames.items()
    ]
    groups = cross_validation.grouped(["a_1", "a_2", "b_1"], ["a_|z", "b"])
    table = cross_validation.summary(outcomes, groups)
    rows, (last,) = table.groups
    unit = 20 / 21 / 11
    scores = {n: f"{n * unit:.3f}" for n in (1, 2, 5, 8, 9, 11)}
    assert rows == [
        ["a_|z", "2", "two", scores[2], scores[8], scores[11], "one"],
        ["b", "1", "one", scores[1], scores[5], scores[9], "two"],
    ]
    means = [f"{n * unit / 3:.3f}" for n in (2 + 2 + 1, 8 + 8 + 5, 11 + 11 + 9)]
    assert last == ["**all**", "3", "", *means, ""]
    # A bar within a cell is none between two cells.
    assert table.markdown()[2].startswith(r"| a_\|z | 2 | two |")


def test_the_command_cross_validates(ablation, moving_square_sequence, tmp_path, capsys):
    folders = [shutil.copytree(moving_square_sequence, tmp_path / name) for name in ("one", "two")]
    for folder in folders:
        # Without it a sequence is named as its folder is.
        (folder / "meta.json").unlink(missing_ok=True)
    arguments = [*map(str, folders), "--preset", "li2007", "--seeds", "1", "--particles", "30"]
    arguments += ["--group", "one", "--group", "two", "--output", str(tmp_path / "results")]
    assert ablation.main(arguments) == 0
    table = (tmp_path / "results" / "ablation.md").read_text()
    assert "## Leave one group out" in table
    assert "| left out |" in table
    assert "Leave one group out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("patterns", "message"),
    [
        (["a", "["], r"--group '\[': unterminated"),
        (["a", "b", "c"], "--group 'c' matches no sequence"),
        (["a", "a_1"], "sequence a_1 is in 2 groups; allowed: one"),
        (["a_1", "b"], "sequence a_2 is in 0 groups"),
        ([".*"], "one --group; allowed: at least two"),
    ],
)
def test_groups_that_do_not_part_the_sequences_are_refused(benchmark, patterns, message):
    with pytest.raises(EvaluationError, match=message):
        benchmark("cross_validation").grouped(["a_1", "a_2", "b_1"], patterns)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--preset", "nobody"], "no preset 'nobody'; there are: default"),
        (["--off", "nothing"], "--off 'nothing'; allowed: NAME=VALUE"),
        (["--off", " "], "--off ' '; allowed: NAME=VALUE"),
        (["--off", "color_histogram.keep=7"], "parameter 'color_histogram.keep' is 7.0"),
        (["--off", "absent=1"], "absent=1: no parameter 'absent'"),
        (["--off", "particles=9 particles=8"], "--off particles is given more than once"),
        (["--off", "particles=9", "--off", "particles=9"], "is given more than once"),
        (
            ["--preset", "li2007", "--off", "particles=60"],
            "is the value of preset li2007; allowed:",
        ),
        (["--particles", "30,x"], "'x'; allowed: a whole number of at least 1"),
        (["--jobs", "0"], "'0'; allowed: a whole number of at least 1"),
        ([], "no sequence in"),
    ],
)
def test_wrong_arguments_are_refused_with_what_is_allowed(
    ablation, arguments, message, capsys, tmp_path
):
    with pytest.raises(SystemExit) as ended:
        ablation.main([str(tmp_path), *arguments, "--output", str(tmp_path / "results")])
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
