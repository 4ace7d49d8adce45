"""Rows that were stored come back as columns, from memory and from the disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_record import spool
from star_record.spool import Spool

ROW = {"time": 0.0, "position": np.zeros((3, 2)), "known": np.zeros(3, np.bool_)}
ROWS = 50


def rows() -> list[dict[str, Any]]:
    rng = np.random.default_rng(1)
    return [
        {"time": 0.1 * i, "position": rng.normal(size=(3, 2)), "known": rng.random(3) < 0.5}
        for i in range(ROWS)
    ]


@pytest.mark.parametrize("size", [1, 300, 1 << 20])
def test_columns_hold_the_rows_whatever_fits_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(spool, "BUFFER_SIZE", size)
    with Spool(tmp_path / "a.rows") as kept:
        for row in rows():
            kept.add(row)
            assert len(kept._buffer) < size
        columns = kept.columns()
        for name in ROW:
            expected = np.array([row[name] for row in rows()])
            assert columns[name].dtype == expected.dtype
            np.testing.assert_array_equal(columns[name], expected)


def test_times_starting_at_an_integer_keep_their_fractions(tmp_path: Path) -> None:
    with Spool(tmp_path / "a.rows") as kept:
        for time in (0, 0.05):
            kept.add({"time": time})
        assert kept.columns()["time"].tolist() == [0.0, 0.05]


def test_a_table_without_rows_has_no_columns(tmp_path: Path) -> None:
    with Spool(tmp_path / "a.rows") as kept:
        assert kept.columns() == {}


def test_no_file_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool, "BUFFER_SIZE", 1)
    with Spool(tmp_path / "a.rows") as kept:
        kept.add(ROW)
    assert list(tmp_path.iterdir()) == []


def test_rows_written_before_the_disk_was_full_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spool, "BUFFER_SIZE", 1)
    with Spool(tmp_path / "a.rows") as kept:
        for row in rows()[:10]:
            kept.add(row)
        monkeypatch.setattr(kept, "_file", Full(kept._file))
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            kept.add(ROW)
        assert len(kept.columns()["time"]) == 10


class Full:
    """A file on a disk that takes half a row more."""

    def __init__(self, file: Any) -> None:
        self._file, self._space = file, 20

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def write(self, data: bytearray) -> int:
        if not self._space:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count, self._space = int(self._file.write(data[: self._space])), 0
        return count
