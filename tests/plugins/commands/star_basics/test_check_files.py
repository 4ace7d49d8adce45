"""``star check`` of several files, folders and standard input, and its forms of output."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from star_basics import check_output
from star_basics.check_output import excerpt
from star_basics.check_problems import problem_of
from star_core import Registry
from star_core.commands import run_command
from star_core.commands.main import main
from tests.commands import Printed, problem_lines
from tests.conftest import HOP, ROOM, ROOT
from tests.plugins.formats.star_yaml.test_file_kinds import Gripper
from tests.plugins.formats.test_formats import Memo

WRONG = HOP.replace("height: 0.3", "hight: 0.3")
FAULT = "takeoff: unknown option 'hight'; did you mean 'height'?"
IN_AIR = HOP.replace("[0.5, 0, 0]", "[0.5, 0, 0.4]")


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(ROOM)
    Path("hop.yaml").write_text(HOP)
    Path("wrong.yaml").write_text(WRONG)
    Path("in_air.yaml").write_text(IN_AIR)


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Put a text on standard input."""

    def put(text: str) -> None:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))

    return put


def test_several_files_are_checked_and_counted(capsys: Printed) -> None:
    assert main(["check", "room.yaml", "wrong.yaml", "hop.yaml"]) == 2
    assert capsys.readouterr() == (
        "room.yaml: 'room', a world that can be flown in\n"
        "hop.yaml: 'hop' can be flown, with 2 agents\n",
        f"wrong.yaml:13:15: {FAULT} [unknown-option]\n"
        " 13 |   - takeoff: {hight: 0.3, speed: 0.5}\n"
        "    |               ^^^^^\n"
        "Found 1 error in 1 file, 3 files checked\n",
    )


def test_a_folder_is_searched_for_files_of_star(capsys: Printed) -> None:
    for name, text in {
        "site/mkdocs.yml": "site_name: x\n",
        "site/.github/flow.yaml": HOP,
        "node_modules/hop.yaml": HOP,
        "deep/er/lab.yaml": ROOM,
        "deep/no_version.yaml": HOP.removeprefix("star: 1\n"),
        "deep/torn.yaml": "star: 1\nname: [x\n",
        "deep/notes.txt": HOP,
    }.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)
    assert main(["check", "deep", "room.yaml", "."]) == 2
    out, err = capsys.readouterr()
    valid = ["deep/er/lab.yaml", "room.yaml", "hop.yaml", "in_air.yaml"]
    assert [line.partition(":")[0] for line in out.splitlines()] == valid
    files = dict.fromkeys(line.partition(":")[0] for line in problem_lines(err))
    assert [*files] == ["deep/no_version.yaml", "deep/torn.yaml", "in_air.yaml", "wrong.yaml"]


def test_a_folder_of_another_format_is_checked_as_one(capsys: Printed) -> None:
    Path("old").mkdir()
    Path("old/robots.yaml").write_text("fileversion: 3\nrobot_types: {}\nrobots: {}\n")
    Path("old/room.yaml").write_text(ROOM)
    assert main(["check", "--json", "old"]) == 2
    files = json.loads(capsys.readouterr().out)["files"]
    assert [(file["file"], file["valid"]) for file in files] == [
        ("old", False),
        ("old/room.yaml", True),
    ]


def test_a_folder_without_files_of_star_is_refused(capsys: Printed) -> None:
    Path("site").mkdir()
    Path("site/mkdocs.yml").write_text("site_name: x\n")
    assert main(["check", "site"]) == 2
    assert capsys.readouterr().err.endswith("to check [file-not-found]\n")
    assert main(["check", "site", "site/mkdocs.yml", "--skip-others"]) == 0


def test_the_seed_of_missions_leaves_other_files_as_they_are(capsys: Printed) -> None:
    Path("good.yaml").write_text(HOP)
    assert main(["check", "good.yaml", "room.yaml", "--seed", "3"]) == 0
    assert main(["check", "room.yaml", "--set", "fense=3"]) == 2
    assert capsys.readouterr().err.splitlines()[-2].endswith("[unknown-option]")


def test_problems_at_one_position_have_one_excerpt(capsys: Printed) -> None:
    Path("bare.yaml").write_text("star: 1\nname: bare\nmission: [takeoff: {}]\nworld: room.yaml\n")
    assert main(["check", "bare.yaml"]) == 2
    lines = capsys.readouterr().err.splitlines()
    missing = [line for line in lines if line.startswith("bare.yaml:1:1: ")]
    assert len(missing) == 5
    assert lines.count(" 1 | star: 1") == 1


def test_an_empty_name_is_not_the_current_folder(capsys: Printed) -> None:
    Path("good.yaml").write_text(HOP)
    assert main(["check", ""]) == 2
    assert capsys.readouterr().err.strip().endswith("[invalid-argument]")


def test_kinds_and_formats_of_plugins_are_checked_in_folders(capsys: Printed) -> None:
    Path("hands").mkdir()
    Path("hands/one.yaml").write_text("star: 1\nfingers: 9\n")
    Path("hands/two.memo").write_text("first_flight often\n")
    assert run_command("check", ["hands"], Registry(Gripper(), Memo())) == 2
    assert problem_lines(capsys.readouterr().err) == [
        "hands/one.yaml:2:10: 9 fingers, expected at most 5 [out-of-range]",
        "hands/two.memo:1: 'often' is no seed [invalid-value]",
    ]


