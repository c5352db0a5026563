"""The preset `learned` on small networks: it follows and repeats itself, or is refused."""

import copy
import math
import pickle
import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Detections, MultiTracker, Tracker
from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.cues.cue import PredictedTarget
from pf_tracker_ros.cues.siamese import Siamese, SiameseParameters
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.topics import FrameResult
from pf_tracker_ros.tracking.presets import preset_parameters

TIMEOUT = 60.0
INTERVAL = 0.04
BOX = np.array([120.0, 100.0, 40.0, 40.0])


def learned(model, seed=0, kind=Tracker, **parameters):
    values = {"siamese.model": str(model), **parameters}
    return kind.from_preset("learned", seed=seed, parameters=values)


@pytest.fixture
def walk(picture):
    """Images of a target that moves to the right."""
    return [picture((120 + 3 * frame, 100)) for frame in range(12)]


def followed(tracker, images, box=BOX):
    tracker.start(images[0], tuple(box))
    return [tracker.update(image, INTERVAL) for image in images[1:]]


@pytest.fixture
def make_region(model, picture):
    """The cue, its template, and a region that it has seen or not, of a target at (130, 100)."""

    def make(doubt=1.0, **parameters):
        cue = Siamese(SiameseParameters(model=str(model), **parameters))
        template = cue.learn(Region(Frame(picture((120, 100))), BOX[None]), BOX)
        region = Region(Frame(picture((130, 100))), BOX[None], center_box=BOX)
        cue.precompute([PredictedTarget(region, template, doubt)])
        return cue, template, region

    return make


def test_the_response_is_highest_at_the_candidate_and_falls_as_a_gaussian(make_region):
    cue, template, region = make_region()
    there = np.array([130.0, 100.0, 40.0, 40.0])
    beside = there + [0.0, 18.5, 0.0, 0.0]
    larger = np.array([126.0, 96.0, 48.0, 48.0])
    close = there + [4.0, -4.0, 0.0, 3.0]
    boxes = np.array([there, beside, larger, close])
    at, off, wide, as_close = cue.response(region, boxes, template)
    assert at > 0.95
    assert as_close == at
    # The tolerance of 6 px falls to 4.5 px at 40 px, and to 3 px at 48 px. 14 px are one standard
    # deviation of .35 sides; both sides are larger by ln 1.2.
    assert off / at == pytest.approx(np.exp(-0.5), abs=1e-6)
    assert wide / at == pytest.approx(np.exp(-(((np.log(1.2) - 3 / 48) / 0.6) ** 2)), abs=1e-6)
    assert cue.log_likelihood(region, there[None], template) == pytest.approx(-400 * (1 - at))


def test_a_grid_is_read_like_its_boxes(make_region):
    cue, template, region = make_region()
    grid = BoxGrid(np.array([110.0, 130.0]), np.array([90.0, 100.0, 110.0]), BOX[2:])
    expected = cue.response(region, grid.boxes, template)
    assert cue.response_on_grid(region, grid, template) == pytest.approx(expected)


def test_candidates_are_proposed_and_only_their_absence_lowers_the_confidence(make_region):
    cue, template, region = make_region()
    proposed = cue.propose(region, template)
    assert proposed.boxes[0] == pytest.approx([130, 100, 40, 40])
    at, away = (
        cue.log_odds(cue.observe(region, box), template)["score"]
        for box in (proposed.boxes[0], proposed.boxes[0] + [69, 69, 0, 0])
    )
    assert at == 0.0
    assert away == -2.5


def test_another_window_of_the_frame_is_judged_by_the_same_candidates(make_region):
    cue, template, region = make_region()
    box = cue.propose(region, template).boxes[0]
    window = Region(region.frame, box[None], center_box=box)
    odds = [
        cue.log_odds(cue.observe(window, box + [offset, offset, 0, 0]), template)
        for offset in (0.0, 69.0, 120.0)
    ]
    # The last box is beyond what the network saw.
    assert odds == [{"score": 0.0}, {"score": -2.5}, {}]
    assert cue.propose(window, template) is None
    assert not cue.responds(window, template)


def test_a_candidate_is_recognized(make_region):
    cue, template, region = make_region()
    box = cue.propose(region, template).boxes[0]
    assert cue.recognition(cue.observe(region, box), template) > 0.9
    assert cue.recognition(cue.observe(region, box + [120, 0, 0, 0]), template) < 0.01


