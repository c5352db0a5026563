"""The list of recordings, and the tour file."""

import json
from pathlib import Path

import pytest

from pf_tracker_ros.node.console.playlist import list_recordings, read_tour, recordings_to_json
from pf_tracker_ros.recordings import RecordingError

TOUR = Path(__file__).resolve().parents[3] / "demo" / "tour.yaml"


@pytest.fixture
def write(tmp_path):
    """A function that writes a tour and returns its path."""

    def write(text):
        path = tmp_path / "tour.yaml"
        path.write_text(text)
        return path

    return write


def titles(listed):
    return [one["title"] for one in recordings_to_json(listed)]


def test_recordings_are_listed_once_after_those_of_the_tour(write, tmp_path):
    tour = write("- recording: a.mcap\n  title: First\n- recording: sub/b.mcap\n")
    others = [str(tmp_path / "sub" / "b.mcap"), "c.mp4", "c.mp4"]
    listed = list_recordings(str(tmp_path / "a.mcap"), others, str(tour))
    assert [one.path for one in listed] == [
        tmp_path / "a.mcap",
        tmp_path / "sub" / "b.mcap",
        Path("c.mp4").resolve(),
    ]
    assert titles(listed) == ["First", "b.mcap", "c.mp4"]
    assert list_recordings("", [], "") == []


def test_recordings_of_one_name_are_told_apart_by_their_folders():
    listed = list_recordings("left/drive.mcap", ["right/drive.mcap", "c.mp4"], "")
    assert titles(listed) == ["left/drive.mcap", "right/drive.mcap", "c.mp4"]


def test_a_tour_has_texts_and_values_for_the_page(write):
    (entry,) = read_tour(
        write(
            """
- recording: a.mcap
  target: [1, 2, 3, 4]
  speed: 0.5
  parameters: {max_targets: 8}
  steps:
    - one   line
    - {text: another, parameters: {motion.model: affine, autostart: true, seed: 3}}
"""
        )
    )
    assert entry.speed == 0.5
    (shown,) = recordings_to_json([entry])
    assert json.loads(json.dumps(shown)) == {
        "title": "a.mcap",
        "target": [1.0, 2.0, 3.0, 4.0],
        "parameters": {"max_targets": 8},
        "steps": [
            {"text": "one line", "parameters": {}},
            {
                "text": "another",
                "parameters": {"motion.model": "affine", "autostart": True, "seed": 3},
            },
        ],
    }


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "the document is None; allowed: a list"),
        ("recording: a.mcap", "allowed: a list with an entry for each recording"),
        ("- a.mcap", "the content of entry 1 is 'a.mcap'; allowed: a mapping with recording"),
        ("- title: A", "'recording' of entry 1 is None; allowed: the path of a recording"),
        ("- {recording: a, step: x}", "a key of entry 1 is 'step'; allowed: recording, title"),
        ("- {recording: a, title: 1}", "'title' of entry 1 is 1"),
        ("- {recording: a, target: [1, 2, 3]}", "allowed: 4 numbers: x, y, width, height"),
        ("- {recording: a, target: [1, 2, 3, .nan]}", "allowed: 4 numbers: x, y, width, height"),
        ("- {recording: a, target: [1, 2, -3, 0]}", "width and height above 0"),
        ("- {recording: a, target: [1, 2, 3, 1" + 400 * "0" + "]}", "allowed: 4 numbers"),
        ("- {recording: a, parameters: {b: 1" + 400 * "0" + "}}", "'parameters' of entry 1 is"),
        ('- {recording: "a\\0b"}', "allowed: the path of a recording"),
        ("- {recording: a, speed: -1}", "'speed' of entry 1 is -1"),
        ("- {recording: a, steps: one}", "'steps' of entry 1 is 'one'; allowed: a list of texts"),
        ("- {recording: a, steps: ['']}", "the text of step 1 of entry 1 is ''"),
        ("- {recording: a, steps: [{txt: b}]}", "a key of step 1 of entry 1 is 'txt'"),
        ("- {recording: a, parameters: {b: {}}}", "'parameters' of entry 1 is {'b': {}}"),
        ("- {recording: a, parameters: {b: .inf}}", "'parameters' of entry 1 is {'b': inf}"),
        ("- [", "cannot be read as YAML"),
    ],
)
def test_an_invalid_tour_is_refused_with_what_is_allowed(write, text, error):
    path = write(text)
    with pytest.raises(RecordingError) as caught:
        read_tour(path)
    assert str(caught.value).startswith(str(path))
    assert error in str(caught.value)


def test_a_missing_tour_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"nowhere\.yaml"):
        list_recordings("", [], str(tmp_path / "nowhere.yaml"))


def test_the_tour_of_the_demo_sets_what_it_promises():
    """Every parameter that any clip sets is set by all, so that none depends on the one before."""
    from pf_tracker_ros.node_parameters import NodeParameters
    from pf_tracker_ros.parameters import declarations
    from pf_tracker_ros.tracking.presets import preset_parameters

    listed = read_tour(TOUR)
    assert [one.path.parent.name for one in listed] == ["hidden", "people"]
    of_node = declarations(NodeParameters)
    known = {*of_node, *preset_parameters("default"), *preset_parameters("li2007")}
    for one in listed:
        values = [one.parameters, *(parameters for _, parameters in one.steps)]
        assert known.issuperset(name for each in values for name in each)
        assert one.parameters.keys() == listed[0].parameters.keys()
        assert {"preset", "max_targets", "built_in_detector"} <= one.parameters.keys()
    # What the tour switches off for the first steps, its third one sets to the preset's own value.
    name = "redetection.windows"
    text, own = listed[0].steps[2]
    assert "switched off" in text
    assert listed[0].parameters[name] == 0
    assert own == {name: preset_parameters("default")[name]}
    texts = " ".join(text for one in listed for text, _ in one.steps)
    assert all(author in texts for author in ("Li, Zhang and Li", "Zhang, Hu and Shi", "Bo Zhang"))
