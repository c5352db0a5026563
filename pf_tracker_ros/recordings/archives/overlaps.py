"""Checks that the results of an archive do not overlap its recordings and sidecar files."""

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
    """Check that the results overlap no recording and no sidecar file.

    Args:
        recordings: As `find_recordings` returns them.
        archive: Folder or list of the recordings; results may lie in it, but not contain it.
        output: The folder of all results, or its URL.

    Raises:
        RecordingError: Results and recordings would overlap.
    """
    store = open_store(str(output))[0] if is_url(output) else None
    inputs: dict[PurePath, PathOrUrl] = {}
    parents: dict[PurePath, PathOrUrl] = {}
    for source in recordings.values():
        for path in _paths(source, store):
            for variant in (path, *_sidecar_paths(path)):
                inputs[variant] = source
                parents.update(dict.fromkeys(variant.parents, source))
    for path in _paths(archive, store):
        parents.update(dict.fromkeys((path, *path.parents), archive))
    for name, source in recordings.items():
        results = output / name if isinstance(output, Path) else f"{output}/{name}"
        for path in _paths(results, store):
            hit = next((inputs[each] for each in (path, *path.parents) if each in inputs), None)
            hit = hit or parents.get(path)
            if hit is not None:
                raise RecordingError(
                    f"the output {results} for {source} overlaps the input {hit}; give an output "
                    "apart from the recordings"
                )


def _paths(path_or_url: PathOrUrl, store: Any) -> Iterator[PurePath]:
    """The paths of a recording, archive or output in `store`, in the local file system if None.

    Empty if it is elsewhere.
    """
    # URLs may be chained, as for a file in a ZIP archive in a store.
    urls = (
        [parse_path_or_url(url) for url in str(path_or_url).split("::")]
        if is_url(path_or_url)
        else [Path(path_or_url)]
    )
    for url in urls:
        if isinstance(url, Path):
            if store is None:
                yield from _variants(url)
        elif store is not None:
            # A source that cannot be opened is reported later, when it is tracked.
            with contextlib.suppress(RecordingError):
                other, path = open_store(url)
                if _may_be_same(store, other):
                    yield PurePosixPath(posixpath.normpath(f"/{path.lstrip('/')}"))


def _variants(path: Path) -> set[Path]:
    """The path with all links resolved, and with only its parent's; they differ for a link."""
    return {Path(os.path.realpath(path)), Path(os.path.realpath(path.parent), path.name)}


def _sidecar_paths(path: PurePath) -> Iterator[PurePath]:
    """The paths of the target file and the detections of a recording."""
    for suffix in SIDECAR_SUFFIXES:
        if isinstance(path, Path):
            yield from _variants(sidecar_file(path, suffix))
        else:
            # In a store it is unknown whether this is a folder, whose sidecar keeps the whole name,
            # or a file: check both names.
            yield from (
                path.with_name(f"{each}{suffix}") for each in (path.name, path.stem) if each
            )


def _may_be_same(store: Any, other: Any) -> bool:
    """Whether two fsspec file systems may be the same store: one type, no option differs."""
    options, others = store.storage_options, other.storage_options
    return type(store) is type(other) and all(
        options[key] == others[key] for key in options.keys() & others.keys()
    )
