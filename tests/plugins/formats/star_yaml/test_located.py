"""Reading YAML with places, and refusing what a mission may not hold."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core.errors import InputError
from star_yaml.document import Document
from star_yaml.input_file import read

MISSION = """\
# a comment
name: swap
limits: {speed: 0.5, height: [0.2, 1.8]}
swarm:
  cf1:
    start: [0, 0, 0]
avoider: orca
mission:
  - takeoff: {height: 1}
  - land:
"""


@pytest.fixture
def mission(tmp_path: Path) -> Document:
    return write(tmp_path, MISSION)


def write(folder: Path, content: str | bytes) -> Document:
    """Read `content` from a file and call it ``m.yaml``."""
    path = folder / "m.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read(path)


def refusals(folder: Path, content: str | bytes) -> list[str]:
    """Return why a file is refused, without its folder."""
    with pytest.raises(InputError) as caught:
        write(folder, content)
    return [problem.removeprefix(f"{folder}/") for problem in caught.value.problems]


# Places


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ((), "2:1", "2:1"),
        (("name",), "2:7", "2:1"),
        (("limits", "speed"), "3:17", "3:10"),
        (("limits", "height", 1), "3:36", "3:36"),
        (("swarm", "cf1", "start", 2), "6:19", "6:19"),
        (("mission", 0), "9:5", "9:5"),
        (("mission", 0, "takeoff", "height"), "9:23", "9:15"),
    ],
)
def test_every_value_and_every_key_has_its_place(
    mission: Document, path: tuple[str | int, ...], value: str, key: str
) -> None:
    assert mission.location_text(path) == f"{mission.path}:{value}"
    assert mission.location_text(path, key=True) == f"{mission.path}:{key}"


def test_nothing_after_a_key_stands_at_the_key(mission: Document) -> None:
    assert mission.data["mission"][1] == {"land": None}
    assert mission.location_text(("mission", 1, "land")) == f"{mission.path}:10:5"


def test_what_is_not_there_has_the_place_of_its_nearest_parent(mission: Document) -> None:
    assert mission.location_text(("swarm", "cf1", "uri", 3)) == f"{mission.path}:5:3"
    assert mission.location_text(("swarm", "cf9"), key=True) == mission.location_text(("swarm",))


def test_a_file_is_called_what_the_user_calls_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("here.yaml").write_text("a: 1")
    assert read(Path("here.yaml")).location_text(("a",)) == "here.yaml:1:4"


def test_a_byte_order_mark_and_windows_line_ends_shift_no_place(tmp_path: Path) -> None:
    document = write(tmp_path, b"\xef\xbb\xbfa: 1\r\nb: {c: 2}\r\n")
    assert document.data == {"a": 1, "b": {"c": 2}}
    assert document.location_text(("a",), key=True).endswith(":1:1")
    assert document.location_text(("b", "c")).endswith(":2:8")


# What scalars mean


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-0.5", -0.5),
        ("1e-3", 0.001),
        ("+2", 2),
        (".5", 0.5),
        ("true", True),
        ("~", None),
        ("on", "on"),
        ("NO", "NO"),
        ("1:30", "1:30"),
        ("'1'", "1"),
        ("'.nan'", ".nan"),
        ('"2001-01-01"', "2001-01-01"),
        ('"\\ud83d\\ude80"', "\N{ROCKET}"),
        ("|\n  two\n  lines", "two\nlines"),
    ],
)
def test_a_scalar_is_read_as_in_yaml_1_2_and_json(tmp_path: Path, text: str, value: object) -> None:
    scalar = write(tmp_path, f"a: {text}").data["a"]
    assert scalar == value
    assert type(scalar) is type(value)


def test_every_anchor_is_refused_without_a_warning(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write(tmp_path, "a: &x 1\nb: &x 2")
    places = [problem.partition(" is refused")[0] for problem in caught.value.problems]
    assert [place.rpartition("/")[2] for place in places] == [
        "m.yaml:1:4: anchor '&x'",
        "m.yaml:2:4: anchor '&x'",
    ]


@pytest.mark.parametrize(
    ("content", "beginning"),
    [
        ("a: " + "9" * 5000, "m.yaml:1:4: 999999999999999999999999... is not a plain, finite "),
        ("- " * 1500 + "1", "m.yaml:1:1: the maps and lists are nested too deeply"),
        ("a: 1\n" + "# x\n" * 250_000, "m.yaml:1:1: the file has more than 1 MB; split it, or "),
        ("a: 1\nb: x\0y", "m.yaml:2:5: character '\\x00' is refused; it cannot be printed"),
        (b"a: 1\r\nb: \xff", "m.yaml:2:4: byte 0xff is not UTF-8; save the file as UTF-8"),
        (b"\xef\xbb\xbf\xff", "m.yaml:1:1: byte 0xff is not UTF-8; save the file as UTF-8"),
        (MISSION.encode("utf-16-le"), "m.yaml:1:2: character '\\x00' is refused; it cannot be "),
    ],
    ids=lambda value: repr(value[:20]) if isinstance(value, (str, bytes)) else "",
)
def test_files_that_the_corpus_cannot_hold_are_refused(
    tmp_path: Path, content: str | bytes, beginning: str
) -> None:
    (problem,) = refusals(tmp_path, content)
    assert problem.startswith(beginning)


def test_all_refused_yaml_is_listed_at_once_in_file_order(tmp_path: Path) -> None:
    messages = refusals(tmp_path, "a: .nan\nb: &x [1_0]\na: *x\nc: [1_0, !t 2]")
    assert [problem.split(":")[1:3] for problem in messages] == [
        ["1", "4"],
        ["2", "4"],
        ["3", "1"],
        ["4", "5"],
        ["4", "10"],
    ]


# Properties

TEXT = st.text(
    st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp", "Cn"), exclude_characters="\ufeff"),
    max_size=20,
)
DATA = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=15,
)
quick = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@quick
@given(data=st.dictionaries(TEXT, DATA, max_size=5), indent=st.none() | st.integers(1, 4))
def test_what_is_written_as_json_is_read_as_it_was(
    tmp_path: Path, data: dict[str, Any], indent: int | None
) -> None:
    assert write(tmp_path, json.dumps(data, indent=indent)).data == data


@quick
@given(data=st.dictionaries(TEXT, DATA, max_size=5))
def test_what_ruamel_writes_in_blocks_is_read_as_it_was(
    tmp_path: Path, data: dict[str, Any]
) -> None:
    from ruamel.yaml import YAML

    writer = YAML(typ="safe", pure=True)
    writer.default_flow_style = False
    writer.representer.ignore_aliases = lambda _: True
    with (tmp_path / "m.yaml").open("w", encoding="utf-8") as file:
        writer.dump(data, file)
    assert read(tmp_path / "m.yaml").data == data


PIECES = st.lists(
    st.sampled_from(
        [*"-?:,[]{}#&*!|>'\"%@`~<=.\n \t\\0a1_", "- ", ": ", "\n  ", "---\n", "<<", "!!", "%YAML "]
    )
    | st.text(max_size=3)
).map("".join)


@quick
@given(content=st.binary(max_size=60) | PIECES.map(lambda text: text.encode("utf-8", "replace")))
def test_whatever_a_file_holds_is_read_or_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes(content)
    try:
        assert isinstance(read(path).data, dict)
    except InputError as error:
        assert error.problems  # noqa: PT017 -- either outcome is right
        assert all(problem.startswith(f"{path}:") for problem in error.problems)  # noqa: PT017
        assert not any("\n" in problem for problem in error.problems)  # noqa: PT017


def test_importing_the_reader_imports_no_yaml_and_no_numpy() -> None:
    code = (
        "import sys, star_core.formats.located, star_yaml.schema;"
        "print({'ruamel', 'numpy', 'jsonschema'}.intersection(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
