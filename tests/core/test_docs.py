"""The documentation agrees with the code."""

import re
from pathlib import Path

import pytest

import star_core
from star_core.plugin_support import hookspecs

ROOT = Path(__file__).parents[2]
CLASSES = {name for name in star_core.__all__ if name[0].isupper()}
SOURCE_FOLDERS = ("star_core", "plugins", "schemas", "benchmarks", "docs/site", "tests")
SOURCES = {".py", ".json", ".toml", ".tmpl"}
OTHERS = {  # names of other libraries, and files that are not code
    *("PPoly", "Polynomial", "RadioDriver", "UdpDriver", "cKDTree", "mem", "solvePnP", "toc"),
    "mkdocs.yml",
}
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_the_table_of_hooks_has_every_hook_with_its_arguments() -> None:
    hooks = {name: f for name, f in vars(hookspecs).items() if name.startswith("star_")}
    arguments = {n: f.__code__.co_varnames[: f.__code__.co_argcount] for n, f in hooks.items()}
    page = (ROOT / "docs" / "write-a-plugin.md").read_text()
    assert re.findall(r"^\| `(star_.+?)` \|", page, re.MULTILINE) == [
        f"{name}({', '.join(args)})" for name, args in arguments.items()
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_attributes_that_a_page_names_exist(page: Path) -> None:
    named = re.findall(r"\b(\w+)\.(\w+)", " ".join(re.findall(r"`([^`\n]+)`", page.read_text())))
    attributes = [(getattr(star_core, owner), name) for owner, name in named if owner in CLASSES]
    missing = [
        f"{owner.__name__}.{name}"
        for owner, name in attributes
        if not hasattr(owner, name)
        and name not in getattr(owner, "__annotations__", ())
        and f"``{name}(" not in str(owner.__doc__)  # a method that a plugin need not have
    ]
    assert missing == []


def test_the_readme_is_short_and_its_mission_can_be_flown() -> None:
    page = (ROOT / "README.md").read_text()
    (mission,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    lines = (ROOT / "missions" / "hello.yaml").read_text().splitlines(keepends=True)
    assert mission == "".join(line for line in lines if not line.startswith("#"))
    assert len(page.splitlines()) <= 90
    picture = ROOT / "docs" / "pictures" / "view.webp"
    assert picture.stat().st_size <= 2_000_000
    assert b"ANIM" in picture.read_bytes()[:100]


def test_every_name_of_code_in_the_architecture_exists() -> None:
    page = "\n".join(path.read_text() for path in (ROOT / "docs" / "architecture.md", *DECISIONS))
    names = set(re.findall(r"`([^`\n]+)`", re.sub(r"(?s)```.*?```", "", page))) - OTHERS
    sources = [path for top in SOURCE_FOLDERS for path in (ROOT / top).rglob("*")]
    paths = [f"/{path.relative_to(ROOT)}" for path in sources]
    texts = (path.read_text() for path in sources if path.suffix in SOURCES)
    words = {path.stem for path in sources}.union(*(re.findall(r"\w+", text) for text in texts))
    files = {name for name in names if re.fullmatch(r"[\w./-]+\.py", name)}
    assert {name for name in files if not any(p.endswith(f"/{name}") for p in paths)} == set()
    codes = {name for name in names - files if re.fullmatch(r"[A-Za-z_][\w.]*", name)}
    assert {name for name in codes if name.split(".")[-1] not in words} == set()


def test_decisions_are_numbered_once_and_name_their_areas() -> None:
    numbers = [path.name[:5] for path in DECISIONS]
    assert [n for n in numbers if numbers.count(n) > 1 or not re.fullmatch(r"\d{4}-", n)] == []
    head = re.compile(r"# \S.*\n\n\*[A-Z][a-z ]+\.\*")
    assert [path.name for path in DECISIONS if head.match(path.read_text()) is None] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_between_pages_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text())
    missing = [link for link in links if not (page.parent / link).exists()]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_to_another_site_is_an_address(page: Path) -> None:
    links = re.findall(r"\]\((http[^)]*)\)", page.read_text())
    wrong = [
        link for link in links if not re.fullmatch(r"https://[\w.-]+\.[a-z]+(/[\w./#~-]*)?", link)
    ]
    assert wrong == []
