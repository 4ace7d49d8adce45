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
    monkeypatch.setattr("time.strftime", lambda _format: "TIME")
    with reserving("hop") as first, reserving("hop") as second, reserving("hop") as third:
        assert new_folder("hop").name == "TIME-hop-4"
        (second / "events.jsonl").touch()
    names = [each.name for each in (first, second, third)]
    assert names == ["TIME-hop", "TIME-hop-2", "TIME-hop-3"]
    assert [*Path("runs").iterdir()] == [second]  # those that stayed empty are removed


def test_a_folder_that_cannot_be_made_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("runs").touch()
    with pytest.raises(InputError, match="unwritable-file"), reserving("hop"):
        pass
