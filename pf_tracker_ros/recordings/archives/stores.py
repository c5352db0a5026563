"""Object stores and other locations with a URL, through fsspec."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from pf_tracker_ros.command_lines import missing_package
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.errors import FAILED, NO_PERMISSION, REFUSED, RecordingError


def parse_path_or_url(text: str) -> Path | str:
    """Parse a path or URL. A `file://` URL becomes a path, and others lose a slash at the end."""
    if not is_url(text):
        return Path(text)
    try:
        parts = urlsplit(text)
    except ValueError:
        # Invalid, such as an IPv6 address without its bracket. Opening it reports the error.
        return text.rstrip("/")
    if parts.scheme in ("file", "local"):
        return Path(unquote(parts.netloc + parts.path))
    return text.rstrip("/")


def is_url(path_or_url: Path | str) -> bool:
    """Whether this is a URL, not a path in the file system."""
    return isinstance(path_or_url, str) and "://" in path_or_url


def open_store(url: str) -> tuple[Any, str]:
    """The fsspec file system of a URL, and the path in it.

    Raises:
        RecordingError: The protocol is unknown, or its package is missing.
    """
    if missing := missing_package("fsspec", "archives"):
        raise RecordingError(missing)
    import fsspec

    try:
        store, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError, OSError) as error:
        raise RecordingError(f"{url} cannot be opened ({reason_of(error)})", REFUSED) from error
    # Another process may have written since.
    store.invalidate_cache()
    return store, str(path).rstrip("/")


def reason_of(error: BaseException) -> str:
    """The message of a library's error, as part of a sentence."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__


@contextmanager
def translate_read_errors(url: str) -> Iterator[None]:
    """Translate the errors of a store during reading.

    Raises:
        FootageError: It cannot be read.
    """
    try:
        yield
    except (FootageError, RecordingError):
        raise
    except FileNotFoundError as error:
        raise FootageError(f"there is no {url}") from error
    # Each store has its own exceptions.
    except Exception as error:
        raise FootageError(f"{url} cannot be read ({reason_of(error)})") from error


@contextmanager
def translate_write_errors(url: str) -> Iterator[None]:
    """Translate the errors of a store during writing.

    Raises:
        RecordingError: It cannot be written.
    """
    try:
        yield
    except RecordingError:
        raise
    except PermissionError as error:
        raise RecordingError(
            f"{url} cannot be written with these credentials ({reason_of(error)}); change them, or "
            "choose another output",
            NO_PERMISSION,
        ) from error
    except Exception as error:
        raise RecordingError(f"{url} cannot be written ({reason_of(error)})", FAILED) from error