def test_standard_input_is_checked(capsys: Printed, typed: Callable[[str], None]) -> None:
    typed(HOP)
    assert main(["check", "-"]) == 0
    assert capsys.readouterr() == ("-: 'hop' can be flown, with 2 agents\n", "")
    typed(WRONG)
    assert main(["check", "-", "room.yaml", "--skip-others"]) == 2
    _, fault, source, *_ = ["", *capsys.readouterr().err.splitlines()]
    assert fault == f"-:13:15: {FAULT} [unknown-option]"
    assert source == " 13 |   - takeoff: {hight: 0.3, speed: 0.5}"


@pytest.mark.parametrize(
    ("files", "strict", "status"),
    [
        (["in_air.yaml"], (), 0),
        (["in_air.yaml"], ("--strict",), 1),
        (["hop.yaml"], ("--strict",), 0),
        (["in_air.yaml", "wrong.yaml"], ("--strict",), 2),
    ],
)
def test_warnings_fail_a_strict_check(
    files: list[str], strict: tuple[str, ...], status: int, capsys: Printed
) -> None:
    assert main(["check", *files, *strict]) == status
    assert ("Found 1 error and 1 warning in 2 files, 2" in capsys.readouterr().err) is (status == 2)


def test_json_has_every_file_and_problem(capsys: Printed) -> None:
    assert main(["check", "--json", "wrong.yaml", "in_air.yaml", "absent.yaml"]) == 2
    out, err = capsys.readouterr()
    assert err == ""
    wrong, in_air, absent = json.loads(out)["files"]
    assert wrong == {
        "file": "wrong.yaml",
        "valid": False,
        "description": None,
        "problems": [
            {
                "file": "wrong.yaml",
                "line": 13,
                "column": 15,
                "severity": "error",
                "code": "unknown-option",
                "message": FAULT,
            }
        ],
    }
    assert in_air["valid"]
    assert in_air["problems"][0]["severity"] == "warning"
    assert absent["problems"][0]["line"] is None
    assert absent["problems"][0]["message"] == "no such file"


def test_annotations_of_github_escape_what_they_separate(capsys: Printed) -> None:
    Path("a,b.yaml").write_text(HOP.replace("avoider: orca", "avoider: '10%'"))
    assert main(["check", "--format", "github", "a,b.yaml", "in_air.yaml"]) == 2
    out, err = capsys.readouterr()
    error, warning = out.splitlines()
    assert error.startswith(
        "::error file=a%2Cb.yaml,line=11,col=10,title=star (unknown-plugin)::no avoider named '10%2"
    )
    assert warning.startswith(
        "::warning file=in_air.yaml,line=7,col=16,title=star (start-in-air)::"
    )
    assert err == ""


def test_a_terminal_has_colours_unless_refused(
    capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_output, "on_terminal", lambda: True)
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert main(["check", "wrong.yaml"]) == 2
    coloured = capsys.readouterr().err
    assert "\x1b[1mwrong.yaml:13:15:\x1b[0m takeoff" in coloured
    assert "\x1b[1;31m^^^^^\x1b[0m" in coloured
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["check", "wrong.yaml"]) == 2
    plain = capsys.readouterr().err
    assert plain == re.sub(r"\x1b\[[\d;]+m", "", coloured)


@pytest.mark.parametrize(
    ("column", "line", "source", "carets"),
    [
        (4, "a: [b]", "a: [b]", "   ^"),
        (4, "a: 'b c' # d", "a: 'b c' # d", "   ^^^^^"),
        (5, "\t\x1b: x", r" \x1b: x", "       ^"),
        (4, "高: x", "高: x", "    ^"),
        (4, "a: ", "a:", "   ^"),
        (161, "x" * 150 + "          y" + "z" * 40, "x" * 39 + "          y" + "z" * 40, None),
    ],
)
def test_carets_are_below_the_word(column: int, line: str, source: str, carets: str | None) -> None:
    problem = problem_of(f"m.yaml:1:{column}: wrong [wrong-type]", Path("m.yaml"))
    shown, below = excerpt(problem, [line], lambda text, _colour: text)
    if carets is None:
        assert len(shown) <= check_output.WIDTH + len(" 1 | ")
        assert shown[below.index("^")] == "y"
    else:
        assert (shown, below) == (f" 1 | {source}", f"   | {carets}")


def test_problems_of_included_steps_point_into_them(capsys: Printed) -> None:
    Path("nod.yaml").write_text("star: 1\nparameters: {t: null}\nmission: [hold: {for: $t}]\n")
    include = "  - include: {file: nod.yaml, with: {t: -1}}\n  - land"
    Path("m.yaml").write_text(HOP.replace("  - land", include, 1))
    assert main(["check", "m.yaml", "--json"]) == 2
    (problem,) = json.loads(capsys.readouterr().out)["files"][0]["problems"]
    assert problem["file"] in {"m.yaml", "nod.yaml"}
    assert "-1 is less than the minimum" in problem["message"]


def test_the_hook_of_pre_commit_checks_files_of_star(capsys: Printed) -> None:
    hooks: Any = YAML(typ="safe", pure=True).load((ROOT / ".pre-commit-hooks.yaml").read_text())
    page = (ROOT / "docs" / "check.md").read_text()
    assert re.findall(r"^ +- id: (.+)$", page, re.MULTILINE) == [hook["id"] for hook in hooks]
    (program, *entry) = hooks[0]["entry"].split()
    assert program == "star"
    assert main([*entry, str(ROOT / "mkdocs.yml"), "hop.yaml"]) == 0
    assert main([*entry, str(ROOT / "mkdocs.yml"), "wrong.yaml"]) == 2
    assert "Found 1 error in 1 file\n" in capsys.readouterr().err
