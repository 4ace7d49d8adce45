"""Folders that commands write to."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError
from star_core.commands import new_folder, reserving


def test_flights_that_begin_in_one_second_have_a_folder_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = new_folder("hop")
    with reserving(folder) as first, reserving(folder) as second, reserving(folder) as third:
        (second / "events.jsonl").touch()
    assert [each.name for each in (first, second, third)] == [
        folder.name + number for number in ("", "-2", "-3")
    ]
    assert [*Path("runs").iterdir()] == [second]  # those that stayed empty are removed


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    with pytest.raises(InputError, match="unwritable-file"), reserving(tmp_path / "runs" / "hop"):
        pass
