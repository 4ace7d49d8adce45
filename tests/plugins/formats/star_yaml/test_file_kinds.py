"""Kinds of files that plugins add, in ``star check`` and ``star schema``."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from star_core import InputError, PluginError, Problem, Registry, hookimpl
from star_core.commands import run_command
from star_core.formats import FileKindSpec, SourceFile, check_file, read_as
from tests.commands import position_and_code

SCHEMA = {
    "type": "object",
    "required": ["star", "fingers"],
    "additionalProperties": False,
    "properties": {"star": {"const": 1}, "fingers": {"type": "integer", "minimum": 1}},
}
MAX_FINGERS = 5


def hold(file: SourceFile, _registry: Registry) -> str:
    """Check a gripper."""
    fingers = file.data["fingers"]
    if fingers > MAX_FINGERS:
        text = f"{fingers} fingers, expected at most {MAX_FINGERS}"
        raise InputError(file.located([Problem(("fingers",), text, "out-of-range")]))
    return f"a gripper of {fingers} fingers"


class Gripper:
    """A plugin with a kind of file."""

    def __init__(self, check: Callable[[SourceFile, Registry], str] = hold) -> None:
        self._check = check

    @hookimpl
    def star_file_kinds(self) -> Iterator[FileKindSpec]:
        yield FileKindSpec(
            name="gripper",
            summary="A gripper.",
            noun="a gripper",
            keys=("fingers",),
            schema=lambda _registry: SCHEMA,
            check=self._check,
            hints={"mission": "name a mission that grasps"},
        )


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("hand.yaml")
    path.write_text("star: 1\nfingers: 3\n")
    return path


def test_check_accepts_the_kind_of_a_plugin(file: Path) -> None:
    outcome = check_file(file, Registry(Gripper()))
    assert outcome == ("hand.yaml: a gripper of 3 fingers", ())


@pytest.mark.parametrize(
    ("fingers", "fault"),
    [
        ("0", "hand.yaml:2:10: fingers: 0 is less than the minimum of 1 [out-of-range]"),
        ("6", "hand.yaml:2:10: 6 fingers, expected at most 5 [out-of-range]"),
    ],
)
def test_mistakes_by_schema_and_check_are_located(file: Path, fingers: str, fault: str) -> None:
    file.write_text(f"star: 1\nfingers: {fingers}\n")
    with pytest.raises(InputError) as error:
        check_file(file, Registry(Gripper()))
    assert error.value.problems == (fault,)


def test_a_kind_is_recognized_by_a_misspelt_key(file: Path) -> None:
    file.write_text("star: 1\nfinger: 2\n")
    with pytest.raises(InputError) as error:
        check_file(file, Registry(Gripper()))
    assert "hand.yaml:2:1 [unknown-option]" in map(position_and_code, error.value.problems)


def test_a_check_that_raises_is_attributed_to_its_plugin(file: Path) -> None:
    def fail(_file: SourceFile, _registry: Registry) -> str:
        raise LookupError("no hand")

    with pytest.raises(PluginError, match=r"^file kind 'gripper' \(.*Gripper\): LookupError: no h"):
        check_file(file, Registry(Gripper(fail)))


def test_a_file_of_the_kind_is_no_mission(file: Path) -> None:
    with pytest.raises(InputError) as error:
        read_as(file, "world", Registry(Gripper()))
    assert position_and_code(str(error.value)) == "hand.yaml:1:1 [wrong-file]"
    with pytest.raises(InputError) as error:
        run_command("run", [str(file)], Registry(Gripper()))
    assert position_and_code(str(error.value)) == "hand.yaml:1:1 [wrong-file]"
    assert "; name a mission that grasps [" in str(error.value)  # the hint of the kind


def test_schema_prints_the_schema_of_the_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command("schema", ["gripper"], Registry(Gripper())) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["properties"]["fingers"]["minimum"] == 1
    assert printed["properties"]["fingers"]["title"] == "Fingers"
