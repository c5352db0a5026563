"""A model that does not fit its description is refused with a sentence; engines agree."""

import copy
import shutil
from importlib.util import find_spec

import numpy as np
import pytest
from common import run_python
from embedding_networks import mean_colors

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.embedding import EmbeddingNetwork, open_network
from pf_tracker_ros.networks.engines import engine_name, load_network
from pf_tracker_ros.parameters import ParameterError

FILE = "colors.onnx"
ENGINES = [
    "opencv",
    pytest.param(
        "onnxruntime",
        marks=pytest.mark.skipif(not find_spec("onnxruntime"), reason="no ONNX Runtime"),
    ),
]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shapes", [True, False])
def test_every_engine_runs_with_and_without_shapes(write_embedding, engine, shapes):
    network = EmbeddingNetwork(str(write_embedding(mean_colors(shapes=shapes))), engine)
    image = np.zeros((40, 60, 3), np.uint8)
    image[:, :, 2] = 200
    (vector,) = network.embed(Frame(image), np.array([[10.0, 5.0, 20.0, 30.0]]))
    assert vector == pytest.approx(np.array([1, 0, 0, 1, 0, 0]) / np.sqrt(2), abs=1e-6)


def test_the_network_is_loaded_once(model):
    assert load_network(model / FILE, "opencv") is load_network(model / FILE, "opencv")


def cut_short(folder):
    path = folder / FILE
    path.write_bytes(path.read_bytes()[:-30])


def edited(old, new):
    def edit(folder):
        path = folder / "model.yaml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return edit


WRONG = [
    (lambda folder: (folder / FILE).unlink(), "colors.onnx cannot be read .*comes from the tests"),
    (cut_short, "colors.onnx cannot be read as a network in the ONNX format by opencv"),
    (lambda folder: (folder / "model.yaml").unlink(), "description of a network .*identities"),
    (lambda folder: (folder / "model.yaml").write_text(""), "model.yaml: the file has to hold "),
    (edited("name: mean", "name: [mean"), "model.yaml cannot be read as YAML"),
    (edited("name: mean", "naming: mean"), "model.yaml: no parameter 'naming'"),
    (edited("width: 16", "width: 0"), "'embedding.width' is 0; allowed: int, 8 to 4096"),
    (edited("  file: colors.onnx\n", ""), "'embedding.file' is empty"),
    (edited("embedding:", "embeddings:"), "no parameter 'embeddings.file'; did you mean 'embe"),
    (edited("  file:", "  sha256: abc\n  file:"), "SHA-256 is [0-9a-f]{64}, not"),
    (edited("  file:", "  output: odds\n  file:"), "cannot run colors.onnx as its description"),
]


@pytest.mark.parametrize(("spoil", "message"), WRONG)
def test_a_wrong_model_is_refused_in_a_sentence(model, spoil, message):
    spoil(model)
    with pytest.raises(ParameterError, match=message) as error:
        EmbeddingNetwork(str(model), "opencv")
    assert "\n" not in str(error.value)


def test_a_network_in_use_is_not_read_again(model):
    network = open_network(str(model), "opencv")
    shutil.rmtree(model)
    assert open_network(str(model), "opencv") is network
    assert copy.deepcopy(network) is network
    del network
    with pytest.raises(ParameterError, match=r"model\.yaml"):
        open_network(str(model), "opencv")


def test_an_engine_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("pf_tracker_ros.networks.engines.find_spec", lambda name: None)
    assert engine_name("auto") == "opencv"
    with pytest.raises(ParameterError, match="pip install onnxruntime"):
        engine_name("onnxruntime")


def test_a_tracker_without_a_network_imports_nothing_of_it():
    code = (
        "import sys; from pf_tracker_ros import Tracker; Tracker.from_preset('default')\n"
        "added = [one for one in sys.modules if one.partition('.')[0] != 'cv2']\n"
        "assert not [one for one in added if 'networks' in one or 'onnx' in one or 'yaml' in one]"
    )
    run_python(code, check=True)
