"""A Siamese network finds its template again, and a wrong file is refused with a sentence."""

import copy
import os
import pickle
import shutil
from importlib.util import find_spec

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.described import open_network
from pf_tracker_ros.networks.description import SHIPPED, read_model
from pf_tracker_ros.networks.engines import engine_name, load_network
from pf_tracker_ros.networks.siamese import SiameseNetwork
from pf_tracker_ros.parameters import ParameterError

BOX = np.array([120.0, 100.0, 40.0, 40.0])
ENGINES = [
    "opencv",
    pytest.param(
        "onnxruntime",
        marks=pytest.mark.skipif(not find_spec("onnxruntime"), reason="no ONNX Runtime"),
    ),
]


def found(network, first, second, box=BOX):
    """What the network finds around a box in the second image, the likeliest first."""
    template = network.learn(Frame(first), box)
    return network.find(Frame(second), template, box).likeliest(3)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shapes", [True, False])
def test_the_likeliest_box_is_that_of_the_moved_target(
    write_model, correlation_bytes, picture, engine, shapes
):
    """Cells are 10 px apart here: a crop of 160 px in 16 cells."""
    network = SiameseNetwork(str(write_model(correlation_bytes(shapes=shapes))), engine)
    candidates = found(network, picture((120, 100)), picture((140, 90)))
    assert candidates.boxes[0] == pytest.approx([140, 90, 40, 40])
    assert candidates.log_odds[0] > 0 > candidates.log_odds[1]


@pytest.mark.parametrize(
    "to_image",
    [
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY),
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 40 + 7000,
    ],
)
def test_gray_and_thermal_images_work(model, picture, to_image):
    network = SiameseNetwork(str(model), "opencv")
    candidates = found(network, to_image(picture((120, 100))), to_image(picture((140, 90))))
    assert candidates.boxes[0] == pytest.approx([140, 90, 40, 40])


def test_boxes_are_corrected_by_most_of_the_first_difference(
    write_model, correlation_bytes, picture
):
    """A network whose boxes are 30 px where the given one has 40 px."""
    network = SiameseNetwork(str(write_model(correlation_bytes(half=6.0))), "opencv")
    candidates = found(network, picture((120, 100)), picture((140, 90)))
    side = 30.0 * (40.0 / 30.0) ** 0.75
    assert candidates.boxes[0] == pytest.approx([160 - side / 2, 110 - side / 2, side, side])


def test_crops_reach_beyond_the_image(model, picture):
    corner = np.array([-10.0, -10.0, 40.0, 40.0])
    image = np.full((240, 320, 3), 128, np.uint8)
    image[:30, :30] = picture((0, 0))[10:40, 10:40]
    candidates = found(SiameseNetwork(str(model), "opencv"), image, image, corner)
    assert candidates.boxes[0] == pytest.approx(corner)


def test_the_same_input_has_the_same_bits_and_the_network_is_loaded_once(model, picture):
    path = model / "correlation.onnx"
    assert load_network(path, "opencv") is load_network(path, "opencv")
    one, other = (
        found(SiameseNetwork(str(model), "opencv"), picture((120, 100)), picture((140, 90)))
        for _ in range(2)
    )
    assert np.array_equal(one.boxes, other.boxes)
    assert np.array_equal(one.log_odds, other.log_odds)


def test_copies_and_pickles_are_of_the_same_files(model, correlation_bytes, picture):
    network = SiameseNetwork(str(model), "opencv")
    images = picture((120, 100)), picture((140, 90))
    for again in (copy.deepcopy(network), pickle.loads(pickle.dumps(network))):
        assert np.array_equal(found(again, *images).log_odds, found(network, *images).log_odds)
    pickled = pickle.dumps(network)
    (model / "correlation.onnx").write_bytes(correlation_bytes(half=7.0))
    with pytest.raises(ParameterError, match="are not those of the copied tracker"):
        pickle.loads(pickled)


def without_file(folder):
    (folder / "correlation.onnx").unlink()


def with_text(folder):
    (folder / "correlation.onnx").write_text("version https://git-lfs.github.com/spec/v1")


def cut_short(folder):
    path = folder / "correlation.onnx"
    path.write_bytes(path.read_bytes()[:-100])


def edited(old, new):
    def edit(folder):
        path = folder / "model.yaml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return edit


