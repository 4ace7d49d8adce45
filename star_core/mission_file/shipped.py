"""Missions, studies and worlds that come with STAR, found by their names."""

from __future__ import annotations

from functools import cache
from itertools import takewhile
from pathlib import Path

from star_core.errors import InputError, suggestion


@cache
def shipped() -> dict[str, Path]:
    """Return the files by name: ``first_flight``, ``studies/avoiders``, ``worlds/lab_4x4``."""
    packaged = Path(__file__).parents[1] / "missions"
    folder = packaged if packaged.is_dir() else Path(__file__).parents[2] / "missions"
    files = [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*/*.yaml"))]
    return {file.relative_to(folder).with_suffix("").as_posix(): file for file in files}


def named(path: Path) -> Path:
    """Return the path of a file that a user names: `path`, or else the shipped file of that name.

    Raises:
        InputError: There is neither.
    """
    if path.exists() or path.is_absolute():
        return path
    files = shipped()
    if path.as_posix() in files:
        return files[path.as_posix()]
    if path.suffix and path.stem not in files:  # reading it states the reason
        return path
    if path.suffix:
        text = f"{path}: no such file; {path.stem!r}, without a suffix, comes with STAR"
        raise InputError(text, "file-not-found")
    hint = suggestion(path, files) or "; `star missions` lists those that come with STAR"
    raise InputError(f"{path}: no file and no mission of that name{hint}", "unknown-mission")


def description(file: Path) -> str:
    """Return the first sentence of the comment at the top of a file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comments = [line[1:].strip() for line in takewhile(lambda line: line.startswith("#"), lines)]
    text = " ".join(line for line in comments if not line.startswith("yaml-language-server"))
    return text.partition(". ")[0].removesuffix(".")
