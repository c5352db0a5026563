"""The tables of README and docs are those of `docs/figures.json`; what a run writes there."""

import json

import figures
import pytest

TABLE = {
    "title": "Presets and peers, 1 seed",
    "headings": ["tracker", "AUC", "CPU"],
    "rows": [["**default**", "**0.7**", "**0.2**"], ["CSRT", "0.6", "1.0"]],
    "names": 1,
}
KNOWN = {"peers": {"tables": [TABLE]}}


def test_the_documents_have_the_tables_that_were_measured():
    differing = [path.name for path, old, new in figures.documents(figures.read_figures()["parts"])
                 if old != new]  # fmt: skip
    assert differing == [], "run python benchmarks/figures.py write"


def test_a_table_is_written_between_its_comments_and_nothing_else():
    begin = "<!-- figures peers: Presets | columns: tracker, CPU | rows: CSRT -->"
    made = figures.generated(f"a\n{begin}\nold\n{figures.END}\nb\n", KNOWN)
    table = ["| tracker | CPU |", "| --- | ---: |", "| CSRT | 1.0 |"]
    assert made.splitlines() == ["a", begin, *table, figures.END, "b"]
    assert figures.generated(made, KNOWN) == made


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("node: Any", "no table 'node: Any' has been measured"),
        ("peers: Others", "no table 'peers: Others' has been measured"),
        ("peers: Presets | rows: KCF", "'rows: KCF' .* there are: default, CSRT"),
        ("peers: Presets | columns: NEES", "there are: tracker, AUC, CPU"),
        ("peers: Presets | lines: KCF", "'lines: KCF'"),
    ],
)
def test_what_was_not_measured_is_an_error(name, message):
    with pytest.raises(figures.FiguresError, match=message):
        figures.table_of(KNOWN, name)


def test_a_part_is_measured_and_the_others_are_kept(tmp_path, monkeypatch, capsys):
    path = tmp_path / "figures.json"
    path.write_text(json.dumps({"parts": {"node": {"commit": "earlier"}}}))
    quick = [["growth_model.py", "--runs", "2"]]
    parts = {"quick": lambda footage, seeds: quick, "absent": lambda footage, seeds: []}
    monkeypatch.setattr(figures, "PARTS", parts)
    figures.main(["measure", str(tmp_path), "--seeds", "1", "--output", str(path)])
    found = json.loads(path.read_text())
    assert found["parts"].keys() == {"node", "quick"}
    part = found["parts"]["quick"]
    assert part["commands"] == ["growth_model.py --runs 2"]
    assert [len(table["rows"]) for table in part["tables"]] == [2]
    assert found["machine"]["versions"].keys() >= {"python", "numpy"}
    # A benchmark that fails is named.
    monkeypatch.setattr(
        figures, "PARTS", {"bad": lambda footage, seeds: [["growth_model.py", "-x"]]}
    )
    with pytest.raises(SystemExit):
        figures.main(["measure", str(tmp_path), "--output", str(path)])
    assert "bad: growth_model.py has ended with code 2" in capsys.readouterr().err


@pytest.fixture
def footage(tmp_path):
    """Two sequences, three of the MOT challenge, of which one has no frames, and depth."""
    for name in ("sequences/tir_horse", "sequences/video", "world/office"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("street", "square", "hall"):
        (tmp_path / "mot" / name).mkdir(parents=True)
        (tmp_path / "mot" / name / "seqinfo.ini").touch()
    (tmp_path / "mot" / "street" / "img1").mkdir()
    for name in ("sequences/video/square.avi", "sequences/video/other.avi"):
        (tmp_path / name).touch()
    (tmp_path / "world" / "office" / "0_depth.png").touch()
    return tmp_path


def test_footage_makes_the_commands(footage, capsys):
    made = {part: commands(footage, 2) for part, commands in figures.PARTS.items()}
    assert made["peers"] == [["peers.py", str(footage / "sequences"), "--seeds", "1"]]
    thermal = str(footage / "sequences" / "tir_horse")
    assert made["infrared"] == [["infrared.py", thermal, "--seeds", "2"]]
    assert [command[-2:] for command in made["targets"]] == [["--seed", "0"], ["--seed", "1"]]
    assert made["positions"] == [["world.py", "--cost", "--depth", str(footage / "world/office")]]
    for commands in made.values():
        for script, *_ in commands:
            assert (figures.ROOT / "benchmarks" / script).is_file()


def test_frames_are_images_or_the_video_of_the_same_name(footage, capsys):
    (command,) = figures.PARTS["targets"](footage, 1)
    mot = footage / "mot"
    square = ["--sequence", str(mot / "square"), str(footage / "sequences/video/square.avi")]
    street = ["--sequence", str(mot / "street"), str(mot / "street" / "img1")]
    assert command == ["targets.py", *square, *street, "--seed", "0"]
    assert f"hall is left out: neither {mot}/hall/img1 nor " in capsys.readouterr().err


def test_what_is_left_out_is_said_before_the_first_part(tmp_path, monkeypatch, capsys):
    path = tmp_path / "results" / "figures.json"
    told = []

    def measure(part, commands, pictures):
        told.append((part, capsys.readouterr().err))
        return []

    parts = {"quick": lambda footage, seeds: [["x.py"]], "absent": lambda footage, seeds: []}
    monkeypatch.setattr(figures, "PARTS", parts)
    monkeypatch.setattr(figures, "measure", measure)
    figures.main(["measure", str(tmp_path), "--output", str(path)])
    assert told == [("quick", f"absent is left out: its footage is not in {tmp_path}\n")]
    assert json.loads(path.read_text())["parts"].keys() == {"quick"}
