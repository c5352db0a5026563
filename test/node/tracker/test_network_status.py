"""The status tells how often the network of the cue `siamese` ran, and how long it took."""

import importlib.util
import os
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


def test_a_network_that_cannot_be_read_is_refused_and_the_node_goes_on(
    graph, client, images, box, model
):
    """A pipe would keep the node for good."""
    (model / "correlation.onnx").unlink()
    os.mkfifo(model / "correlation.onnx")
    graph.tracker(client, target_box=list(box), particles=20, image_reliability="reliable")
    client.show_all(images[:2])
    refused = client.set_parameters(preset="learned", siamese__model=str(model))
    assert not refused.successful
    assert "correlation.onnx is a FIFO; accepted are regular files" in refused.reason
    assert client.show(images[2], client.at(2)).values["state"] == "tracking"


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
