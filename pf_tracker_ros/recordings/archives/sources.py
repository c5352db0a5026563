"""The recordings of an archive: which there are, what they are made of, a copy to read."""

from __future__ import annotations

import contextlib
import posixpath
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from pf_tracker_ros.footage import FootageError, is_bag
from pf_tracker_ros.footage.access import entries, exists, is_folder, lexists, resolved
from pf_tracker_ros.footage.ground_truth import ground_truth_file
from pf_tracker_ros.recordings.archives.recording_filter import RecordingFilter
from pf_tracker_ros.recordings.archives.scratch import scratch_folder
from pf_tracker_ros.recordings.archives.stores import (
    is_url,
    open_store,
    parse_path_or_url,
    translate_read_errors,
)
from pf_tracker_ros.recordings.errors import DISK_IS_FULL, RecordingError, unwritable
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

# A path may have the sign in it.
_REMARK = re.compile(r"(^|\s)#.*")


def find_recordings(
    archive: PathOrUrl, without_target: RecordingFilter | None = None
) -> dict[str, PathOrUrl]:
    """The recordings of an archive: those with a target file, and sequence folders.

    Args:
        archive: A folder, or the URL of one, that is searched with all below it; or a text file
            that lists one recording a line, a URL or relative to the file, empty lines and
            what follows a `#` that begins a line or comes after white space left out.
        without_target: Which others in a folder are recordings too, without a target; None for none.

    Returns:
        Name, unique among them and without `..`, to absolute path or URL; sorted by name for a
        folder, else as listed.

    Raises:
        RecordingError: Two recordings share a name, one has no name, or there is none.
        FootageError: There is no such archive, or it cannot be read.
    """
    if is_url(archive):
        base, places = _in_store(str(archive), without_target)
    else:
        base, places = _in_folder(Path(archive), without_target)
    found: dict[str, PathOrUrl] = {}
    for place in places:
        name = _name(place, base)
        if name in ("", ".."):
            raise RecordingError(
                f"{place} has no name that its results could go by; list what is below it"
            )
        if name in found:
            raise RecordingError(
                f"{found[name]} and {place} would both be written as {name}; name one otherwise"
            )
        found[name] = place
    _check_names(found)
    if not found:
        others = "; without targets, --detections, --detections-topic or --detector finds them"
        if without_target:
            others = f"; detections are looked for in {without_target.description}"
        raise RecordingError(
            f"no recording in {archive}; each needs its target beside it, such as drive"
            f"{TARGET_SUFFIX} for drive.mcap, or a ground truth in its folder{others}"
        )
    return found


def fingerprint(source: PathOrUrl, *, with_detections: bool = False) -> list[list[Any]]:
    """What a recording and its target file are made of: changes where one of their files does.

    Args:
        source: Absolute path, or URL.
        with_detections: Whether the detections beside it count as well.

    Returns:
        Name, size and time of each file; of those with a URL name and what the store has for that.
    """
    if is_url(source):
        return _state_in_store(str(source), with_detections)
    path = Path(source)
    files = [path, target_file(path), *([detections_file(path)] if with_detections else [])]
    if is_folder(path):
        files += sorted(each for each in path.rglob("*") if each.is_file())
    state = []
    for file in files:
        with contextlib.suppress(OSError):
            status = file.stat()
            size = status.st_size if file.is_file() else 0
            state.append([str(file), size, status.st_mtime_ns])
    return state


@contextmanager
def local_copy(source: PathOrUrl) -> Iterator[Path]:
    """A recording as a path: itself, or for a URL a copy with what is beside it, gone afterwards.

    Raises:
        FootageError: It cannot be read.
        RecordingError: There is no room for the copy.
    """
    if not is_url(source):
        yield Path(source)
        return
    with scratch_folder() as folder:
        yield _download(str(source), folder)


@contextmanager
def errors_name_source(source: PathOrUrl, copy: Path) -> Iterator[None]:
    """Tell of a recording where it is, and not where its copy was.

    Raises:
        FootageError, RecordingError: As in the block.
    """
    try:
        yield
    except (FootageError, RecordingError) as error:
        name_source_in(error, source, copy)
        raise


def name_source_in(error: FootageError | RecordingError, source: PathOrUrl, copy: Path) -> None:
    """Let an error tell of a recording where it is, and not where its copy was."""
    if is_url(source):
        error.args = (str(error).replace(str(copy.parent), str(source).rpartition("/")[0]),)


