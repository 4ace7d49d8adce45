"""The documentation says what the code does."""

import re
from pathlib import Path

import pytest

from star_core import hookspecs
from star_core.cli import parser
from star_core.registry import Registry

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_every_hook_has_a_heading_with_its_arguments() -> None:
    hooks = {name: f for name, f in vars(hookspecs).items() if name.startswith("star_")}
    arguments = {n: f.__code__.co_varnames[: f.__code__.co_argcount] for n, f in hooks.items()}
    expected = {f"{name}({', '.join(args)})" for name, args in arguments.items()}
    page = (ROOT / "docs" / "hooks.md").read_text()
    assert expected == set(re.findall(r"^## `(.+)`$", page, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_between_pages_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text())
    missing = [link for link in links if not (page.parent / link).exists()]
    assert missing == []


def test_every_command_of_the_readme_parses() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    lines = [line.split("#")[0].split() for block in blocks for line in block.splitlines()]
    commands = [words for words in lines if words and words[0] in {"star", "star-run"}]
    assert len(commands) >= 6
    added = Registry().names("command")
    for name, *arguments in commands:
        if arguments[0] not in added:
            parser().parse_args(arguments if name == "star" else ["run", *arguments])
        assert all((ROOT / word).is_file() for word in arguments if word.startswith("missions/"))
