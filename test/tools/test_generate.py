import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from generate import generated_files, main

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

REPOSITORY = Path(__file__).resolve().parents[2]


def flat(values, prefix=""):
    for name, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


@pytest.mark.parametrize("name", generated_files())
def test_the_file_in_the_repository_is_up_to_date(name):
    command = "make generate"
    assert (REPOSITORY / name).read_text() == generated_files()[name], f"run {command}"


def parameters_of(text):
    return dict(flat(yaml.safe_load(text)["/**"]["ros__parameters"]))


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_file_names_every_parameter_that_counts_with_its_value_and_type(preset):
    text = generated_files()[f"config/{preset}.yaml"]
    # One line is one parameter: taking its mark away is all there is to do.
    values = parameters_of(re.sub(r"^( +)#(?! )", r"\1", text, flags=re.MULTILINE))
    of_preset = preset_parameters(preset)
    of_tracker = declarations(TrackerParameters)
    known = declarations(NodeParameters)
    known |= {name: one for name, one in of_tracker.items() if one.is_active(of_preset)}
    expected = {name: value for name, value in of_preset.items() if name in known}
    expected |= {"preset": preset, "seed": 0, "target_box": ()}
    assert list(values) == list(known)
    # YAML has lists where a declaration has tuples.
    read = {name: tuple(one) if isinstance(one, list) else one for name, one in values.items()}
    assert expected.items() <= read.items()
    for name, value in read.items():
        assert type(known[name].validate(value)) is type(value)
    # It sets the preset and nothing else, and says what can be chosen.
    assert parameters_of(text) == {"preset": preset}
    words = " ".join(text.replace("#", "").split())
    for name in ("motion.model", "proposal.method", "cues"):
        assert f"Allowed: {of_tracker[name].type_name}, {of_tracker[name].allowed}" in words


def rows_of_the_tracker():
    """Name to (column to cell), in order."""
    section = generated_files()["docs/parameters.md"].split("\n## ")[2]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    titles, _, *rows = ([cell.strip() for cell in line[1:-1].split(" | ")] for line in lines)
    return {row[0].strip("`"): dict(zip(titles, row, strict=True)) for row in rows}


def test_the_table_has_a_row_for_every_parameter():
    known = declarations(TrackerParameters)
    rows = rows_of_the_tracker()
    assert rows.keys() == known.keys()
    for name, declaration in known.items():
        assert rows[name]["description"] == declaration.description
        allowed = rows[name]["allowed"]
        if declaration.choices:
            assert re.findall(r"`(.*?)`", allowed) == list(declaration.choices)
        else:
            assert allowed.startswith(declaration.type_name)
            assert declaration.type is bool or declaration.allowed in allowed
        assert allowed.endswith(declaration.unit)


def test_parameters_that_relearn_or_are_fixed_are_named():
    text = generated_files()["docs/parameters.md"]
    relearning = [name for name, one in declarations(TrackerParameters).items() if one.read_only]
    named = re.search(r"A change of (.*?) makes the tracker learn", text)[1]
    assert re.findall(r"`(.*?)`", named) == relearning
    fixed = [name for name, one in declarations(NodeParameters).items() if one.read_only]
    assert re.findall(r"`(.*?)`", re.search(r"Fixed once the node runs: (.*)", text)[1]) == fixed


@pytest.mark.parametrize("preset", PRESETS)
def test_the_table_has_the_values_of_a_preset(preset):
    known = declarations(TrackerParameters)
    found = {}
    for name, row in rows_of_the_tracker().items():
        others = dict(re.findall(r"(\w+) `([^`]*)`", row["other presets"]))
        text = others.get(preset, row["default"].strip("`"))
        assert row["default"].strip("`") not in others.values()
        found[name] = known[name].validate(yaml.safe_load(text))
    assert found == preset_parameters(preset)


def test_the_files_are_written_into_a_repository_and_nowhere_else(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path)])
    assert "is not the repository" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    (tmp_path / "pf_tracker_ros").mkdir()
    main([str(tmp_path)])
    for name, text in generated_files().items():
        assert (tmp_path / name).read_text() == text
    # It needs no ROS.
    code = "import sys, generate as g; g.generated_files(); sys.exit('rclpy' in sys.modules)"
    tools = REPOSITORY / "tools"
    assert subprocess.run([sys.executable, "-c", code], cwd=tools, check=False).returncode == 0
