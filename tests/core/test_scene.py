"""Files that a mission names lie in its folder; what is below an agent that lands."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core.errors import InputError
from star_core.plugin_support.option_schema import fill_defaults
from star_core.world.scene import Limits, inside
from star_yaml import schema


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    """A folder of missions, with a file beside it and a folder inside."""
    (tmp_path / "path.csv").touch()
    (tmp_path / "missions" / "inner").mkdir(parents=True)
    return tmp_path / "missions"


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("../path.csv", "file-not-found"),
        ("inner/../../path.csv", "file-not-found"),
        ("{}/a.csv", "file-not-found"),  # absolute, though it leads inside
        ("/etc/hostname", "file-not-found"),
        ("link.csv", "file-not-found"),  # leads out of the folder
        ("ronud.csv", "file-not-found"),
        ("far/off.csv", "file-not-found"),
        ("inner", "unreadable-file"),
        ("a\0b", "unreadable-file"),
        ("loop", "unreadable-file"),
    ],
)
def test_names_of_other_files_than_those_inside_are_refused(
    missions: Path, name: str, code: str
) -> None:
    (missions / "a.csv").touch()
    (missions / "link.csv").symlink_to(missions.parent / "path.csv")
    (missions / "loop").symlink_to("loop")
    with pytest.raises(InputError) as raised:
        inside(missions, name.format(missions))
    assert raised.value.code == code


def test_a_link_inside_the_folder_is_followed(missions: Path) -> None:
    (missions / "a.csv").write_text("1", encoding="utf-8")
    (missions / "inner" / "link.csv").symlink_to(missions / "a.csv")
    assert inside(missions, "inner/link.csv").read_text(encoding="utf-8") == "1"


def test_limits_in_python_are_those_of_a_mission_without_limits() -> None:
    limits = schema.load("mission")["properties"]["limits"]
    defaults = fill_defaults({}, limits)
    assert Limits(**defaults | {"height": tuple(defaults["height"])}) == Limits()
