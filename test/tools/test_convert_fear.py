"""The conversion of FEAR's files says what it needs; it runs only with packages of its own."""

from importlib.util import find_spec

import pytest
from convert_fear import main


@pytest.mark.skipif(bool(find_spec("coremltools")), reason="coremltools is installed")
def test_missing_packages_are_named(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path), str(tmp_path / "fear")])
    assert ended.value.code == 2
    assert "pip install coremltools onnx" in capsys.readouterr().err
