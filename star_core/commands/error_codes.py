"""The catalogue of error codes, `error_codes.toml`: what each means and what to do about it.

Codes have lower-case words and at least one hyphen.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple


class Entry(NamedTuple):
    """One code: what it means and how to correct the error, a sentence each."""

    meaning: str
    remedy: str


@cache
def error_catalogue() -> dict[str, Entry]:
    """Return the entries by code."""
    import tomllib
    from importlib.resources import files

    text = (files("star_core.commands") / "error_codes.toml").read_text(encoding="utf-8")
    return {code: Entry(**entry) for code, entry in tomllib.loads(text).items()}
