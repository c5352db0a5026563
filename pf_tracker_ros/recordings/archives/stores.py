"""Object stores and other places that have a URL, through fsspec."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.errors import FAILED, NO_PERMISSION, REFUSED, RecordingError


def parse_path_or_url(text: str) -> Path | str:
    """A path, or the URL of a place that is not of the file system, without a slash at its end."""
    if not is_url(text):
        return Path(text)
    try:
        parts = urlsplit(text)
    except ValueError:
        # Such as of an address without its bracket, which is told of where it is opened.
        return text.rstrip("/")
    if parts.scheme in ("file", "local"):
        return Path(unquote(parts.netloc + parts.path))
    return text.rstrip("/")


def is_url(place: Path | str) -> bool:
    """Whether a place is not of the file system."""
    return isinstance(place, str) and "://" in place


def open_store(url: str) -> tuple[Any, str]:
    """The fsspec file system of a URL, and the path in it.

    Raises:
        RecordingError: There is no such kind of URL, or a package is missing for it.
    """
    try:
        import fsspec
    except ImportError as error:
        raise RecordingError(
            "fsspec is not installed: pip install fsspec, or '.[archives]' in the sources"
        ) from error
    try:
        store, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError, OSError) as error:
        raise RecordingError(f"{url} cannot be opened ({reason_of(error)})", REFUSED) from error
    # What another process has put there since is to be seen.
    store.invalidate_cache()
    return store, str(path).rstrip("/")


def reason_of(error: BaseException) -> str:
    """An error of a library as part of a sentence."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__


@contextmanager
def translate_read_errors(url: str) -> Iterator[None]:
    """Tell what a store says while something is read there.

    Raises:
        FootageError: It cannot be read.
    """
    try:
        yield
    except (FootageError, RecordingError):
        raise
    except FileNotFoundError as error:
        raise FootageError(f"there is no {url}") from error
    # Each kind of store has exceptions of its own.
    except Exception as error:
        raise FootageError(f"{url} cannot be read ({reason_of(error)})") from error


@contextmanager
def translate_write_errors(url: str) -> Iterator[None]:
    """Tell what a store says while something is written there.

    Raises:
        RecordingError: It cannot be written.
    """
    try:
        yield
    except RecordingError:
        raise
    except PermissionError as error:
        raise RecordingError(
            f"{url} may not be written with these credentials ({reason_of(error)}); change them, "
            "or choose another place",
            NO_PERMISSION,
        ) from error
    except Exception as error:
        raise RecordingError(f"{url} cannot be written ({reason_of(error)})", FAILED) from error
