"""The command `model` writes and checks descriptions."""

import subprocess
import sys

import pytest

from pf_tracker_ros.networks.__main__ import main


def test_check_describes_a_network(model, capsys):
    assert main(["check", str(model), "--engine", "opencv"]) == 0
    output = capsys.readouterr().out
    for expected in ("a correlation in", "CC0-1.0", "cells:   256", "with opencv", "It runs"):
        assert expected in output


def test_check_says_what_is_wrong(model, capsys):
    (model / "correlation.onnx").unlink()
    assert main(["check", str(model)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("model: error: the network a correlation cannot be used: ")


def test_check_refuses_boxes_far_from_the_crop(write_model, correlation_bytes, description, capsys):
    """On a black image, which the loading sees, they are right."""
    text = description.replace("mean: [128.0, 128.0, 128.0]", "mean: [0.0, 0.0, 0.0]")
    folder = write_model(correlation_bytes(weight=1e30), text)
    assert main(["check", str(folder), "--engine", "opencv"]) == 1
    assert "256 of 256 cells have no finite score and box near" in capsys.readouterr().err


def test_add_writes_a_description_with_hashes(copy_files, capsys):
    folder = copy_files(object_tracking_vittrack_2023sep="vittrack")
    assert main(["add", "vittrack", str(folder)]) == 0
    assert "Apache-2.0" in capsys.readouterr().out
    assert "sha256: " in (folder / "model.yaml").read_text()
    assert main(["check", str(folder)]) == 0
    assert main(["add", "vittrack", str(folder)]) == 1
    assert "model.yaml exists; `model check` tells" in capsys.readouterr().err


def test_add_names_a_missing_file_and_where_it_comes_from(tmp_path, capsys):
    assert main(["add", "vittrack", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "object_tracking_vittrack_2023sep.onnx is missing" in error
    assert "https://github.com/opencv/opencv_zoo" in error


@pytest.mark.parametrize("arguments", [[], ["add", "unknown", "."], ["check"]])
def test_wrong_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage") is False


def test_the_command_runs_without_ros_as_the_others_do():
    command = [sys.executable, "-m", "pf_tracker_ros.networks", "check", "nowhere"]
    run = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert run.stderr.startswith("model: error: ")
