"""The command `model` checks a network."""

import subprocess
import sys

import pytest

from pf_tracker_ros.networks.__main__ import main


def test_check_describes_a_network(model, capsys):
    assert main(["check", str(model), "--engine", "opencv"]) == 0
    output = capsys.readouterr().out
    for expected in ("mean colors in", "CC0-1.0", "vector:  6 values", "with opencv", "It runs"):
        assert expected in output


def test_check_says_what_is_wrong(model, capsys):
    (model / "colors.onnx").unlink()
    assert main(["check", str(model)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("model: error: the network mean colors cannot be used: ")


@pytest.mark.parametrize("arguments", [[], ["check"]])
def test_wrong_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage") is False


def test_the_command_refuses_a_folder_that_is_not_there():
    command = [sys.executable, "-m", "pf_tracker_ros.networks", "check", "nowhere"]
    run = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert run.stderr.startswith("model: error: ")
