"""Storage of the results of an archive. The results of a recording appear atomically.

- In a folder, all files of a recording are written to a hidden folder, which is then renamed.
- In an object store, each object is written atomically, and `done.json` last. Results without it
  are incomplete.

A killed process leaves no incomplete results. `done.json` has the SHA-256 of each file. Only files
with the recorded hash are replaced or removed. Those that were added or changed since stay.
"""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.recordings.archives.results_folder import ResultsFolder
from pf_tracker_ros.recordings.archives.results_store import ResultsStore
from pf_tracker_ros.recordings.archives.sources import PathOrUrl
from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.errors import RecordingError

# Stores that write objects atomically. Not all of fsspec's others do.
_OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss")

Results = ResultsFolder | ResultsStore
"""Storage of results. Workers, on other machines too, receive copies."""


def results_at(path_or_url: PathOrUrl) -> Results:
    """The results in a folder or at the URL of an object store.

    Raises:
        RecordingError: The store is not supported.
    """
    if not is_url(path_or_url):
        return ResultsFolder(Path(path_or_url).absolute())
    scheme = str(path_or_url).partition("://")[0].lower()
    if scheme not in _OBJECT_STORES:
        raise RecordingError(
            f"results cannot be written to {scheme}://; allowed: a folder, "
            f"{', '.join(f'{each}://' for each in _OBJECT_STORES)}"
        )
    return ResultsStore(str(path_or_url))
