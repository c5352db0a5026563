"""Parts of other packages: installed by pip, found by their entry points."""

import re
from pathlib import Path

import pytest

from pf_tracker_ros.cues import CUES

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text()


@pytest.fixture(scope="module")
def example(installed, tmp_path_factory):
    """The folder in which the example of docs/extending.md is installed."""
    package = tmp_path_factory.mktemp("example")
    (project,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (module,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (package / "pyproject.toml").write_text(project)
    (package / "bright_things.py").write_text(module)
    return installed(package)


def test_names_are_known_without_importing_a_part(run, parts):
    code = """
import pf_tracker_ros
from pf_tracker_ros import Tracker
early = [name for name in ("importlib.metadata", "parts_of_mine") if name in sys.modules]
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
names = [list(one) for one in (CUES, FEATURES, MOTION_MODELS, RESAMPLERS)]
print(json.dumps([early, [one for one in sys.modules if "parts_of_mine" in one], names]))
"""
    (early, imported, names), _ = run("import json, sys\n" + code, parts, prelude="")
    assert early == []
    assert imported == []
    assert names[0] == [*CUES, "beyond_reach", "brightness"]
    assert [own[-1] for own in names[1:]] == ["cell_means", "unlike_others", "mostly_stratified"]


def test_a_tracker_uses_them_and_their_parameters(run, parts):
    code = """
both = ("correlation_response", "brightness")
choices = [
    {"preset": "li2007", "cues": ("color_histogram", "brightness"), "brightness__weight": 0.9},
    {"preset": "li2007", "cues": ("color_histogram", "brightness"), "brightness__weight": 0.1},
    {"preset": "li2007", "motion__model": "random_walk", "motion__position_noise": 4.0},
    {"cues": both, "correlation_response__features": "cell_means"},
    {"cues": both, "correlation_response__features": "cell_means",
     "correlation_response__cell_means__edge_weight": 20.0},
    {"preset": "li2007", "resampling__scheme": "mostly_stratified"},
    {"preset": "li2007", "resampling__scheme": "mostly_stratified",
     "resampling__mostly_stratified__share": 0.0},
]
found = [follow(**choice) for choice in choices]
print(json.dumps([found, [least_overlap(one) for one in found]]))
"""
    (found, overlaps), _ = run(code, parts)
    assert min(overlaps) > 0.4
    assert found[0] != found[1]
    assert found[3] != found[4]
    assert found[5] != found[6]


def test_tracks_have_the_descriptors_of_the_chosen_appearance(run, parts):
    """A detector in every second frame; the appearance is changed at the end."""
    pytest.importorskip("scipy")
    code = """
from pf_tracker_ros import Detections

def ids(**parameters):
    tracker = MultiTracker.from_preset("default", parameters=parameters)
    found = []
    for number, image in enumerate(images):
        detections = Detections([boxes[number]]) if number % 2 == 0 else None
        found.append([target.id for target in tracker.update(image, 0.1, detections)])
    track, = tracker._manager._track_set.tracks
    return found[-1], track.descriptor.tolist(), tracker
last, color, tracker = ids(**{"appearance.kind": "mean_color", "appearance.mean_color.scale": 5.0})
tracker.set_parameters({"appearance.kind": "color_stripes"})
track, = tracker._manager._track_set.tracks
again = [target.id for target in tracker.update(images[-1], 0.1, Detections([boxes[-1]]))]
print(json.dumps([last, color, len(track.descriptor), again]))
"""
    (last, color, length, again), _ = run(code, parts)
    assert last == again == [1]
    # Cyan of (90, 230, 230) with a lighter middle.
    assert color == pytest.approx([0.5, 0.9, 0.88], abs=0.06)
    assert length == 3200


def test_an_unusable_part_is_logged_once_and_rejected_only_when_chosen(run, parts):
    code = """
Tracker.from_preset("default")
print(json.dumps([
    refusal(Tracker.from_preset, "default", parameters=chosen)
    for chosen in ({"cues": ("beyond_reach",)}, {"motion.model": "unlike_others",
                   "proposal.method": "transition", "cues": ("hog",)})
]))
"""
    reasons, log = run(code, parts)
    broken, unlike = reasons
    assert broken == (
        "the cue 'beyond_reach' of parts-of-mine (parts_of_mine.beyond_reach:BeyondReach) cannot "
        "be used: ModuleNotFoundError: No module named 'a_network_that_nobody_has'"
    )
    assert unlike == (
        "the motion model 'unlike_others' of parts-of-mine "
        "(parts_of_mine.unlike_others:UnlikeOthers) cannot be used: TypeError: its parameter "
        "'position_noise' is declared differently than that of 'affine'; declare it alike, or "
        "rename it"
    )
    taken = "the cue 'hog' of parts-of-mine (parts_of_mine.brightness:Brightness) cannot be used: "
    taken += "there is a cue of that name already"
    assert sorted(log.splitlines()) == sorted([broken, unlike, taken])


def test_a_name_that_two_packages_declare_is_unusable(run, parts, tmp_path):
    info = tmp_path / "another-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: another\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[pf_tracker_ros.cues]\nbrightness = json:loads\nnameless = json:loads\n"
    )
    code = """
print(json.dumps([
    refusal(Tracker.from_preset, "default", parameters={"cues": (name,)})
    for name in ("brightness", "nameless")
]))
"""
    (twice, nameless), _ = run(code, parts, tmp_path)
    assert twice == (
        "the cue 'brightness' of another (json:loads) and parts-of-mine "
        "(parts_of_mine.brightness:Brightness) cannot be used: ImportError: only one package may "
        "provide it; uninstall the others"
    )
    assert nameless == (
        "the cue 'nameless' of another (json:loads) cannot be used: ImportError: it is not "
        "registered by that name; decorate it by .register('nameless')"
    )


def test_the_example_of_the_page_detects_and_tracks(run, example):
    pytest.importorskip("scipy")
    code = """
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build
from pf_tracker_ros.targets.built_in_detectors import DETECTORS
name = "built_in_detectors.bright.above"
node = build(NodeParameters, {"built_in_detector": "bright", name: 100})
detector = DETECTORS.make("bright", node.detector_parameters["bright"])
blind = DETECTORS.make("bright", DETECTORS.parameters_of("bright")(above=255))
tracker = MultiTracker.from_preset("default")
found = [tracker.update(image, 0.1, detector.detect(image)) for image in images]
print(json.dumps([
    [(one.id, one.label) for one in found[-1]],
    least_overlap([one[0].estimate.box for one in found[5:]]),
    len(blind.detect(images[0])),
    declarations(NodeParameters)[name].unit,
]))
"""
    (found, least, blind_count, unit), _ = run(code, example)
    assert found == [[1, "bright"]]
    assert least > 0.6
    assert blind_count == 0
    assert unit == "gray levels"


def test_their_parameters_are_in_the_generated_documents(run, parts, example):
    pytest.importorskip("rclpy")
    code = """
sys.path.insert(0, "tools")
import generate
print(json.dumps(generate.generated_files()["docs/parameters.md"]))
"""
    text, _ = run(code.replace('"tools"', repr(str(ROOT / "tools"))), parts, example)
    for name in (
        *("brightness.sharpness", "motion.vertical_share", "resampling.mostly_stratified.share"),
        *("correlation_response.cell_means.edge_weight", "appearance.mean_color.scale"),
        "built_in_detectors.bright.above",
    ):
        assert f"| `{name}` |" in text


@pytest.mark.usefixtures("ros_domain")
def test_the_node_accepts_them_like_built_in_parts(run, parts, example):
    code = """
import rclpy
from rclpy.parameter import Parameter
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
rclpy.init()
given = {"max_targets": 4, "built_in_detector": "bright", "built_in_detectors.bright.above": 90,
         "motion.vertical_share": 0.5, "cues": ["color_contrast", "brightness"]}
overrides = [Parameter(name, value=value) for name, value in given.items()]
node = TrackerNode([], parameter_overrides=overrides)
values = {name: node.get_parameter(name).value for name in given}
refused = node.set_parameters([Parameter("cues", value=["beyond_reach"])])[0].reason
allowed = node.set_parameters([Parameter("brightness.sharpness", value=1.0)])[0].successful
print(json.dumps([node.lifecycle_state, values == given, refused, allowed]))
node.destroy_node()
rclpy.shutdown()
"""
    (state, are_taken, refused, allowed), _ = run(code, parts, example)
    assert state == "active"
    assert are_taken
    assert "'beyond_reach' of parts-of-mine" in refused
    assert allowed
