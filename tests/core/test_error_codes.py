"""Every error has a stable code, and every code an entry in the catalogue."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from star_basics.errors import error_catalogue, page
from star_core.commands.main import main
from star_core.errors import (
    ContractError,
    InputError,
    PluginError,
    StarError,
    code_of,
    coded,
)

ROOT = Path(__file__).parents[2]
SOURCES = sorted([*(ROOT / "star_core").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")])
CODE_ARGUMENT = {  # the position of the code in calls of these functions
    "StarError": 1,
    "InputError": 1,
    "PluginError": 1,
    "ContractError": 1,
    "coded": 1,
    "Problem": 2,
    "problem": 2,
    "unknown_name": 4,
    "Fault": 2,
    "wrong": 1,
    "_report": 2,
    "_error": 2,
}


def codes(tree: ast.AST) -> Iterator[str]:
    """Yield every string in a source that is meant as a code."""
    for node in ast.walk(tree):
        values: list[ast.expr] = []
        if isinstance(node, ast.Call):
            function = node.func
            name = function.attr if isinstance(function, ast.Attribute) else ""
            name = function.id if isinstance(function, ast.Name) else name
            at = CODE_ARGUMENT.get(name)
            values += [keyword.value for keyword in node.keywords if keyword.arg == "code"]
            values += node.args[at : at + 1] if at is not None else []
        elif isinstance(node, ast.ClassDef | ast.Module):
            for stmt in node.body:
                if isinstance(stmt, ast.Assign | ast.AnnAssign) and stmt.value is not None:
                    targets = stmt.targets if isinstance(stmt, ast.Assign) else [stmt.target]
                    named = {target.id for target in targets if isinstance(target, ast.Name)}
                    values += [stmt.value] if "code" in named else []
                    mapped = stmt.value.values if isinstance(stmt.value, ast.Dict) else []
                    values += mapped if "CODES" in named else []
        elif isinstance(node, ast.FunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args][::-1]
            pairs = [*zip(arguments, node.args.defaults[::-1], strict=False)]
            pairs += [
                (arg, default)
                for arg, default in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
                if default is not None
            ]
            values += [default for arg, default in pairs if arg.arg == "code"]
        for value in values:
            for inner in ast.walk(value):
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str) and inner.value:
                    yield inner.value


@cache
def texts() -> tuple[dict[str, Path], set[str]]:
    """The codes in the sources, with a file of each, and all texts in them."""
    used: dict[str, Path] = {}
    written: set[str] = set()
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        used |= dict.fromkeys(codes(tree), path.relative_to(ROOT))
        constants = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
        written |= {value for value in constants if isinstance(value, str)}
    return used, written


def test_every_code_in_the_sources_is_in_the_catalogue() -> None:
    used, _written = texts()
    assert {code: path for code, path in used.items() if code not in error_catalogue()} == {}


def test_every_code_of_the_catalogue_is_used() -> None:
    _used, written = texts()
    assert error_catalogue().keys() <= written


def test_codes_are_recognised_and_in_alphabetical_order() -> None:
    assert [code for code in error_catalogue() if code_of(f"wrong [{code}]") != code] == []
    assert list(error_catalogue()) == sorted(error_catalogue())


def test_the_page_of_errors_is_current() -> None:
    """`star errors > docs/errors.md` updates it."""
    assert (ROOT / "docs" / "errors.md").read_text(encoding="utf-8") == page() + "\n"


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (StarError("no"), "no [invalid-argument]"),
        (InputError(["m.yaml: no", "n.yaml: no [file-not-found]"], "unreadable-file"),
         "m.yaml: no [unreadable-file]\nn.yaml: no [file-not-found]"),
        (PluginError("no", code="missing-package"), "no [missing-package]"),
        (PluginError(f"planner 'x': {ContractError('no')}"), "planner 'x': no [contract-broken]"),
    ],
)  # fmt: skip
def test_an_error_ends_with_its_code_and_keeps_that_of_another(error: StarError, text: str) -> None:
    assert str(error) == text
    assert error.code == code_of(text)


def test_brackets_of_a_message_are_no_code() -> None:
    assert coded("install star-swarm [radio]", "missing-package").endswith(" [missing-package]")
    assert coded("at [0, -1]", "out-of-range") == "at [0, -1] [out-of-range]"


def test_the_command_explains_a_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["errors", "file-not-found"]) == 0
    assert capsys.readouterr().out.startswith("There is no file of that name.\n")
    assert main(["errors", "file-not-fond"]) == 2
    assert "'file-not-found'? [unknown-code]" in capsys.readouterr().err
    assert main(["errors"]) == 0
    assert capsys.readouterr().out == page() + "\n"
