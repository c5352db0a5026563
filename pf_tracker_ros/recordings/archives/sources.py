"""The recordings of an archive: how they are found, named, fingerprinted and downloaded.

In a folder, a recording is
- a sequence folder, which has a ground truth file, or
- an entry with a target file beside it, or
- an entry that a `RecordingFilter` accepts without a target, because a detector finds targets.
Folders that are no recordings are searched in turn. A list names its recordings itself. The name
of a recording, which is also the folder of its results, is its path relative to the archive, or
its last part if it lies elsewhere.
"""

from __future__ import annotations

import contextlib
import posixpath
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from pf_tracker_ros.footage import FootageError, is_bag
from pf_tracker_ros.footage.access import entries, exists, is_folder, lexists, read_file, resolved
from pf_tracker_ros.footage.ground_truth import ground_truth_file
from pf_tracker_ros.recordings.archives.recording_filter import RecordingFilter
from pf_tracker_ros.recordings.archives.scratch import scratch_folder
from pf_tracker_ros.recordings.archives.stores import (
    is_url,
    open_store,
    parse_path_or_url,
    translate_read_errors,
)
from pf_tracker_ros.recordings.errors import DISK_FULL_ERRNOS, RecordingError, unwritable
from pf_tracker_ros.recordings.sidecar_files import (
    DETECTIONS_SUFFIX,
    SIDECAR_SUFFIXES,
    TARGET_SUFFIX,
    detections_file,
    has_unique_stem,
    has_video_suffix,
    target_file,
)
from pf_tracker_ros.yaml_files import YamlError, read_yaml

PathOrUrl = Path | str
"""A path, or a URL."""

# Bytes of a list of recordings.
_MAX_LIST = 100 * 10**6
# A path may contain the sign, but not after white space.
_COMMENT = re.compile(r"(^|\s)#.*")


def find_recordings(
    archive: PathOrUrl, without_target: RecordingFilter | None = None
) -> dict[str, PathOrUrl]:
    """Find the recordings of an archive.

    Args:
        archive: Folder or its URL, searched recursively; or text file with a recording per line, a
            URL or a path relative to the file. Empty lines are skipped. A comment begins with `#`
            at the start of a line or after white space.
        without_target: Accepts entries of a folder without a target; None accepts none.

    Returns:
        Unique name without `..`, to absolute path or URL; sorted by name for a folder, else in the
        order of the list.

    Raises:
        RecordingError: Two recordings share a name, one has no name, or there are none.
        FootageError: There is no such archive, or it cannot be read.
    """
    if is_url(archive):
        base, sources = _in_store(str(archive), without_target)
    else:
        base, sources = _in_folder(Path(archive), without_target)
    found: dict[str, PathOrUrl] = {}
    for source in sources:
        name = _name(source, base)
        if name in ("", ".."):
            raise RecordingError(f"{source} has no name for its results; list its entries instead")
        if name in found:
            raise RecordingError(
                f"{found[name]} and {source} would share the results folder {name}; rename or "
                "remove one"
            )
        found[name] = source
    _check_nesting(found)
    if not found:
        others = ", or a detector: --detections, --detections-topic or --detector"
        if without_target:
            others = f"; detections are applied to {without_target.description}"
        raise RecordingError(
            f"no recording in {archive}; each needs a target file beside it, such as drive"
            f"{TARGET_SUFFIX} for drive.mcap, or a ground truth in its folder{others}"
        )
    return found


def fingerprint(source: PathOrUrl, *, with_detections: bool = False) -> list[list[Any]]:
    """A value that changes with any file of a recording or its target file.

    Args:
        source: Absolute path, or URL.
        with_detections: Whether to include the detection file.

    Returns:
        Name, size and modification time of each file; for a URL, name and the store's key.
    """
    if is_url(source):
        return _fingerprint_in_store(str(source), with_detections)
    path = Path(source)
    files = [path, target_file(path), *([detections_file(path)] if with_detections else [])]
    if is_folder(path):
        files += sorted(each for each in path.rglob("*") if each.is_file())
    states = []
    for file in files:
        with contextlib.suppress(OSError):
            status = file.stat()
            size = status.st_size if file.is_file() else 0
            states.append([str(file), size, status.st_mtime_ns])
    return states


