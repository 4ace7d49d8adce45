"""The files that ``star check`` checks: those named, and those in the folders that are named."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from star_core import InputError, Registry
from star_core.formats import STDIN, recognized_as

SKIPPED: Final = ("__pycache__", "node_modules", "venv")  # folders, beside hidden ones


def files_to_check(names: Sequence[str], registry: Registry, *, skip_others: bool) -> list[Path]:
    """Return the files to check, each once.

    Args:
        names: Files, shipped missions, folders that are searched for recognized files, or ``-``.
        registry: Of the formats that recognize files.
        skip_others: Leave out named files that no format recognizes, too.

    Raises:
        InputError: A name is empty, or a folder has no files that a format recognizes.
    """
    files: list[Path] = []
    for name in names:
        if not name:  # as of a variable of the shell that is not set; `Path` takes it for a folder
            raise InputError("the name of a file is empty", "invalid-argument")
        path = Path(name)
        if path.is_dir() and not (path / "manifest.json").exists():  # of a record
            inside = list(_inside(path, registry))
            if not (inside or skip_others):
                text = f"{path}: no file in this folder is a mission, a world or another to check"
                raise InputError(text, "file-not-found")
            files += inside
        elif path == STDIN or not skip_others or recognized_as(path, registry):
            files.append(path)
    return list(dict.fromkeys(files))


def _inside(folder: Path, registry: Registry) -> Iterator[Path]:
    """Yield a folder that is a mission of a format, and the recognized files of other formats."""
    whole = recognized_as(folder, registry)
    if whole is not None:
        yield folder
    for file in _walk(folder):
        if recognized_as(file, registry) not in {None, whole}:
            yield file


def _walk(folder: Path) -> Iterator[Path]:
    """Yield the files in a folder and in those below, by name, without hidden ones."""
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and name not in SKIPPED
        )
        yield from (Path(parent, name) for name in sorted(files) if not name.startswith("."))
