"""Writes the page that ends the demo: videos, figures, bags, commands and plots."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from clips import Clip
from follower import NARROW, WIDE, FollowerResult
from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader, StrictUndefined
from markupsafe import Markup
from processes import ros_arguments
from report import Summary

from pf_tracker_ros import __version__

PAGE = "index.html"
_FOLDER = Path(__file__).resolve().parent
_REPOSITORY = _FOLDER.parent


class ClipResult(NamedTuple):
    """A tracked clip.

    Attributes:
        clip: The clip.
        summary: Its figures.
        track_arguments: Arguments of `track` that made its report.
    """

    clip: Clip
    summary: Summary
    track_arguments: Sequence[str]


def write_page(
    results: Sequence[ClipResult], follower: FollowerResult | None, folder: Path
) -> Path:
    """Write index.html beside the folders of the clips; its links are relative.

    Args:
        results: The tracked clips.
        follower: The robot's run; None if it is still to come.
        folder: Folder of the folders of the clips.

    Returns:
        Path of the page.
    """
    environment = Environment(
        # The styles are those of the reports.
        loader=ChoiceLoader(
            [FileSystemLoader(_FOLDER), PackageLoader("pf_tracker_ros.evaluation.reports", ".")]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    path = folder / PAGE
    text = environment.get_template(f"{PAGE}.jinja").render(
        version=__version__,
        clips=[(result.clip, result.summary, _commands(result, folder)) for result in results],
        follower=follower,
        how_to_follow=os.path.relpath(_REPOSITORY / "docs" / "follow_a_person.md", folder),
        wide=WIDE,
        narrow=NARROW,
        view_from_above=Markup(follower.view_from_above if follower else ""),
        follower_commands={
            made: shlex.join(map(_shown_if_path, command))
            for made, command in (follower.commands if follower else {}).items()
        },
    )
    path.write_text(text, encoding="utf-8")
    return path


def _commands(result: ClipResult, folder: Path) -> dict[str, str]:
    """What a command makes, to the command, as typed in the folder of the repository."""
    clip = result.clip
    recording = _shown(folder / clip.name / clip.bag)
    replayed: dict[str, object] = {"lockstep": True}
    if clip.box:
        replayed["target_box"] = list(clip.box)
    else:
        replayed["lockstep_rate"] = 0.25
    tracker = ["tracker", *ros_arguments({"image_reliability": "reliable", **clip.parameters})]
    replay = ["replay", recording, *ros_arguments(replayed)]
    track = ["track", *map(_shown_if_path, result.track_arguments)]
    return {
        "boxes on the topics of the node": shlex.join(tracker),
        "its images, in another terminal": shlex.join(replay),
        "report, boxes.csv and topics.mcap": shlex.join(track),
        "the page of the console": f"console {recording}",
    }


def _shown_if_path(argument: str) -> str:
    if "/" not in argument:
        return argument
    path = Path(argument)
    # `track` replaces no results.
    return _shown(path.with_name("tracked_again") if path.name == "tracked" else path)


def _shown(path: Path) -> str:
    """A path relative to the repository, if it is in there."""
    return os.path.relpath(path, _REPOSITORY) if path.is_relative_to(_REPOSITORY) else str(path)