def _in_folder(
    archive: Path, without_target: RecordingFilter | None
) -> tuple[PathOrUrl, list[PathOrUrl]]:
    """The folder that names are relative to, and the recordings."""
    if not exists(archive):
        raise FootageError(f"there is no archive {archive}; give a folder, or a file with a list")
    if archive.is_dir():
        return resolved(archive), sorted(set(_below(archive, without_target)))
    try:
        text = archive.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise FootageError(f"the list {archive} cannot be read ({error})") from error
    if "\0" in text:
        raise FootageError(f"the list {archive} has characters of code 0; allowed: UTF-8 text")
    # One that is not there is told of with the others that fail.
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
        # The rules for folders see one with the same names.
        with scratch_folder() as likeness:
            for name in names:
                relative = PurePosixPath(name.removeprefix(root).lstrip("/"))
                if ".." in relative.parts or not relative.name:
                    continue
                copy = likeness / relative
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_bytes(store.cat_file(name) if name.endswith(TARGET_SUFFIX) else b"")
            found = sorted(
                path.relative_to(likeness) for path in set(_below(likeness, without_target))
            )
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
                # Told of with the recordings that fail.
                found.append(resolved(path))
    if not found and without_target is not None and without_target.is_image_folder(folder):
        return [resolved(folder)]
    return found


def _is_targeted(path: Path) -> bool:
    """Whether there is a target file beside it, and not for another file of that name."""
    if path.name.endswith(TARGET_SUFFIX) or not lexists(target_file(path)):
        return False
    if named := _named_in(target_file(path)):
        return resolved(path).name == named
    # Of a video there may be more, such as the subtitles of a drone's camera.
    return path.is_dir() or is_bag(path) or has_video_suffix(path) or has_unique_stem(path)


def _named_in(path: Path) -> str | None:
    try:
        document = read_yaml(path, "target file")
    except YamlError:
        # Told of when it is tracked.
        return None
    named = document.get("recording") if isinstance(document, dict) else None
    return named if isinstance(named, str) else None


def _listed(text: str, base: PathOrUrl) -> Iterator[PathOrUrl]:
    """The recordings of a list, whose entries are relative to a folder or the URL of one."""
    for line in text.splitlines():
        entry = _REMARK.sub("", line).strip()
        if not entry:
            continue
        place = parse_path_or_url(entry)
        if is_url(base) and not is_url(entry):
            url = f"{base}/{entry}".rstrip("/")
            yield _normal(url) if ".." in url.split("/") else url
        elif isinstance(place, Path):
            # A home that nobody has is told of with what is missing otherwise.
            with contextlib.suppress(RuntimeError):
                place = place.expanduser()
            path = (base / place).absolute()
            # What is above a link is not what its path looks like.
            yield resolved(path) if ".." in path.parts else path
        else:
            yield place


def _name(place: PathOrUrl, base: PathOrUrl) -> str:
    """The folder of a recording's results: its place below the archive, else its last part."""
    whole, above = _normal(place), f"{_normal(base)}/"
    inside = whole.removeprefix(above) if whole.startswith(above) else ""
    return inside or PurePosixPath(whole).name


def _normal(place: PathOrUrl) -> str:
    """A path or URL without `..` and empty parts inside."""
    scheme, separator, path = str(place).rpartition("://")
    return f"{scheme}{separator}{posixpath.normpath(path)}"


def _check_names(found: dict[str, PathOrUrl]) -> None:
    """Refuse a recording whose results would lie among those of another one."""
    for name, place in found.items():
        for parent in PurePosixPath(name).parents:
            if str(parent) in found:
                raise RecordingError(
                    f"{place} is inside of {found[str(parent)]}, which is a recording itself; "
                    "list one of them"
                )


def _state_in_store(url: str, with_detections: bool) -> list[list[Any]]:
    endings = (TARGET_SUFFIX, *([DETECTIONS_SUFFIX] if with_detections else []))
    try:
        with translate_read_errors(url):
            store, path = open_store(url)
            names = [*store.find(path), *_beside(store, path, endings)]
            return [[name, store.ukey(name)] for name in names if store.exists(name)]
    except (FootageError, RecordingError):
        # Told of when it is tracked.
        return []


def _beside(store: Any, path: str, endings: Sequence[str] = SIDECAR_SUFFIXES) -> list[str]:
    """Where files of a recording stand, whether there are such or not."""
    parent, _, name = path.rpartition("/")
    stem = name if store.isdir(path) else PurePosixPath(name).stem
    return [f"{parent}/{stem}{ending}" for ending in endings]


def _download(url: str, folder: Path) -> Path:
    with translate_read_errors(url):
        store, path = open_store(url)
        names = store.find(path)
        if not names:
            raise FileNotFoundError(url)
        parent, _, last = path.rpartition("/")
        for name in [*names, *filter(store.exists, _beside(store, path))]:
            copy = folder / name.removeprefix(f"{parent}/")
            try:
                copy.parent.mkdir(parents=True, exist_ok=True)
                store.get_file(name, str(copy))
            except OSError as error:
                if error.errno in DISK_IS_FULL:
                    raise unwritable(copy, error) from error
                raise
        return folder / last
