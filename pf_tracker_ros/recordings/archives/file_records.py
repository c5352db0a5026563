"""Records of written files by their hash, which tell them from files that a user added or changed.

A `done.json` has one hash of each file. Other records may have several, for a file that is being
replaced.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, BinaryIO

FileRecord = dict[str, Collection[str]]
"""Name of a file to the SHA-256 of each content that it may have, hexadecimal."""

_DONE_KEYS = {"name", "source", "key", "files"}
_CHUNK = 1 << 20


def parse_json(text: str) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: The text is no JSON, or nested too deep.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deep") from error


def parse_record(text: str, *, done: bool = False) -> FileRecord | None:
    """The record in a text, or None if there is none.

    Args:
        text: Of any origin.
        done: Whether it is a `done.json`, which always lists itself.
    """
    try:
        document = parse_json(text)
    except ValueError:
        return None
    if not isinstance(document, dict) or (done and not document.keys() >= _DONE_KEYS):
        return None
    files = document.get("files")
    if not isinstance(files, dict):
        return None
    return {
        name: [one for one in (hashes if isinstance(hashes, list) else [hashes]) if _is_hash(one)]
        for name, hashes in files.items()
    }


def _is_hash(value: Any) -> bool:
    return isinstance(value, str)


def record_text(record: Mapping[str, Collection[str]]) -> bytes:
    """The text of a record."""
    return json.dumps({"files": {name: sorted(record[name]) for name in sorted(record)}}).encode()


def file_hashes(folder: Path) -> dict[str, str]:
    """Name to SHA-256 of each file in a folder.

    Raises:
        OSError: A file cannot be read.
    """
    found = {}
    for path in sorted(folder.iterdir()):
        with path.open("rb") as file:
            found[path.name] = hash_of(file)
    return found


def is_own_file(path: Path, record: FileRecord) -> bool:
    """Whether a path is a regular file with a recorded content.

    Raises:
        OSError: It cannot be read.
    """
    if not stat.S_ISREG(path.lstat().st_mode):
        return False
    hashes = record.get(path.name)
    if not hashes:
        return False
    with path.open("rb") as file:
        return hash_of(file) in hashes


def hash_of(content: bytes | BinaryIO) -> str:
    """SHA-256 of bytes, or of the rest of an open file, hexadecimal."""
    if isinstance(content, bytes):
        return hashlib.sha256(content).hexdigest()
    digest = hashlib.sha256()
    while chunk := content.read(_CHUNK):
        digest.update(chunk)
    return digest.hexdigest()
