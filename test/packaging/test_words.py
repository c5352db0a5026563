"""One name has one meaning, and names that the field has better words for stay away."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = REPOSITORY / "pf_tracker_ros"
SOURCES = sorted(PACKAGE.rglob("*.py"))
# Entry points and parsers of several commands; `T` and the like are type variables.
SHARED = {"main", "parser"}
# Former name to the field's term.
FORMER = {
    "AnsweredImages": "DeferredImageInput",
    "BeforeJump": "SavedTemplates",
    "Beginning": "FilterInitializer",
    "BestKeepingResampler": "ElitistResampler",
    "Crowd": "TrackSet",
    "CrowdKeeper": "TrackingPipeline",
    "Distraction": "DistractorRatios",
    "Expectation": "FramePrediction",
    "Finder": "AppearanceRedetector",
    "Follower": "TargetFilter",
    "FollowLikeliest": "KeepTracking",
    "ForeseeableMotion": "LinearizableMotion",
    "Glimpse": "DistractorCandidate",
    "Hearing": "DetectionSource",
    "Judge": "TrackAssessor",
    "Judgment": "Assessment",
    "KalmanForesight": "KalmanFilter",
    "Life": "Track",
    "Looker": "DetectionFilter",
    "NotKeptError": "FrameNotBufferedError",
    "Pairing": "FrameSynchronizer",
    "Prospect": "PredictedTarget",
    "Recognizer": "ReIdentifier",
    "Sighting": "Detection",
    "Steering": "StateOperations",
    "WaitingAnswers": "DetectionQueue",
    "WhileHidden": "OcclusionPolicy",
    "before_jump": "saved_templates",
    "by_hand": "is_manual",
    "crowd": "track_set",
    "foresight": "kalman_filter",
    "glimpse": "distractor_candidate",
    "gone_for": "time_since_end",
    "idle_for": "time_since_detection",
    "is_doubled": "is_duplicate",
    "is_told": "is_reported",
    "lays_ghosts": "removes_ghosts",
    "learned_again": "relearned",
    "lives": "tracks",
    "look_alike": "known_distractor",
    "look_elsewhere": "search_around",
    "lost_share": "frame_loss_rate",
    "renewed_by": "reset_by",
    "runner_up": "second_peak",
    "seen_box": "last_seen_box",
    "spread_anew": "redraw_particles",
    "standing_out": "peak_to_sidelobe",
    "tell_apart": "correct_id_switches",
    "told_box": "published_box",
    "while_hidden": "occlusion_policy",
}


def is_type_variable(statement):
    value = getattr(statement, "value", None)
    return isinstance(value, ast.Call) and getattr(value.func, "id", "") == "TypeVar"


def public_names(tree):
    """The public names that a module defines at its top."""
    for statement in tree.body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            names = [statement.name]
        elif isinstance(statement, ast.Assign) and not is_type_variable(statement):
            names = [target.id for target in statement.targets if isinstance(target, ast.Name)]
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            names = [statement.target.id]
        else:
            names = []
        yield from (name for name in names if not name.startswith("_"))


def places(sources):
    """Public name to the modules that define it."""
    found = defaultdict(list)
    for module, text in sources.items():
        for name in public_names(ast.parse(text)):
            found[name].append(module)
    return found


def read(paths):
    return {str(path.relative_to(REPOSITORY)): path.read_text() for path in paths}


def former_words(text):
    """The former names in a text, as words of their own."""
    return [name for name in FORMER if re.search(rf"\b{name}\b", text)]


def test_a_public_name_is_defined_in_one_place():
    found = places(read(SOURCES))
    assert {name: where for name, where in found.items() if len(where) > 1} == {
        name: found[name] for name in SHARED
    }


def test_a_second_definition_is_found():
    sources = {
        "a": "class Track: ...\n_x = 1\nT = TypeVar('T')",
        "b": "def f(): ...\nTrack = int\n_x = 2\nT = TypeVar('T')",
    }
    assert {name: at for name, at in places(sources).items() if len(at) > 1} == {
        "Track": ["a", "b"]
    }


@pytest.mark.parametrize("folder", ["pf_tracker_ros", "docs", "launch", "config", "examples"])
def test_no_former_name_comes_back(folder):
    paths = [
        path
        for path in (REPOSITORY / folder).rglob("*")
        if path.suffix in {".py", ".md", ".yaml", ".js", ".html", ".jinja"}
    ]
    found = {name: former_words(text) for name, text in read(paths).items()}
    assert {name: words for name, words in found.items() if words} == {}


def test_a_former_name_is_found_as_a_word_of_its_own():
    assert former_words("self.crowd = LifeCycle(by_handle)") == ["crowd"]
