"""Text files told from videos by their content.

FFmpeg plays texts as what a terminal would show, and playlists by opening whatever they name.
"""

from __future__ import annotations

import re
from pathlib import Path

_HEAD_SIZE = 4096

# Raw frames behind a line of text, which dark gray ones continue.
_TEXT_HEADED_VIDEO = b"YUV4MPEG2 "

# What FFmpeg takes for HLS, a list of files to join, a session description or DASH, even among
# other bytes.
_PLAYLIST = re.compile(rb"\A\W*(#EXTM3U|ffconcat)|^c=IN IP|<MPD\b", re.IGNORECASE | re.MULTILINE)
_WIDE_TEXT = (b"\xff\xfe", b"\xfe\xff")


def is_text(path: Path) -> bool:
    """Whether a file is a text, playlists included.

    Videos hold bytes of 0 near their beginning, texts do not.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_SIZE)
    if head.startswith(_TEXT_HEADED_VIDEO):
        return False
    is_plain = bool(head) and b"\0" not in head
    return is_plain or head.startswith(_WIDE_TEXT) or _PLAYLIST.search(head) is not None
