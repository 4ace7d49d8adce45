"""What the pages of flights and of studies share: one HTML file for screens, phones and paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files


def sheet(title: str, sections: Sequence[str], scripts: str) -> str:
    """Return a page with sections of HTML, and scripts at its end."""
    template = (files("star_report") / "template.html").read_text(encoding="utf-8")
    for mark, text in (
        ("{{title}}", escape(title)),
        ("{{body}}", "\n".join(sections)),
        ("{{scripts}}", scripts),
    ):
        template = template.replace(mark, text)
    return template


def footer(rows: Mapping[str, str]) -> str:
    """Return a section with how the flights were made."""
    cells = ""
    for name, text in rows.items():
        code = "<code>{}</code>" if name in {"command", "mission", "record"} else "{}"
        if text:
            cells += f"<div><dt>{escape(name)}</dt><dd>{code.format(escape(text))}</dd></div>"
    return f"<section><h2>How this was made</h2><dl class=made>{cells}</dl></section>"
