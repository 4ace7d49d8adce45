"""Hooks of MkDocs: pages that are generated, and links to files outside of ``docs/``.

The pages in ``docs/`` are written to be read in the repository too, so their links lead to files
there. On the site these become pages of their own, so that it is complete without the repository.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from posixpath import dirname, join, normpath, relpath
from typing import TYPE_CHECKING, Final

from generated import generated_pages

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[2]
LINK: Final = re.compile(r"(?<=\]\()(?![a-z]+:|#)[^)#\s]+")
CODE: Final = re.compile(r"^( *)(```+).*?^\1\2", re.MULTILINE | re.DOTALL)
SPAN: Final = re.compile(r"`[^`\n]+`")  # in tables GitHub needs a backslash before a bar
FRONT: Final = re.compile(r"<!-- front -->\n(.*?)<!-- front -->", re.DOTALL)
INCLUDED: Final = "<!-- the front of README.md -->"
AREA: Final = re.compile(r"^\*([\w ]+)\.\*", re.MULTILINE)  # of a decision
IN_NAV: Final = "[](../CHANGELOG.md) [](../CONTRIBUTING.md) [](../examples) [](../missions)"
LANGUAGES: Final = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".json": "json"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, and those of files outside of ``docs/`` that pages link to."""
    from mkdocs.structure.files import File

    for uri, content in generated_pages():
        files.append(File.generated(config, uri, content=content))
    unread = [(page.src_uri, page.content_string) for page in files.documentation_pages()]
    unread += [("", IN_NAV), ("project/README.md", _front())]
    while unread:
        for path in _linked(*unread.pop()):
            uri = page_of(path)
            if files.get_file_from_path(uri) is None:
                unread.append((uri, _content(path)))
                files.append(File.generated(config, uri, content=unread[-1][1]))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links to files of the repository at their pages; show ``|`` in code in tables.

    The area of a decision leads to the others.
    """
    uri = page.file.src_uri
    if uri.startswith("decisions/0"):
        markdown = AREA.sub(
            lambda area: f"*[{area[1]}](index.md#{area[1].lower().replace(' ', '-')}).*", markdown
        )
    shown = _linking(uri, uri, SPAN.sub(lambda code: code[0].replace("\\|", "|"), markdown))
    return shown.replace(INCLUDED, _linking("project/README.md", uri, _front()))


def _linking(origin: str, uri: str, markdown: str) -> str:
    """Return text of the page `origin` with links that lead to pages from the page `uri`."""

    def replaced(found: re.Match[str]) -> str:
        path = _target(origin, found[0])
        return found[0] if path is None else relpath(page_of(path), dirname(uri))

    return LINK.sub(replaced, markdown)


def _front() -> str:
    """Return what README and the first page of the site have in common."""
    found = FRONT.search((ROOT / "README.md").read_text(encoding="utf-8"))
    return found[1] if found else ""


def page_of(path: str) -> str:
    """Return the page of a file of the repository.

    >>> page_of("docs/missions.md"), page_of("missions/search.yaml"), page_of("missions/worlds")
    ('missions.md', 'project/missions/search.yaml.md', 'project/missions/worlds/index.md')
    """
    if path.startswith("docs/"):
        page = path.removeprefix("docs/")
        return f"{page}/index.md" if (ROOT / path).is_dir() else page
    if (ROOT / path).is_dir():
        return f"project/{path}/index.md"
    if path.endswith("/README.md"):
        return f"project/{dirname(path)}/index.md"
    return f"project/{path}" if path.endswith(".md") else f"project/{path}.md"


def _target(uri: str, link: str) -> str | None:
    """Return the path in the repository that a page's link leads to, None if to no file there."""
    folder = dirname(uri)
    origin = folder.removeprefix("project").lstrip("/") if uri.startswith("project/") else None
    path = normpath(join("docs", folder, link) if origin is None else join(origin, link))
    return path if (ROOT / path).exists() else None


def _linked(uri: str, text: str) -> Iterator[str]:
    """Yield the files outside of ``docs/`` that a page links to."""
    for link in LINK.findall(CODE.sub("", text)):
        path = _target(uri, link)
        if path is not None and not path.startswith("docs/"):
            yield path


def _content(path: str) -> str:
    """Return the page of a file or folder that a page links to."""
    file = ROOT / path
    if (file / "README.md").is_file():
        file /= "README.md"
    if file.suffix == ".md":
        return file.read_text(encoding="utf-8")
    head = f"---\nsearch:\n  exclude: true\n---\n\n# `{path}`\n\n"
    if file.is_dir():
        entries = sorted(entry for entry in file.iterdir() if entry.is_file())
        return head + "".join(
            f"- [{entry.name}]({entry.name})\n"
            if entry.suffix in LANGUAGES
            else f"- `{entry.name}`\n"
            for entry in entries
        )
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".ipynb":
        return head + "\n".join(_cells(text))
    return f"{head}````{LANGUAGES.get(file.suffix, 'text')}\n{text}````\n"


def _cells(notebook: str) -> Iterator[str]:
    """Yield the cells of a notebook as Markdown, without their outputs."""
    for cell in json.loads(notebook)["cells"]:
        text = "".join(cell["source"])
        yield f"```python\n{text}\n```\n" if cell["cell_type"] == "code" else f"{text}\n"
