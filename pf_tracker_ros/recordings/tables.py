"""What was found in a recording as a table: a row for each target in each frame."""

from __future__ import annotations

import csv
import io
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pf_tracker_ros.recordings.tracking import TrackedFrame, published_box

COLUMNS = ("frame", "stamp", "id", "x", "y", "width", "height", "state", "confidence")
LABELED_COLUMNS = (*COLUMNS, "label")
"""Those of several targets."""
# Control characters, line and paragraph separators, halves of characters.
_NOT_ON_A_LINE = {"Cc", "Zl", "Zp", "Cs"}
_ROWS_AT_ONCE = 4096


def rows(tracked: TrackedFrame) -> list[tuple[Any, ...]]:
    """A row for each target in a frame, at least one, with a value for each of `LABELED_COLUMNS`.

    None stands for what is unknown. Frames count from 0, stamps are in nanoseconds, boxes in
    pixels. There is no box while a target is lost, and nothing of it in a frame that was not
    looked at; the id of a row without a target is 1 where there may be one alone.
    """
    of_frame = (tracked.frame.index, tracked.frame.stamp)
    if not tracked.targets:
        id = 1 if tracked.max_targets == 1 else None
        return [(*of_frame, id, *(None,) * 4, tracked.state, None, None)]
    return [
        (
            *of_frame,
            target.id,
            *(published_box(target.estimate) or (None,) * 4),
            target.estimate.state,
            float(target.estimate.confidence),
            _on_a_line(target.label) or None,
        )
        for target in tracked.targets
    ]


def _on_a_line(label: str) -> str:
    """A label without what would break a line, or is no text at all."""
    return "".join(
        " " if unicodedata.category(letter) in _NOT_ON_A_LINE else letter for letter in label
    )


class BoxesCsv:
    """Writes rows as CSV, each whole or not at all; numbers read back to the same bits.

    Args:
        path: The file, made anew.
        columns: The first ones of `LABELED_COLUMNS`.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS) -> None:
        self._count = len(columns)
        # Without a buffer: what was written before the disk was full stays, up to a whole line.
        self._file = path.open("wb", buffering=0)
        self._whole = 0
        self._write([columns])

    def write(self, tracked: TrackedFrame) -> None:
        """Write a frame's rows."""
        self._write([row[: self._count] for row in rows(tracked)])

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def discard(self) -> None:
        """Give the file up."""
        self._file.close()

    def _write(self, rows: Iterable[Sequence[Any]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        octets = text.getvalue().encode()
        try:
            written = 0
            while written < len(octets):
                written += self._file.write(octets[written:])
        except OSError:
            self._file.truncate(self._whole)
            raise
        self._whole += len(octets)


class BoxesParquet:
    """Writes the same rows as Apache Parquet. Needs pyarrow.

    Args:
        path: The file, made anew.
        columns: As for `BoxesCsv`.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS) -> None:
        import pyarrow
        from pyarrow import parquet

        types = {"frame": "int64", "stamp": "int64", "id": "int32"}
        types |= dict.fromkeys(("state", "label"), "string")
        self._library = pyarrow
        self._schema = pyarrow.schema(
            [(name, getattr(pyarrow, types.get(name, "float64"))()) for name in columns]
        )
        self._file = path.open("wb")
        self._writer = parquet.ParquetWriter(self._file, self._schema)
        self._rows: list[tuple[Any, ...]] = []

    def write(self, tracked: TrackedFrame) -> None:
        """Write a frame's rows."""
        self._rows += [row[: len(self._schema)] for row in rows(tracked)]
        if len(self._rows) >= _ROWS_AT_ONCE:
            self._write_rows()

    def close(self) -> None:
        """Finish the file."""
        try:
            with self._file:
                self._write_rows()
                self._writer.close()
        finally:
            self._forget_writer()

    def discard(self) -> None:
        """Give the file up."""
        self._forget_writer()
        self._file.close()

    def _forget_writer(self) -> None:
        # Else it would write into the closed file when it is collected, and complain.
        self._writer.is_open = False

    def _write_rows(self) -> None:
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(self._schema)
        arrays = [
            self._library.array(list(values), field.type)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._rows = []
        self._writer.write_table(self._library.Table.from_arrays(arrays, schema=self._schema))
