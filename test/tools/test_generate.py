import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from generate import generated_files, main

from pf_tracker_ros.node.tracker.node_parameters import NodeParameters
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
def test_a_preset_file_sets_the_preset_and_nothing_else(preset):
    assert parameters_of(generated_files()[f"config/{preset}.yaml"]) == {"preset": preset}


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_file_names_every_parameter_with_the_value_and_type_of_the_preset(preset):
    text = generated_files()[f"config/{preset}.yaml"]
    # One line is one parameter: taking its mark away is all there is to do.
    values = parameters_of(re.sub(r"^( +)#(?! )", r"\1", text, flags=re.MULTILINE))
    expected = preset_parameters(preset) | {"preset": preset, "seed": 0, "target_box": []}
    assert expected.items() <= values.items()
    known = declarations(NodeParameters) | declarations(TrackerParameters)
    assert list(values) == list(known)
    for name, value in values.items():
        assert type(known[name].validate(value)) is type(value) or name == "target_box"


def test_the_table_has_a_row_for_every_parameter():
    table = generated_files()["docs/parameters.md"]
    for name, declaration in declarations(TrackerParameters).items():
        (row,) = [line for line in table.splitlines() if line.startswith(f"| `{name}` |")]
        cells = [cell.strip() for cell in row.strip("|").split(" | ")]
        assert declaration.description in row
        assert len(cells) == 6 + len(PRESETS)
        assert declaration.allowed in cells


def test_the_files_are_written_into_a_repository_and_nowhere_else(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path)])
    assert "is not the repository" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    (tmp_path / "pf_tracker_ros").mkdir()
    main([str(tmp_path)])
    for name, text in generated_files().items():
        assert (tmp_path / name).read_text() == text


def test_writing_them_needs_no_ros():
    code = (
        "import sys, generate as g; g.generated_files(); "
        "sys.exit(any(name == 'rclpy' for name in sys.modules))"
    )
    outcome = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY / "tools", check=False)
    assert outcome.returncode == 0
