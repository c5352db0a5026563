"""The example `examples/siamese_cue`: installed by pip, it runs a network as a cue."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from small_networks import integers, network, node, tensor, value

ROOT = Path(__file__).resolve().parents[2]
FILES = ("fear_noembs_init.onnx", "fear_noembs.onnx")

CODE = """
import copy, pickle
import cv2
from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.frames import Frame, Region

def draw(x, y):
    noise = np.random.default_rng(0).normal(size=(40, 40, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    image = np.full((240, 320, 3), 128, np.uint8)
    image[y:y + 40, x:x + 40] = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)
    return image

box = np.array([120.0, 100.0, 40.0, 40.0])
cue = CUES["siamese"](CUES.parameters_of("siamese")(folder=folder))
template = cue.learn(Region(Frame(draw(120, 100)), box[None]), box)
region = Region(Frame(draw(145, 75)), box[None], center_box=box)
boxes = box + np.array([[25, -25, 0, 0], [25, -11, 0, 0], [0, 0, 0, 0], [200, 0, 0, 0]])
likelihoods = cue.log_likelihood(region, boxes, template).tolist()

parameters = {"siamese.folder": folder,
              "cues": ("color_contrast", "correlation_response", "siamese")}
tracker = Tracker.from_preset("default", seed=0, parameters=parameters)
images = [draw(120 + 3 * number, 100) for number in range(10)]
tracker.start(images[0], tuple(box))
for image in images[1:6]:
    tracker.update(image, 0.04)
copies = [tracker, copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))]
found = [[one.update(image, 0.04) for image in images[6:]] for one in copies]
gray = Tracker.from_preset("li2007", parameters={"siamese.folder": folder, "cues": ("siamese",)})
gray.start(images[0][:, :, 0], tuple(box))
print(json.dumps({
    "likelihoods": likelihoods,
    "box": found[0][-1].box,
    "weights": dict(found[0][-1].cue_weights),
    "same": found[0] == found[1] == found[2],
    "alone": gray.update(images[1][:, :, 0], 0.04).box,
    "refused": refusal(
        Tracker.from_preset, "default", parameters=parameters | {"siamese.folder": "nowhere"}
    ),
}))
"""


def mean(name, source, channels, stride):
    """The node and the constant of a mean over parts of so many pixels."""
    weights = np.zeros((channels, channels, stride, stride))
    weights[range(channels), range(channels)] = 1 / stride**2
    place = integers("kernel_shape", stride, stride), integers("strides", stride, stride)
    constant = tensor(f"{name}.weights", weights)
    return node("Conv", [source, f"{name}.weights"], name, *place), constant


def correlation(folder):
    """Write a correlation of two reduced crops as the files of FEAR-XS."""
    gray, gain = tensor("gray", [-128.0]), tensor("gain", [2e-5])
    shift = node("Add", ["image_in", "gray"], "shifted")
    reduce, weights = mean("input.125", "shifted", 3, 8)
    (folder / FILES[0]).write_bytes(
        network(
            [shift, reduce],
            [gray, weights],
            [value("image_in", (1, 3, 128, 128))],
            [value("input.125", (1, 3, 16, 16))],
        )
    )
    reduce, weights = mean("reduced", "shifted", 3, 4)
    place = (
        integers("kernel_shape", 16, 16),
        integers("pads", 8, 8, 7, 7),
        integers("strides", 4, 4),
    )
    # Boxes of the target's size in the search crop, which is five times as large.
    half, none = tensor("half", np.full(4, 25.6)), tensor("none", np.zeros((4, 3, 16, 16)))
    (folder / FILES[1]).write_bytes(
        network(
            [
                shift,
                reduce,
                node("Conv", ["reduced", "template_features"], "sums", *place),
                node("Mul", ["sums", "gain"], "cls"),
                node("Conv", ["reduced", "none", "half"], "bbox", *place),
            ],
            [gray, gain, weights, half, none],
            [
                value("image_in", (1, 3, 256, 256)),
                value("template_features", (1, 3, 16, 16)),
            ],
            [value("cls", (1, 1, 16, 16)), value("bbox", (1, 4, 16, 16))],
        )
    )
    return folder


@pytest.fixture(scope="module")
def example(installed, tmp_path_factory):
    """The folder in which the example is installed."""
    package = tmp_path_factory.mktemp("example") / "siamese_cue"
    # Building writes into the folder.
    shutil.copytree(ROOT / "examples" / "siamese_cue", package)
    return installed(package)


@pytest.fixture
def real_files():
    """The folder of FEAR's files, which are not part of the repository."""
    folder = Path(os.environ.get("PF_TRACKER_MODELS") or ROOT.parent / "shared" / "models")
    if not all((folder / name).is_file() for name in FILES):
        pytest.skip(f"no FEAR-XS in {folder}; PF_TRACKER_MODELS names its folder")
    return folder


@pytest.fixture
def tracked(run, example):
    """What the code prints with the files of a folder, which a cue and a tracker use."""
    return lambda folder: run(f"folder = {str(folder)!r}\n{CODE}", example)[0]


def check(found):
    at, beside, before, far = found["likelihoods"]
    assert 0.0 >= at > beside > before >= far >= -100.0
    assert found["box"] == pytest.approx([147, 100, 40, 40], abs=6.0)
    assert found["alone"] == pytest.approx([123, 100, 40, 40], abs=10.0)
    assert found["weights"]["siamese"] > 0.0
    assert found["same"]
    assert found["refused"].startswith("network nowhere/fear_noembs_init.onnx cannot be read")


def test_a_small_network_weighs_boxes_and_a_tracker_follows(tracked, tmp_path):
    found = tracked(correlation(tmp_path))
    check(found)
    at, beside, *_ = found["likelihoods"]
    # 14 px are one standard deviation of .35 box sides.
    assert (100.0 + beside) / (100.0 + at) == pytest.approx(np.exp(-0.5), abs=0.02)


def test_the_real_network_does_the_same(tracked, real_files):
    check(tracked(real_files))
