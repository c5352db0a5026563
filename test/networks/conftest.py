"""Small networks in the ONNX format, written without the package onnx.

The network is a correlation: the template's crop is the kernel of a convolution over the search
crop. Bytes are in the format of Protocol Buffers, with the field numbers of onnx.proto.
"""

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

CELLS = 16
STRIDE = 4
TEMPLATE, SEARCH = 16, CELLS * STRIDE
GAIN = 0.25

DESCRIPTION = f"""\
name: a correlation
license: CC0-1.0
source: the tests
mean: [128.0, 128.0, 128.0]
deviation: [128.0, 128.0, 128.0]
template:
  crop: {{pixels: {TEMPLATE}, shape: box, scale: 1.0}}
search:
  crop: {{pixels: {SEARCH}, shape: box, scale: 4.0}}
head:
  file: correlation.onnx
  stride: {STRIDE}.0
"""


def _number(value):
    encoded = bytearray()
    while value > 127:
        encoded.append(value & 127 | 128)
        value >>= 7
    return bytes([*encoded, value])


def _field(number, value):
    if isinstance(value, int):
        return _number(number << 3) + _number(value)
    value = value.encode() if isinstance(value, str) else value
    return _number(number << 3 | 2) + _number(len(value)) + value


def _tensor(name, values):
    values = np.asarray(values, np.float32)
    dimensions = b"".join(_field(1, length) for length in values.shape)
    return dimensions + _field(2, 1) + _field(8, name) + _field(9, values.tobytes())


def _value(name, shape):
    dimensions = b"".join(_field(1, _field(1, length)) for length in shape)
    tensor = _field(1, 1) + (_field(2, dimensions) if shape else b"")
    return _field(1, name) + _field(2, _field(1, tensor))


def _integers(name, *values):
    numbers = b"".join(_field(8, value) for value in values)
    return _field(5, _field(1, name) + numbers + _field(20, 7))


def _node(kind, inputs, output, *attributes):
    names = b"".join(_field(1, name) for name in inputs)
    return names + _field(2, output) + _field(4, kind) + b"".join(attributes)


def _model(nodes, tensors, inputs, outputs):
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, "correlation")
    graph += b"".join(_field(5, tensor) for tensor in tensors)
    graph += b"".join(_field(11, value) for value in inputs)
    graph += b"".join(_field(12, value) for value in outputs)
    return _field(1, 7) + _field(7, graph) + _field(8, _field(2, 13))


def correlation(box_channels=4, shapes=True, half=TEMPLATE / 2, weight=0.0):
    """The bytes of the network: log odds, and boxes of one size.

    Args:
        box_channels: Channels of the boxes; 4 fits the description.
        shapes: Whether the outputs have shapes.
        half: Half of a box, pixels of the crop; 8 is the target's.
        weight: What each value of the search crop adds to it.
    """
    place = (
        _integers("kernel_shape", TEMPLATE, TEMPLATE),
        _integers("pads", 8, 8, 7, 7),
        _integers("strides", STRIDE, STRIDE),
    )
    weights = _tensor("weights", np.full((box_channels, 3, TEMPLATE, TEMPLATE), weight))
    cells = (CELLS, CELLS)
    return _model(
        [
            _node("Conv", ["search", "template"], "sums", *place),
            _node("Mul", ["sums", "gain"], "scaled"),
            _node("Add", ["scaled", "offset"], "score"),
            _node("Conv", ["search", "weights", "half"], "boxes", *place),
        ],
        [
            weights,
            _tensor("half", np.full(box_channels, half)),
            _tensor("gain", [GAIN]),
            _tensor("offset", [-4.0]),
        ],
        [
            _value("template", (1, 3, TEMPLATE, TEMPLATE)),
            _value("search", (1, 3, SEARCH, SEARCH)),
        ],
        [
            _value("score", (1, 1, *cells) if shapes else ()),
            _value("boxes", (1, box_channels, *cells) if shapes else ()),
        ],
    )


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


def mean_colors(bias=0.0):
    """The bytes of an embedding network: the channels of parts of 8 x 8 pixels, and a constant.

    Args:
        bias: Added to each mean.
    """
    weights = np.zeros((3, 3, 8, 8))
    weights[range(3), range(3)] = 1 / 64
    place = _integers("kernel_shape", 8, 8), _integers("strides", 8, 8)
    return _model(
        [_node("Conv", ["input", "weights", "bias"], "output", *place)],
        [_tensor("weights", weights), _tensor("bias", np.full(3, bias))],
        [_value("input", (1, 3, 2 * SIDE, SIDE))],
        [_value("output", (1, 3, SIDE // 4, SIDE // 8))],
    )


def endless(iterations=10**12):
    """The bytes of an embedding network with a loop of so many iterations."""
    body = _field(1, _node("Identity", ["condition"], "go_on"))
    body += _field(1, _node("Identity", ["before"], "after")) + _field(2, "body")
    for number, names in ((11, ("iteration", "condition", "before")), (12, ("go_on", "after"))):
        for name in names:
            # Without dimensions; the elements are whole numbers, truth values or floats.
            element = {"iteration": 7, "condition": 9, "go_on": 9}.get(name, 1)
            dimensions = b"" if element == 1 else _field(2, b"")
            tensor = _field(1, element) + dimensions
            body += _field(number, _field(1, name) + _field(2, _field(1, tensor)))
    loop = _field(5, _field(1, "body") + _field(6, body) + _field(20, 5))
    times = _field(2, 7) + _field(8, "times") + _field(9, np.int64(iterations).tobytes())
    return _model(
        [_node("Loop", ["times", "", "input"], "output", loop)],
        [times],
        [_value("input", (1, 3, 2 * SIDE, SIDE))],
        [_value("output", (1, 3, 2 * SIDE, SIDE))],
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
def write_model(tmp_path):
    """Writes a network and its description into a new folder, and returns the folder."""

    def write(content=None, description=DESCRIPTION, name="model"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "correlation.onnx").write_bytes(correlation() if content is None else content)
        (folder / "model.yaml").write_text(description, encoding="utf-8")
        return folder

    return write


@pytest.fixture
def model(write_model):
    """Folder of the small network."""
    return write_model()


@pytest.fixture(scope="session")
def correlation_bytes():
    """The function `correlation`."""
    return correlation


@pytest.fixture(scope="session")
def description():
    """The description of the small network, as text."""
    return DESCRIPTION


@pytest.fixture(scope="session")
def picture():
    """Draws 40 x 40 px targets, each with its own texture, before gray."""

    def texture(seed):
        noise = np.random.default_rng(seed).normal(size=(40, 40, 3))
        smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
        return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)

    def draw(*places, background=128):
        image = np.full((240, 320, 3), background, np.uint8)
        for seed, (x, y) in enumerate(places):
            image[y : y + 40, x : x + 40] = texture(seed)
        return image

    return draw


@pytest.fixture(scope="session")
def real_models():
    """The folder of published networks, which are not part of the repository."""
    given = os.environ.get("PF_TRACKER_MODELS")
    repository = Path(__file__).resolve().parents[2]
    folder = Path(given) if given else repository.parent / "shared" / "models"
    if not folder.is_dir():
        pytest.skip(f"no networks in {folder}; PF_TRACKER_MODELS names their folder")
    return folder


@pytest.fixture
def copy_files(tmp_path, real_models):
    """Copies files of published networks into a new folder, and returns it."""

    def copy(**names):
        folder = tmp_path / "published"
        folder.mkdir()
        for target, source in names.items():
            shutil.copyfile(real_models / f"{source}.onnx", folder / f"{target}.onnx")
        return folder

    return copy
