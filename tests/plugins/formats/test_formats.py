"""Formats that plugins add: which one reads a file, and what happens when it fails."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from star_core import InputError, Mission, PluginError, Registry, fly, hookimpl, load
from star_core.commands import run_command
from star_core.formats import FormatSpec, check_file, read_as


class Memo:
    """A format in which a file has the name of a mission that comes with STAR, and its seed."""

    @hookimpl
    def star_formats(self) -> Iterator[FormatSpec]:
        yield FormatSpec(
            name="memo",
            summary="The name of a mission, and a seed.",
            recognizes=lambda path: path.suffix == ".memo",
            load=self._load,
            check=lambda *file: (f"a memo of {self._load(*file).name!r}", ("read it again",)),
        )

    @staticmethod
    def _load(path: Path, registry: Registry, assignments: Sequence[str]) -> Mission:
        name, seed = path.read_text().split()
        if not seed.isdecimal():
            raise InputError(f"{path}:1: {seed!r} is no seed", "invalid-value")
        return load(name, registry, assignments).with_seed(int(seed))


@pytest.fixture
def memo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("flight.memo")
    path.write_text("first_flight 41\n")
    return path


def test_a_mission_is_loaded_by_the_format_that_recognizes_it(memo: Path) -> None:
    mission = load(memo, Registry(Memo()), ["rate=10"])
    assert (mission.name, mission.scene.seed, mission.scene.period) == ("first-flight", 41, 0.1)
    assert mission.source["seed"] == 41
    assert load("first_flight", Registry(Memo())).scene.seed == 7


def test_a_mission_of_a_plugins_format_flies(memo: Path) -> None:
    registry = Registry(Memo())
    quick = ["transport.profile=ideal", "mission=[{takeoff: {height: 0.4}}, {land: {}}]"]
    summary = fly(load(memo, registry, quick), registry)
    assert (summary["outcome"], summary["seed"]) == ("completed", 41)


def test_check_accepts_a_file_of_a_plugins_format(
    memo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command("check", [str(memo)], Registry(Memo())) == 0
    printed = capsys.readouterr()
    assert printed.out == "a memo of 'first-flight'\n"
    assert "read it again" in printed.err


def test_mistakes_that_a_format_reports_are_passed_on(memo: Path) -> None:
    memo.write_text("first_flight often\n")
    with pytest.raises(InputError) as error:
        check_file(memo, Registry(Memo()))
    assert str(error.value) == "flight.memo:1: 'often' is no seed [invalid-value]"


def test_a_format_that_raises_is_attributed_to_its_plugin(memo: Path) -> None:
    memo.write_text("first_flight\n")
    with pytest.raises(PluginError, match=r"^format 'memo' \(.*Memo\): ValueError: not enough"):
        load(memo, Registry(Memo()))


def test_a_format_may_have_missions_only(memo: Path) -> None:
    with pytest.raises(InputError) as error:
        read_as(memo, "world", Registry(Memo()))
    text = "flight.memo: format 'memo' has no such file as a world [wrong-file]"
    assert str(error.value) == text


def test_without_a_format_no_mission_is_loaded(memo: Path) -> None:
    with pytest.raises(PluginError) as error:
        load(memo, Registry(installed=False))
    assert str(error.value) == "no installed format reads 'flight.memo' [unknown-plugin]"
