"""Rows of a table, stored on disk, so that memory does not grow with the length of a flight."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, Self

import numpy as np

BUFFER_SIZE: Final = 1 << 20  # bytes


class Spool:
    """Stores rows with the same columns in an unnamed file; a context manager that closes it.

    Args:
        folder: Folder of the file.

    Raises:
        OSError: The file cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self._row: np.dtype[np.void] | None = None
        self._buffer = bytearray()
        self._file = TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 -- see the next line
        self._close = weakref.finalize(self, self._file.close)  # of an interrupted flight, too
        self._written = 0  # bytes

    def add(self, row: Mapping[str, Any]) -> None:
        """Store one row; the first one defines the columns, their types and their shapes.

        Raises:
            OSError: The file cannot be written; the row may be lost.
        """
        if self._row is None:
            self._row = np.dtype([
                (name, np.asarray(value).dtype if np.ndim(value) else float, np.shape(value))
                for name, value in row.items()
            ])  # fmt: skip
        record = np.empty((), self._row)
        for name, value in row.items():
            record[name] = value
        self._buffer += record.tobytes()
        if len(self._buffer) >= BUFFER_SIZE:
            self._flush()

    def columns(self) -> dict[str, Any]:
        """Return a (T, ...) array of each column over the T rows so far; read it before the end.

        Rows for which the disk has no space are left out.
        """
        with suppress(OSError):
            self._flush()
        if self._row is None or self._written < self._row.itemsize:
            return {}
        rows = self._written // self._row.itemsize
        table: Any = np.memmap(self._file, self._row, "r", shape=(rows,))
        return {name: table[name] for name in self._row.names or ()}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._close()

    def _flush(self) -> None:
        """Move the buffer to the file.

        Raises:
            OSError: It cannot be written in full; the rest stays in the buffer.
        """
        while self._buffer:
            count = self._file.write(self._buffer)
            self._written += count
            del self._buffer[:count]
