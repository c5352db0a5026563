"""The results as a table with a row for each target in each frame, as CSV or Parquet."""

from __future__ import annotations

import csv
import io
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pf_tracker_ros.localization.world_tracks import LocatedTarget
from pf_tracker_ros.recordings.tracking import TrackedFrame, published_box

COLUMNS = ("frame", "stamp", "id", "x", "y", "width", "height", "state", "confidence")
LABELED_COLUMNS = (*COLUMNS, "label")
"""The columns with max_targets above 1."""
POSITION_COLUMNS = (
    "position_x",
    "position_y",
    "velocity_x",
    "velocity_y",
    "covariance_xx",
    "covariance_xy",
    "covariance_yy",
    "velocity_covariance_xx",
    "velocity_covariance_xy",
    "velocity_covariance_yy",
    "method",
)
"""Further columns with positions, in meters and meters per second."""
# Unicode categories: control characters, line separators, paragraph separators, surrogates.
_REPLACED_CATEGORIES = {"Cc", "Zl", "Zp", "Cs"}
_PARQUET_BATCH_ROWS = 4096


def rows(tracked: TrackedFrame) -> list[dict[str, Any]]:
    """The rows of a frame, with values for the columns above; others have no value.

    There is a row for each target, and one row for a frame without targets. Frames count from 0,
    stamps are in nanoseconds, boxes in pixels. A lost target has no box. The id of a row without a
    target is 1 if max_targets is 1. A target without a recent measurement has no position, and a
    position that this frame did not measure has no method.
    """
    frame = {"frame": tracked.frame.index, "stamp": tracked.frame.stamp}
    if not tracked.targets:
        id = 1 if tracked.max_targets == 1 else None
        return [{**frame, "id": id, "state": tracked.state}]
    positions = {}
    if tracked.located:
        positions = {one.reported.id: _position_values(one) for one in tracked.located.targets}
    made = []
    for target in tracked.targets:
        box = published_box(target.estimate) or ()
        values = {
            "id": target.id,
            **dict(zip(COLUMNS[3:7], box, strict=False)),
            "state": target.estimate.state,
            "confidence": float(target.estimate.confidence),
            "label": single_line(target.label) or None,
        }
        made.append({**frame, **values, **positions.get(target.id, {})})
    return made


def _position_values(located: LocatedTarget) -> dict[str, Any]:
    if located.world is None:
        return {}
    filtered = located.world.filtered
    numbers = [*filtered.position, *filtered.velocity]
    for block in (filtered.covariance[:2, :2], filtered.covariance[2:, 2:]):
        numbers += [block[0, 0], block[0, 1], block[1, 1]]
    values: dict[str, Any] = dict(zip(POSITION_COLUMNS[:-1], map(float, numbers), strict=True))
    is_measured = located.place is not None and not located.problem
    values["method"] = located.place.method if located.place and is_measured else None
    return values


def single_line(label: str) -> str:
    """A label with spaces in place of line breaks, control characters and surrogates."""
    return "".join(
        " " if unicodedata.category(letter) in _REPLACED_CATEGORIES else letter for letter in label
    )


class BoxesCsv:
    """Writes rows as CSV. The numbers read back to the same bits.

    The file always ends with a complete row, even on a full disk.

    Args:
        path: Of the new file.
        columns: Of `LABELED_COLUMNS` and `POSITION_COLUMNS`.

    Raises:
        OSError: It cannot be written.
    """

    note = ""

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS) -> None:
        self._columns = columns
        # Unbuffered: on a full disk, the rows before stay.
        self._file = path.open("wb", buffering=0)
        self._complete_size = 0
        self._write([columns])

    def write(self, tracked: TrackedFrame) -> None:
        """Write the rows of a frame."""
        self._write([[row.get(name) for name in self._columns] for row in rows(tracked)])

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    discard = close

    def _write(self, rows: Iterable[Sequence[Any]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        octets = text.getvalue().encode()
        try:
            written = 0
            while written < len(octets):
                written += self._file.write(octets[written:])
        except OSError:
            self._file.truncate(self._complete_size)
            raise
        self._complete_size += len(octets)


class BoxesParquet:
    """Writes the same rows as Apache Parquet. Needs pyarrow.

    Args:
        path: Of the new file.
        columns: As for `BoxesCsv`.

    Raises:
        OSError: It cannot be written.
    """

    note = ""

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS) -> None:
        import pyarrow
        from pyarrow import parquet

        types = {"frame": "int64", "stamp": "int64", "id": "int32"}
        types |= dict.fromkeys(("state", "label", "method"), "string")
        self._pyarrow = pyarrow
        self._schema = pyarrow.schema(
            [(name, getattr(pyarrow, types.get(name, "float64"))()) for name in columns]
        )
        self._file = path.open("wb")
        self._writer = parquet.ParquetWriter(self._file, self._schema)
        self._rows: list[tuple[Any, ...]] = []

    def write(self, tracked: TrackedFrame) -> None:
        """Write the rows of a frame."""
        names = self._schema.names
        self._rows += [tuple(row.get(name) for name in names) for row in rows(tracked)]
        if len(self._rows) >= _PARQUET_BATCH_ROWS:
            self._write_rows()

    def close(self) -> None:
        """Complete the file."""
        try:
            with self._file:
                self._write_rows()
                self._writer.close()
        finally:
            self._detach_writer()

    def discard(self) -> None:
        """Close the incomplete file."""
        self._detach_writer()
        self._file.close()

    def _detach_writer(self) -> None:
        # Otherwise its destructor writes into the closed file, and raises.
        self._writer.is_open = False

    def _write_rows(self) -> None:
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(self._schema)
        arrays = [
            self._pyarrow.array(list(values), field.type)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._rows = []
        self._writer.write_table(self._pyarrow.Table.from_arrays(arrays, schema=self._schema))