WRONG = [
    (
        without_file,
        "cannot be used: network .*correlation.onnx cannot be read .*comes from the tests",
    ),
    (with_text, "correlation.onnx cannot be read as a network in the ONNX format by opencv"),
    (cut_short, "correlation.onnx cannot be read as a network in the ONNX format by opencv"),
    (lambda folder: (folder / "model.yaml").unlink(), "description of a network .*`model add`"),
    (
        lambda folder: (folder / "model.yaml").write_text(""),
        "model.yaml: the file has to hold names",
    ),
    (edited("name: a", "name: [a"), "model.yaml cannot be read as YAML"),
    (edited("name: a correlation", "naming: a correlation"), "model.yaml: no parameter 'naming'"),
    (edited("stride: 4.0", "stride: 0.0"), "'head.stride' is 0.0; allowed: float, 1 to 256"),
    (edited("  file: correlation.onnx\n", ""), "'head.file' and 'embedding.file' are empty"),
    (edited("head:", "heads:"), "no parameter 'heads.file'; did you mean 'head.file'"),
    (edited("head:", "head: none\nheads:"), "head"),
    (
        edited("  file:", "  sha256: abc\n  file:"),
        "is not the file .* SHA-256 is [0-9a-f]{64}, not",
    ),
    (edited("  file:", "  score: odds\n  file:"), "cannot run correlation.onnx as its description"),
    (edited("  file:", "  score: boxes\n  file:"), r"boxes .* shape \(1, 4, 16, 16\)"),
    (edited("stride: 4.0", "stride: 200.0"), "span 3000 px, more than its search crop of 64 px"),
    (edited("pixels: 16", "pixels: 24"), "cannot run correlation.onnx as its description"),
]


@pytest.mark.parametrize(("spoil", "message"), WRONG)
def test_a_wrong_model_is_refused_in_a_sentence(model, spoil, message):
    spoil(model)
    with pytest.raises(ParameterError, match=message) as error:
        SiameseNetwork(str(model), "opencv")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("half", [np.nan, np.inf, 1e30, -8.0])
def test_a_network_without_a_plausible_box_is_refused(write_model, correlation_bytes, half):
    with pytest.raises(ParameterError, match="finds no box in any cell"):
        SiameseNetwork(str(write_model(correlation_bytes(half=half))), "opencv")


def test_a_network_in_use_is_not_read_again(model):
    network = open_network(SiameseNetwork, str(model), "opencv")
    shutil.rmtree(model)
    assert open_network(SiameseNetwork, str(model), "opencv") is network
    assert copy.deepcopy(network) is network
    del network
    with pytest.raises(ParameterError, match=r"model\.yaml"):
        open_network(SiameseNetwork, str(model), "opencv")


def test_an_engine_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("pf_tracker_ros.networks.engines.find_spec", lambda name: None)
    assert engine_name("auto") == "opencv"
    with pytest.raises(ParameterError, match="pip install onnxruntime"):
        engine_name("onnxruntime")


def test_every_shipped_description_is_whole():
    names = [path.stem for path in SHIPPED.glob("*.yaml")]
    assert {"fear_xs", "fear_xs_without_embedding", "nanotrack", "vittrack"} == set(names)
    for name in names:
        description, folder = read_model(os.fspath(SHIPPED / f"{name}.yaml"))
        assert all([description.name, description.license, description.source])
        assert description.head.file
        assert folder == SHIPPED


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("fear_xs", {"fear_init": "fear_init", "fear_tracker": "fear_tracker"}),
        (
            "fear_xs_without_embedding",
            {"fear_noembs_init": "fear_noembs_init", "fear_noembs": "fear_noembs"},
        ),
        ("vittrack", {"object_tracking_vittrack_2023sep": "vittrack"}),
    ],
)
def test_published_networks_find_a_target(copy_files, picture, name, files):
    """A network that is trained on objects puts its box on the only thing in the image."""
    folder = copy_files(**files)
    (folder / "model.yaml").write_text((SHIPPED / f"{name}.yaml").read_text())
    network = SiameseNetwork(str(folder), "opencv")
    candidates = found(network, picture((120, 100)), picture((135, 90)))
    assert candidates.boxes[0] == pytest.approx([135, 90, 40, 40], abs=6.0)
    assert candidates.probabilities[0] > 0.5
