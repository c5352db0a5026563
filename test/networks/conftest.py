"""Small embedding networks."""

import numpy as np
import pytest
from small_networks import field, integers, network, node, tensor, value

SIDE = 16
EMBEDDING = f"""\
name: mean colors
license: CC0-1.0
source: the tests
deviation: [255.0, 255.0, 255.0]
embedding:
  file: colors.onnx
  width: {SIDE}
  height: {2 * SIDE}
  rows: 2
"""


def mean_colors(bias=0.0, shapes=True):
    """The bytes of an embedding network: the channels of parts of 8 x 8 pixels, and a constant.

    Args:
        bias: Added to each mean.
        shapes: Whether the output has a shape.
    """
    weights = np.zeros((3, 3, 8, 8))
    weights[range(3), range(3)] = 1 / 64
    place = integers("kernel_shape", 8, 8), integers("strides", 8, 8)
    return network(
        [node("Conv", ["input", "weights", "bias"], "output", *place)],
        [tensor("weights", weights), tensor("bias", np.full(3, bias))],
        [value("input", (1, 3, 2 * SIDE, SIDE))],
        [value("output", (1, 3, SIDE // 4, SIDE // 8) if shapes else ())],
    )


def endless(iterations=10**12):
    """The bytes of an embedding network with a loop of so many iterations."""
    body = field(1, node("Identity", ["condition"], "go_on"))
    body += field(1, node("Identity", ["before"], "after")) + field(2, "body")
    for number, names in ((11, ("iteration", "condition", "before")), (12, ("go_on", "after"))):
        for name in names:
            # Without dimensions; the elements are whole numbers, truth values or floats.
            element = {"iteration": 7, "condition": 9, "go_on": 9}.get(name, 1)
            dimensions = b"" if element == 1 else field(2, b"")
            kind = field(1, element) + dimensions
            body += field(number, field(1, name) + field(2, field(1, kind)))
    loop = field(5, field(1, "body") + field(6, body) + field(20, 5))
    times = field(2, 7) + field(8, "times") + field(9, np.int64(iterations).tobytes())
    return network(
        [node("Loop", ["times", "", "input"], "output", loop)],
        [times],
        [value("input", (1, 3, 2 * SIDE, SIDE))],
        [value("output", (1, 3, 2 * SIDE, SIDE))],
    )


@pytest.fixture(scope="session")
def endless_bytes():
    """The function `endless`."""
    return endless


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


@pytest.fixture(scope="session")
def embedding_bytes():
    """The function `mean_colors`."""
    return mean_colors


@pytest.fixture(scope="session")
def embedding_description():
    """The description of the embedding network, as text."""
    return EMBEDDING


@pytest.fixture
def model(write_embedding):
    """Folder of the embedding network."""
    return write_embedding()
