"""The documentation site: builds without a warning, and refers to nothing outside of itself."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from star_core.plugin_support.registry import Registry
from star_core.plugin_support.specs import MissionSpec

ROOT = Path(__file__).parents[1]
QUICKLY = {"SITE_SEARCH": "false", "SITE_COLORS": "false"}  # a fifth of the time


class Links(HTMLParser):
    """Collects what a page loads and links to, and its anchors."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values.get("id", ""), values.get("name", "")}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        elif tag != "a":
            self.loaded += [values[name] for name in ("src", "href") if name in values]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"} | QUICKLY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Links]:
    return {page: Links(page) for page in site.rglob("*.html") if page.name != "404.html"}


@pytest.mark.extended
def test_no_page_loads_anything_from_another_server(site: Path, pages: dict[Path, Links]) -> None:
    loaded = {url for page in pages.values() for url in page.loaded}
    assert {url for url in loaded if re.match(r"(https?:)?//", url)} == set()
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", sheet.read_text()), sheet
    assert not any('class="mermaid"' in page.read_text() for page in pages)  # loads its script


@pytest.mark.extended
def test_every_link_and_anchor_leads_somewhere(pages: dict[Path, Links]) -> None:
    missing = []
    for page, content in pages.items():
        for link in content.links:
            if re.match(r"[a-z]+:", link):
                continue
            path, anchor = urldefrag(unquote(link))
            target = (page.parent / path).resolve() if path else page
            anchors = pages[target].anchors if target in pages else set()
            if not target.exists() or (anchor and target in pages and anchor not in anchors):
                missing.append(f"{page.name}: {link}")
    assert missing == []


def test_generated_sections_of_pages_are_up_to_date(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs" / "site")
    made = runpy.run_path(str(ROOT / "docs" / "site" / "committed.py"))
    assert made["PICTURE"].read_text() == made["diagram"]()
    assert made["TABLES"].read_text() == made["tables"]()
    assert len(made["PAGES"]) > 8
    for page in made["PAGES"]:
        assert made["with_examples"](page.read_text()) == page.read_text(), page.name


@pytest.mark.extended
def test_every_option_of_every_plugin_is_described(site: Path) -> None:
    missing = []
    for kind, plugin in Registry():
        if isinstance(plugin.offer, MissionSpec):
            name = "verbs" if kind == "task" else f"{kind}s"
            page = (site / "reference" / f"{name}.html").read_text()
            section = page.partition(f'id="{plugin.offer.name}"')[2].partition("<h2")[0]
            options = plugin.offer.options.get("properties", {})
            missing += [
                f"{name}: {option}" for option in options if f"<code>{option}</code>" not in section
            ]
            values = (" | ".join(o["enum"]) for o in options.values() if "enum" in o)
            missing += [
                f"{name}: {value}" for value in values if f"<td>{value}</td>" not in section
            ]
    assert missing == []


@pytest.mark.extended
def test_every_public_name_is_in_the_reference(site: Path) -> None:
    import star_core
    from star_core import commands, formats, testing, toolkit

    public = star_core, toolkit, commands, formats, testing
    names = [name for module in public for name in module.__all__]
    text = "".join(page.read_text() for page in (site / "reference" / "api").glob("*.html"))
    missing = [n for n in names if not re.search(rf'id="star_core[\w.]*\.{n}"', text)]
    assert missing == ["hookimpl"]  # pluggy's
