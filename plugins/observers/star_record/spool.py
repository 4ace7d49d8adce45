"""Rows of a table, stored on disk: memory does not grow, and an interrupted flight leaves them."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, BinaryIO, Final, Self, cast

import numpy as np

BUFFER_SIZE: Final = 1 << 20  # bytes
FLUSH_PERIOD: Final = 1.0  # s of wall time, after which rows are not only in memory


class Spool:
    """Stores rows with the same columns in a file; a context manager that removes it at the end.

    The file begins with the header of an array of NumPy. It stays if the context ends by an error,
    or if the process ends.

    Args:
        path: The file, which must not exist.

    Raises:
        OSError: The file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._row: np.dtype[np.void] | None = None
        self._buffer = bytearray()
        self._file = cast("BinaryIO", path.open("x+b", buffering=0))
        self._close = weakref.finalize(self, _finish, self._file, self._buffer)
        self._header = 0  # bytes
        self._written = 0  # bytes
        self._flushed = monotonic()

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
            descr = np.lib.format.dtype_to_descr(self._row)
            header = {"descr": descr, "fortran_order": False, "shape": (0,)}
            np.lib.format.write_array_header_1_0(self._file, header)
            self._header = self._file.tell()
        record = np.empty((), self._row)
        for name, value in row.items():
            record[name] = value
        self._buffer += record.tobytes()
        if len(self._buffer) >= BUFFER_SIZE or monotonic() - self._flushed >= FLUSH_PERIOD:
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
        table: Any = np.memmap(self._file, self._row, "r", self._header, shape=(rows,))
        return {name: table[name] for name in self._row.names or ()}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: object, *_others: object) -> None:
        self._close()
        if error is None:
            self._path.unlink(missing_ok=True)

    def _flush(self) -> None:
        """Move the buffer to the file.

        Raises:
            OSError: It cannot be written in full; the rest stays in the buffer.
        """
        self._flushed = monotonic()
        while self._buffer:
            count = self._file.write(self._buffer)
            self._written += count
            del self._buffer[:count]


def _finish(file: BinaryIO, buffer: bytearray) -> None:
    """Write what is left, as far as possible, and close the file."""
    with suppress(OSError), file:
        file.write(buffer)