@contextmanager
def local_copy(source: PathOrUrl) -> Iterator[Path]:
    """Yield a recording's path; for a URL, that of a temporary copy with its sidecar files.

    Raises:
        FootageError: It cannot be read.
        RecordingError: The disk is full.
    """
    if not is_url(source):
        yield Path(source)
        return
    with scratch_folder() as folder:
        yield _download(str(source), folder)


@contextmanager
def errors_name_source(source: PathOrUrl, copy: Path) -> Iterator[None]:
    """Let errors in the block name the URL of a recording instead of its temporary copy.

    Raises:
        FootageError, RecordingError: As in the block.
    """
    try:
        yield
    except (FootageError, RecordingError) as error:
        name_source_in(error, source, copy)
        raise


def name_source_in(error: FootageError | RecordingError, source: PathOrUrl, copy: Path) -> None:
    """Let an error name the URL of a recording instead of its temporary copy."""
    if is_url(source):
        error.args = (str(error).replace(str(copy.parent), str(source).rpartition("/")[0]),)


def _in_folder(
    archive: Path, without_target: RecordingFilter | None
) -> tuple[PathOrUrl, list[PathOrUrl]]:
    """The folder that names are relative to, and the recordings."""
    if not exists(archive):
        raise FootageError(f"there is no archive {archive}; give a folder, or a text file")
    if archive.is_dir():
        return resolved(archive), sorted(set(_below(archive, without_target)))
    try:
        text = read_file(archive, "list", _MAX_LIST).decode("utf-8-sig")
    except ValueError as error:
        raise FootageError(f"the list {archive} cannot be read ({error})") from error
    if "\0" in text:
        raise FootageError(f"the list {archive} contains null characters; allowed: UTF-8 text")
    # A listed recording that does not exist fails later, without stopping the others.
    base = resolved(archive.parent)
    return base, list(_listed(text, base))


def _in_store(
    archive: str, without_target: RecordingFilter | None
) -> tuple[PathOrUrl, list[PathOrUrl]]:
    """The URL that names are relative to, and the recordings."""
    with translate_read_errors(archive):
        store, root = open_store(archive)
        if store.isfile(root):
            base = archive.rpartition("/")[0]
            return base, list(_listed(store.cat_file(root).decode("utf-8-sig"), base))
        names = store.find(root)
        if not names:
            raise FootageError(f"there is no archive {archive}, or it is empty")
        # The rules for folders are applied to a local folder with the same names.
        with scratch_folder() as mirror:
            for name in names:
                relative = PurePosixPath(name.removeprefix(root).lstrip("/"))
                if ".." in relative.parts or not relative.name:
                    continue
                copy = mirror / relative
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_bytes(store.cat_file(name) if name.endswith(TARGET_SUFFIX) else b"")
            found = sorted(path.relative_to(mirror) for path in set(_below(mirror, without_target)))
    return archive, [f"{archive}/{path}" if path.parts else archive for path in found]


def _below(folder: Path, without_target: RecordingFilter | None) -> list[Path]:
    accepts_targeted = without_target is None or without_target.accepts_targeted
    if ground_truth_file(folder) is not None:
        return [resolved(folder)] if accepts_targeted else []
    found = []
    for path in entries(folder):
        if path.name.startswith("."):
            continue
        if (accepts_targeted and _is_targeted(path)) or (
            without_target is not None and without_target.matches(path)
        ):
            found.append(resolved(path))
        elif path.is_dir() and not path.is_symlink():
            try:
                found += _below(path, without_target)
            except FootageError:
                # Listed as a recording, which then fails with the reason.
                found.append(resolved(path))
    if not found and without_target is not None and without_target.is_image_folder(folder):
        return [resolved(folder)]
    return found