def test_what_is_recognized_is_more_certain_and_the_doubt_remains(model, walk):
    """The estimate hears the network; the doubt, which runs it, is that of the other cues."""
    tracker = learned(model)
    estimate = followed(tracker, walk)[-1]
    (track,) = tracker._manager._track_set.tracks
    own = track.filter_state.confidence
    gain = math.log(estimate.confidence / (1 - estimate.confidence)) - math.log(own / (1 - own))
    assert gain == pytest.approx(1.6, abs=0.2)


def test_only_in_doubt_it_is_silent_otherwise(make_region):
    cue, template, region = make_region(doubt=0.0, when="doubtful")
    assert not cue.responds(region, template)
    assert not cue.response(region, BOX[None], template).any()
    assert cue.propose(region, template) is None
    assert cue.log_odds(cue.observe(region, BOX), template) == {}
    cue, template, region = make_region(doubt=0.2, when="doubtful")
    assert cue.responds(region, template)


@pytest.mark.parametrize("when", ["always", "doubtful"])
@pytest.mark.parametrize(
    "convert",
    [
        lambda image: image,
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 40 + 7000,
    ],
)
def test_the_target_is_followed_and_every_run_has_the_same_bits(model, walk, when, convert):
    images = [convert(image) for image in walk]
    one, other = (followed(learned(model, **{"siamese.when": when}), images) for _ in range(2))
    assert one == other
    assert one[-1].box == pytest.approx([153, 100, 40, 40], abs=6.0)
    assert one[-1].state == "tracking"
    assert "siamese" in one[-1].cue_weights


def test_parameters_can_change_and_targets_start_after_the_folder_is_gone(model, walk):
    tracker = learned(model, kind=MultiTracker)
    shutil.rmtree(model)
    tracker.set_parameters({"particles": 60})
    assert tracker.start(walk[0], tuple(BOX)) == 1
    assert [target.id for target in tracker.update(walk[1], INTERVAL)] == [1]


def fused(cue):
    """The cue beside another one."""
    other = CUES["foreground"](CUES.parameters_of("foreground")())
    return CueFusion({"siamese": (cue, 1.0), "other": (other, 0.5)})


def test_its_weight_is_the_doubt_where_it_is_not_silent(make_region):
    cue, template, region = make_region()
    assert fused(cue).weights_in_doubt(region, {"siamese": template}, 0.4) == {"siamese": 0.4}


def test_a_silent_cue_has_no_weight(make_region):
    cue, template, region = make_region(doubt=0.0, when="doubtful")
    fusion = CueFusion(
        {
            "siamese": (cue, 1.0),
            "other": (CUES["foreground"](CUES.parameters_of("foreground")()), 0.5),
        }
    )
    assert fusion.weights_in_doubt(region, {"siamese": template}, 0.4) == {"siamese": 0.0}


def test_a_network_for_color_is_not_used_on_gray_images(write_model, description, walk):
    """To the last bit; on color images it is."""
    folder = write_model(description=f"{description}color_only: true\n")
    parameters = {"siamese.model": str(folder)}
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in walk]
    same_channels = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in gray]
    for images, is_used in ((gray, False), (same_channels, False), (walk, True)):
        own, plain = (
            [one.box for one in followed(tracker, images[:6])]
            for tracker in (
                Tracker.from_preset("learned", seed=0, parameters=parameters),
                Tracker.from_preset("default", seed=0),
            )
        )
        assert (own != plain) == is_used


def test_a_session_tells_how_often_its_network_ran(model, walk):
    values = preset_parameters("learned") | {"siamese.model": str(model)}
    session = Session(values, seed=0)
    session.request(tuple(BOX))
    runs = []
    for index, image in enumerate(walk[:4]):
        before = session.network_use
        session.process(Frame(image, index * 40_000_000))
        runs.append(session.network_use.since(before))
    assert [one.runs for one in runs] == [0, 1, 1, 1]
    assert runs[-1].seconds > 0.0
    result = FrameResult(targets=session.targets, network_use=runs[-1])
    assert result.values["network_runs"] == 1
    assert result.values["network_time_ms"] == pytest.approx(1e3 * runs[-1].seconds)
    assert Session(preset_parameters("default"), seed=0).network_use is None
    assert "network_runs" not in FrameResult(targets=session.targets).values


