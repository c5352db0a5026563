"""An embedding network tells targets apart, as an appearance."""

import copy
import pickle

import cv2
import numpy as np
import pytest
from embedding_networks import EMBEDDING, mean_colors

from pf_tracker_ros import Detections, MultiTracker
from pf_tracker_ros.appearances.embedding import Embedding, EmbeddingParameters
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.embedding import EmbeddingNetwork
from pf_tracker_ros.parameters import ParameterError

INTERVAL = 0.1
BLUE, RED, WHITE = (255, 0, 0), (0, 0, 255), (255, 255, 255)


def person(image, x, shirt, trousers):
    """Draws a person of 20 x 40 px."""
    image[60:80, x : x + 20] = shirt
    image[80:100, x : x + 20] = trousers


@pytest.fixture
def crowd():
    """A frame of three people before gray, and their boxes."""
    image = np.full((160, 200, 3), 90, np.uint8)
    for x, clothes in ((20, (BLUE, WHITE)), (80, (WHITE, BLUE)), (140, (BLUE, WHITE))):
        person(image, x, *clothes)
    return Frame(image), np.array([[x, 60.0, 20.0, 40.0] for x in (20, 80, 140)])


def appearance(folder):
    return Embedding(EmbeddingParameters(model=str(folder)))


def test_a_vector_has_the_mean_colors_of_each_part(write_embedding, crowd):
    vectors = EmbeddingNetwork(str(write_embedding()), "opencv").embed(*crowd)
    # Red, green and blue of the upper half, then of the lower one; 4 values of 1.
    blue_over_white = np.array([0, 0, 1, 1, 1, 1]) / 2
    expected = np.array([blue_over_white, np.roll(blue_over_white, 3), blue_over_white])
    assert vectors == pytest.approx(expected, abs=1e-6)


def test_distances_are_scaled_cosines(write_embedding, crowd):
    one = appearance(write_embedding(description=EMBEDDING + "  distance_scale: 0.4\n"))
    descriptors = one.extract(*crowd)
    # The cosine of the first two is 1/2: both have blue in both parts.
    assert one.distance(descriptors[0], descriptors) == pytest.approx([0.0, 0.2, 0.0], abs=1e-6)


def test_a_blend_is_a_mean_of_length_one(write_embedding, crowd):
    one = appearance(write_embedding())
    first, second, _ = one.extract(*crowd)
    assert one.blend(first, second, 0.0) == pytest.approx(first)
    assert one.blend(first, second, 1.0) == pytest.approx(second)
    middle = one.blend(first, second, 0.5)
    assert np.linalg.norm(middle) == pytest.approx(1.0)
    assert middle @ first == pytest.approx(middle @ second)


def test_gray_and_thermal_images_and_boxes_at_the_border_have_vectors(write_embedding, crowd):
    gray = cv2.cvtColor(crowd[0].image, cv2.COLOR_BGR2GRAY)
    boxes = np.array([[-9.0, -9.0, 20.0, 40.0], [199.0, 159.0, 0.5, 0.5], [0.0, 0.0, 200.0, 160.0]])
    one = appearance(write_embedding())
    for image in (gray, gray.astype(np.uint16) * 40 + 7000):
        vectors = one.extract(Frame(image), boxes)
        assert vectors.shape == (3, 6)
        assert np.linalg.norm(vectors, axis=1) == pytest.approx(1.0)
    assert len(one.extract(crowd[0], np.empty((0, 4)))) == 0


def test_copies_and_pickles_are_of_the_same_files(write_embedding, crowd):
    folder = write_embedding()
    one = appearance(folder)
    expected = one.extract(*crowd)
    for again in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert np.array_equal(again.extract(*crowd), expected)
    pickled = pickle.dumps(one)
    (folder / "colors.onnx").write_bytes(mean_colors(bias=0.1))
    with pytest.raises(ParameterError, match="are not those of the copied tracker"):
        pickle.loads(pickled)


def test_targets_keep_their_ids_by_it_after_both_were_out_of_sight(write_embedding):
    """They come back in exchanged places, where positions alone would exchange the ids."""
    pytest.importorskip("scipy")
    parameters = {
        "max_targets": 4,
        "appearance.kind": "embedding",
        "appearance.embedding.model": str(write_embedding()),
    }
    tracker = MultiTracker.from_preset("default", seed=0, parameters=parameters)

    def step(places):
        image = np.random.default_rng(3).integers(80, 100, (160, 200, 3)).astype(np.uint8)
        for x, clothes in places:
            person(image, x, *clothes)
        boxes = [[x, 60.0, 20.0, 40.0] for x, _ in places]
        detections = Detections(np.array(boxes).reshape(-1, 4))
        targets = tracker.update(image, INTERVAL, detections)
        return {round(target.estimate.box[0], -1): target.id for target in targets}

    one, other = (BLUE, BLUE), (RED, RED)
    for _ in range(10):
        before = step([(60, one), (100, other)])
    # Within `track.reidentify_within`; both tracks have ended.
    assert not [step([]) for _ in range(80)][-1]
    for _ in range(5):
        after = step([(60, other), (100, one)])
    assert set(before) == set(after) == {60, 100}
    assert (after[100], after[60]) == (before[60], before[100])


def test_an_output_that_is_neither_vector_nor_map_is_refused(write_embedding):
    folder = write_embedding(description=EMBEDDING.replace("rows: 2", "rows: 5"))
    with pytest.raises(ParameterError, match=r"shape \(1, 3, 4, 2\); allowed: .* at least 5 x 1"):
        appearance(folder)


@pytest.mark.parametrize("bias", [np.nan, np.inf])
def test_a_network_without_a_finite_vector_is_refused(write_embedding, bias):
    with pytest.raises(ParameterError, match="gives no finite vector but 0"):
        appearance(write_embedding(mean_colors(bias)))


def test_a_tracker_without_a_model_for_it_is_refused():
    kind = {"appearance.kind": "embedding"}
    with pytest.raises(ParameterError, match=r"'appearance\.embedding\.model' is empty"):
        MultiTracker.from_preset("default", parameters=kind)
    with pytest.raises(ParameterError, match=r"'appearance\.embedding\.model' is empty"):
        MultiTracker.from_preset("default").set_parameters(kind)