def _is_targeted(path: Path) -> bool:
    """Whether a target file stands beside an entry and is meant for it."""
    if path.name.endswith(TARGET_SUFFIX) or not lexists(target_file(path)):
        return False
    recording = _recording_in(target_file(path))
    if recording and lexists(path.parent / recording):
        return resolved(path).name == recording
    # Other files may share the stem of a video, such as the subtitles of a drone's camera.
    return path.is_dir() or is_bag(path) or has_video_suffix(path) or has_unique_stem(path)


def _recording_in(path: Path) -> str | None:
    """The recording that a target file names, if any."""
    try:
        document = read_yaml(path, "target file")
    except YamlError:
        # The error is reported when the recording is tracked.
        return None
    recording = document.get("recording") if isinstance(document, dict) else None
    return recording if isinstance(recording, str) else None


def _listed(text: str, base: PathOrUrl) -> Iterator[PathOrUrl]:
    """The recordings of a list, relative to a folder or its URL."""
    for line in text.splitlines():
        entry = _COMMENT.sub("", line).strip()
        if not entry:
            continue
        source = parse_path_or_url(entry)
        if is_url(base) and not is_url(entry):
            url = f"{base}/{entry}".rstrip("/")
            yield _normalized(url) if ".." in url.split("/") else url
        elif isinstance(source, Path):
            # The home of an unknown user fails later, as a missing path.
            with contextlib.suppress(RuntimeError):
                source = source.expanduser()
            path = (base / source).absolute()
            # The parent of a link depends on where it points.
            yield resolved(path) if ".." in path.parts else path
        else:
            yield source


def _name(source: PathOrUrl, base: PathOrUrl) -> str:
    """The name of a recording: its path relative to the archive, else its last part."""
    path, parent = _normalized(source), f"{_normalized(base)}/"
    relative = path.removeprefix(parent) if path.startswith(parent) else ""
    return relative or PurePosixPath(path).name


def _normalized(path_or_url: PathOrUrl) -> str:
    """A path or URL without `..` and empty parts."""
    scheme, separator, path = str(path_or_url).rpartition("://")
    return f"{scheme}{separator}{posixpath.normpath(path)}"


def _check_nesting(found: dict[str, PathOrUrl]) -> None:
    """Reject a recording whose results would lie in the folder of another one."""
    for name, source in found.items():
        for parent in PurePosixPath(name).parents:
            if str(parent) in found:
                raise RecordingError(
                    f"{source} is inside {found[str(parent)]}, which is a recording itself; list "
                    "one of them"
                )


def _fingerprint_in_store(url: str, with_detections: bool) -> list[list[Any]]:
    suffixes = (TARGET_SUFFIX, *([DETECTIONS_SUFFIX] if with_detections else []))
    try:
        with translate_read_errors(url):
            store, path = open_store(url)
            names = [*store.find(path), *_sidecar_paths(store, path, suffixes)]
            return [[name, store.ukey(name)] for name in names if store.exists(name)]
    except (FootageError, RecordingError):
        # The error is reported when the recording is tracked.
        return []


def _sidecar_paths(store: Any, path: str, suffixes: Sequence[str] = SIDECAR_SUFFIXES) -> list[str]:
    """Paths of the sidecar files of a recording, whether they exist or not."""
    parent, _, name = path.rpartition("/")
    stem = name if store.isdir(path) else PurePosixPath(name).stem
    return [f"{parent}/{stem}{suffix}" for suffix in suffixes]


def _download(url: str, folder: Path) -> Path:
    with translate_read_errors(url):
        store, path = open_store(url)
        names = store.find(path)
        if not names:
            raise FileNotFoundError(url)
        parent, _, base_name = path.rpartition("/")
        for name in [*names, *filter(store.exists, _sidecar_paths(store, path))]:
            relative = PurePosixPath(name.removeprefix(f"{parent}/"))
            if relative.is_absolute() or ".." in relative.parts:
                raise FootageError(f"{url} has an object of the name {name!r}; allowed: no '..'")
            copy = folder / relative
            try:
                copy.parent.mkdir(parents=True, exist_ok=True)
                store.get_file(name, str(copy))
            except OSError as error:
                if error.errno in DISK_FULL_ERRNOS:
                    raise unwritable(copy, error) from error
                raise
        return folder / base_name
