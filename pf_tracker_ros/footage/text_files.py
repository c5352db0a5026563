"""Distinguishes text files from videos by their content.

FFmpeg plays a text as terminal output, and a playlist by opening the files and addresses in it.
"""

from __future__ import annotations

import re
from pathlib import Path

_HEAD_SIZE = 4096

# A line of text before raw frames, which contain no byte of 0 if they are dark gray.
_TEXT_HEADED_VIDEO = b"YUV4MPEG2 "

# Playlists of FFmpeg: HLS, lists of files, session descriptions and DASH, even among other bytes.
_PLAYLIST = re.compile(rb"\A\W*(#EXTM3U|ffconcat)|^c=IN IP|<MPD\b", re.IGNORECASE | re.MULTILINE)
_WIDE_TEXT = (b"\xff\xfe", b"\xfe\xff")


def is_text(path: Path) -> bool:
    """Whether a file is a text or a playlist.

    Videos have bytes of 0 near their beginning, texts do not.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_SIZE)
    if head.startswith(_TEXT_HEADED_VIDEO):
        return False
    is_plain = bool(head) and b"\0" not in head
    return is_plain or head.startswith(_WIDE_TEXT) or _PLAYLIST.search(head) is not None