def test_without_a_usable_cell_the_cue_is_silent(model, picture, caplog):
    """As for a network that gives values that are not finite on some images only."""
    cue = Siamese(SiameseParameters(model=str(model)))
    template = cue.learn(Region(Frame(picture((120, 100))), BOX[None]), BOX)
    features = np.full_like(template.network.features, np.nan)
    spoiled = replace(template, network=replace(template.network, features=features))
    region = Region(Frame(picture((130, 100))), BOX[None], center_box=BOX)
    for _ in range(2):
        cue.precompute([PredictedTarget(region, spoiled, 1.0)])
    assert not cue.responds(region, spoiled)
    assert [one.message[:26] for one in caplog.records] == ["the network a correlation "]
    assert cue.log_odds(cue.observe(region, BOX), spoiled) == {}


def test_a_jump_is_found_where_the_other_cues_are_in_doubt(model, picture):
    """By more than a side, beyond what the motion model expects."""
    images = [picture((120, 100))] * 4 + [picture((165, 110))] * 3
    assert followed(learned(model), images)[-1].box == pytest.approx([165, 110, 40, 40], abs=4.0)


@pytest.mark.parametrize("when", ["always", "doubtful"])
def test_it_follows_a_target_alone(model, walk, when):
    tracker = learned(model, cues=("siamese",), **{"siamese.when": when})
    assert followed(tracker, walk)[-1].box == pytest.approx([153, 100, 40, 40], abs=6.0)


def test_copies_and_pickles_go_on_with_the_same_bits(model, walk):
    tracker = learned(model)
    followed(tracker, walk[:5])
    again = [copy.copy(tracker), copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))]
    expected = [tracker.update(image, INTERVAL) for image in walk[5:]]
    for one in again:
        assert [one.update(image, INTERVAL) for image in walk[5:]] == expected


def test_several_targets_are_followed_with_late_detections(model, picture):
    pytest.importorskip("scipy")
    tracker = learned(model, kind=MultiTracker, max_targets=3)
    places = [((60 + 3 * frame, 40), (220 - 3 * frame, 150)) for frame in range(10)]
    first = picture(*places[0])
    ids = [tracker.start(first, (*place, 40, 40)) for place in places[0]]
    for index, both in enumerate(places):
        late = None
        if index == 6:
            late = Detections([[*place, 40, 40] for place in places[4]], age=2 * INTERVAL)
        targets = tracker.update(picture(*both), INTERVAL, late)
    assert [target.id for target in targets] == ids
    for target, place in zip(targets, places[-1], strict=True):
        assert target.estimate.box == pytest.approx([*place, 40, 40], abs=4.0)


def test_a_preset_without_a_model_is_refused_and_the_tracker_goes_on(walk):
    with pytest.raises(ParameterError, match=r"'siamese\.model' is empty.*docs/learned\.md"):
        Tracker.from_preset("learned")
    tracker = Tracker.from_preset("default")
    tracker.start(walk[0], tuple(BOX))
    with pytest.raises(ParameterError, match=r"siamese\.model"):
        tracker.set_parameters({"cues": ("color_contrast", "correlation_response", "siamese")})
    assert tracker.update(walk[1], INTERVAL).state == "tracking"


def test_a_cue_that_is_switched_on_while_tracking_learns_the_target(model, walk):
    tracker = Tracker.from_preset("default", parameters={"siamese.model": str(model)})
    followed(tracker, walk[:5])
    tracker.set_parameters({"cues": ("color_contrast", "correlation_response", "siamese")})
    for image in walk[5:]:
        estimate = tracker.update(image, INTERVAL)
    assert "siamese" in estimate.cue_weights
    assert estimate.box == pytest.approx([153, 100, 40, 40], abs=3.0)


def test_other_presets_import_nothing_of_it():
    code = (
        "import sys; from pf_tracker_ros import Tracker; Tracker.from_preset('default')\n"
        "added = [one for one in sys.modules if one.partition('.')[0] != 'cv2']\n"
        "assert not [one for one in added if 'networks' in one or 'onnx' in one or 'yaml' in one]"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=TIMEOUT)
