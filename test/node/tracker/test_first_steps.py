"""The script of the first steps that does without the command `ros2`, on a real tracker."""

import re
import sys
from pathlib import Path

import numpy as np
from nodes import ids

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "first_steps.md"


def test_the_script_draws_a_target_and_sets_a_parameter(graph, client, tmp_path):
    (script,) = re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    path = tmp_path / "script.py"
    path.write_text(script)
    graph.tracker(client, particles=20)
    process = graph.command(sys.executable, str(path))
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    assert output.count("successful=True") == 1
    assert output.count("success=True") == 1
    assert client.get_parameters("preset") == ["li2007"]
    image = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)
    status = client.show(image, client.at(0))
    assert ids(status) == [1]
    box = [float(status.values[f"box_{name}"]) for name in ("x", "y", "width", "height")]
    assert box == [230.0, 180.0, 42.0, 142.0]
