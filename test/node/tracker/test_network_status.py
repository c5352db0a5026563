"""The status tells how often the network of the cue `siamese` ran, and how long it took."""

import importlib.util
from pathlib import Path

import pytest

NETWORKS = Path(__file__).resolve().parents[2] / "networks" / "conftest.py"


@pytest.fixture
def model(tmp_path):
    """Folder of a small network."""
    spec = importlib.util.spec_from_file_location("small_networks", NETWORKS)
    small = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(small)
    (tmp_path / "correlation.onnx").write_bytes(small.correlation())
    (tmp_path / "model.yaml").write_text(small.DESCRIPTION, encoding="utf-8")
    return tmp_path


def test_a_frame_has_the_runs_of_its_network_and_their_time(graph, client, images, box, model):
    graph.tracker(
        client,
        target_box=list(box),
        preset="learned",
        siamese__model=str(model),
        particles=20,
        image_reliability="reliable",
    )
    first, *others = (status.values for status in client.show_all(images[:4]))
    assert (first["network_runs"], first["network_time_ms"]) == ("0", "0.0")
    for values in others:
        assert values["network_runs"] == "1"
        assert 0.0 < float(values["network_time_ms"]) <= float(values["processing_time_ms"])
    client.set_parameters(preset="default")
    assert "network_runs" not in client.show(images[4], client.at(4)).values
