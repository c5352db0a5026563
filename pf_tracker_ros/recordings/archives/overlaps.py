"""Whether the results of an archive would come where its recordings are."""

from __future__ import annotations

import contextlib
import os
import posixpath
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath, PurePosixPath
from typing import Any

from pf_tracker_ros.recordings.archives.sources import PathOrUrl
from pf_tracker_ros.recordings.archives.stores import is_url, open_store, parse_path_or_url
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.sidecar_files import SIDECAR_SUFFIXES, sidecar_file


def check_no_overlap(
    recordings: Mapping[str, PathOrUrl], archive: PathOrUrl, output: PathOrUrl
) -> None:
    """Refuse results in the place of a recording or a file of its own, inside or around one.

    Args:
        recordings: As `find_recordings` returns them.
        archive: Where they were found; results may lie inside of it, but not around it.
        output: The folder of all results, or its URL.

    Raises:
        RecordingError: There would be such results.
    """
    store = open_store(str(output))[0] if is_url(output) else None
    kept: dict[PurePath, PathOrUrl] = {}
    around: dict[PurePath, PathOrUrl] = {}
    for source in recordings.values():
        for path in _paths(source, store):
            for form in (path, *_beside(path)):
                kept[form] = source
                around.update(dict.fromkeys(form.parents, source))
    for path in _paths(archive, store):
        around.update(dict.fromkeys((path, *path.parents), archive))
    for name, source in recordings.items():
        place = output / name if isinstance(output, Path) else f"{output}/{name}"
        for path in _paths(place, store):
            hit = next((kept[each] for each in (path, *path.parents) if each in kept), None)
            hit = hit or around.get(path)
            if hit is not None:
                raise RecordingError(
                    f"the results of {source} would go to {place}, which is, contains or lies in "
                    f"what belongs to {hit}; give an output apart from the recordings"
                )


def _paths(place: PathOrUrl, store: Any) -> Iterator[PurePath]:
    """A place in a store, or in the file system for None; nothing if it is elsewhere."""
    # URLs may be chained, as of a file in a ZIP archive in a store.
    links = (
        [parse_path_or_url(link) for link in str(place).split("::")]
        if is_url(place)
        else [Path(place)]
    )
    for link in links:
        if isinstance(link, Path):
            if store is None:
                yield from _forms(link)
        elif store is not None:
            # One that cannot be opened is told of when it is tracked.
            with contextlib.suppress(RecordingError):
                other, path = open_store(link)
                if _may_be_same(store, other):
                    yield PurePosixPath(posixpath.normpath(f"/{path.lstrip('/')}"))


def _forms(path: Path) -> set[Path]:
    """A path without links on the way to it, and what it is if it is a link itself."""
    return {Path(os.path.realpath(path)), Path(os.path.realpath(path.parent), path.name)}


def _beside(path: PurePath) -> Iterator[PurePath]:
    """Where the target of a recording and its detections stand."""
    for ending in SIDECAR_SUFFIXES:
        if isinstance(path, Path):
            yield from _forms(sidecar_file(path, ending))
        else:
            # To know which one it is, the store would have to be asked about each.
            yield from (
                path.with_name(f"{each}{ending}") for each in (path.name, path.stem) if each
            )


def _may_be_same(store: Any, other: Any) -> bool:
    """Whether two of fsspec's file systems may be of one store: not, say, of two accounts."""
    options, others = store.storage_options, other.storage_options
    return type(store) is type(other) and all(
        options[key] == others[key] for key in options.keys() & others.keys()
    )
