"""Files that a mission names lie in its folder; what is below an agent that lands."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core.errors import InputError
from star_core.plugin_support.option_schema import fill_defaults
from star_core.world.scene import Limits, inside
from star_yaml import schema


def refusal(folder: Path, name: str) -> str:
    with pytest.raises(InputError) as raised:
        inside(folder, name)
    return str(raised.value)


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    """A folder of missions, with a file beside it and a folder inside."""
    (tmp_path / "path.csv").touch()
    (tmp_path / "missions" / "inner").mkdir(parents=True)
    return tmp_path / "missions"


@pytest.mark.parametrize("name", ["../path.csv", "inner/../../path.csv"])
def test_a_path_out_of_the_folder_is_refused(missions: Path, name: str) -> None:
    expected = f"{name!r} is outside the mission's folder; name a file inside it [file-not-found]"
    assert refusal(missions, name) == expected


def test_an_absolute_path_is_refused_though_it_leads_inside(missions: Path) -> None:
    (missions / "a.csv").touch()
    found = refusal(missions, str(missions / "a.csv"))
    assert found.endswith(
        "is an absolute path; write it from the mission's folder: a.csv [file-not-found]"
    )


def test_an_absolute_path_that_leads_outside_is_refused(missions: Path) -> None:
    assert "'/etc/hostname' is an absolute path" in refusal(missions, "/etc/hostname")


def test_a_link_out_of_the_folder_is_refused(missions: Path) -> None:
    (missions / "link.csv").symlink_to(missions.parent / "path.csv")
    assert refusal(missions, "link.csv").startswith("'link.csv' is outside the mission's folder")


def test_a_link_inside_the_folder_is_followed(missions: Path) -> None:
    (missions / "a.csv").write_text("1", encoding="utf-8")
    (missions / "inner" / "link.csv").symlink_to(missions / "a.csv")
    assert inside(missions, "inner/link.csv").read_text(encoding="utf-8") == "1"


def test_missing_files_are_reported_with_a_suggestion(missions: Path) -> None:
    (missions / "round.csv").touch()
    expected = (
        "no file 'ronud.csv' in the mission's folder; did you mean 'round.csv'? [file-not-found]"
    )
    assert refusal(missions, "ronud.csv") == expected
    assert refusal(missions, "far/off.csv") == (
        "no file 'far/off.csv' in the mission's folder [file-not-found]"
    )


def test_a_folder_is_no_file(missions: Path) -> None:
    assert (
        refusal(missions, "inner")
        == "'inner' is no file; name a file in the mission's folder [unreadable-file]"
    )


@pytest.mark.parametrize("name", ["a\0b", "loop"])
def test_what_is_no_path_is_refused(missions: Path, name: str) -> None:
    (missions / "loop").symlink_to("loop")
    assert repr(name) in refusal(missions, name)


def test_limits_in_python_are_those_of_a_mission_without_limits() -> None:
    limits = schema.load("mission")["properties"]["limits"]
    given = fill_defaults({}, limits)
    assert Limits(**given | {"height": tuple(given["height"])}) == Limits()
