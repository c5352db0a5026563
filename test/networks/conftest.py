"""Folders of a small embedding network."""

import pytest
from embedding_networks import EMBEDDING, mean_colors


@pytest.fixture
def write_embedding(tmp_path):
    """Writes an embedding network and its description into a new folder; returns the folder."""

    def write(content=None, description=EMBEDDING):
        folder = tmp_path / "embedding"
        folder.mkdir()
        (folder / "colors.onnx").write_bytes(mean_colors() if content is None else content)
        (folder / "model.yaml").write_text(description, encoding="utf-8")
        return folder

    return write


@pytest.fixture
def model(write_embedding):
    """Folder of the embedding network."""
    return write_embedding()
