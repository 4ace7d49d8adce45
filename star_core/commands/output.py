"""Output of commands: folders, errors of files that cannot be written, reports; arguments."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from star_core.errors import InputError, StarError

if TYPE_CHECKING:
    import argparse

    from star_core.plugin_support.registry import Registry
    from star_core.toolkit import WrittenReport

RUNS = Path("runs")


def new_folder(name: str) -> Path:
    """Return ``runs/TIME-NAME``, or with a number if that exists; it is not created."""
    return next(folder for folder in _new_folders(name) if not folder.exists())


@contextmanager
def reserving(name: str) -> Iterator[Path]:
    """Create a `new_folder`, which no other process has then; remove it if it stays empty.

    Raises:
        InputError: It cannot be created.
    """
    for folder in _new_folders(name):
        with writing(folder), suppress(FileExistsError):
            folder.mkdir(parents=True)
            break
    try:
        yield folder
    finally:
        with suppress(OSError):  # it has files
            folder.rmdir()


def _new_folders(name: str) -> Iterator[Path]:
    """Yield ``runs/TIME-NAME``, then the same with numbers."""
    first = RUNS / f"{time.strftime('%Y-%m-%dT%H%M%S')}-{name}"
    yield first
    for number in count(2):
        yield first.with_name(f"{first.name}-{number}")


def output_folder(out: str | None, name: str, marker: str) -> Path:
    """Return the folder that a command writes to and resumes; it is not created.

    Args:
        out: Value of ``--out``; None for a `new_folder`.
        name: Of the new folder.
        marker: File that an earlier run of the command has left in it.

    Raises:
        InputError: It is a file, or has other contents, or links, which a file of others may be.
    """
    if out is None:
        return new_folder(name)
    folder = Path(out)
    if not folder.exists():
        return folder
    if not folder.is_dir():
        raise InputError(f"--out {out}: is not a folder", "unwritable-file")
    contents = [*folder.iterdir()]
    if contents and not (folder / marker).is_file():
        wrong = f"--out {out}: contains other files (no {marker}); name another folder"
        raise InputError(wrong, "unwritable-file")
    if links := [each.name for each in contents if each.is_symlink()]:
        wrong = f"--out {out}: {links[0]!r} is a link; name a folder whose files are its own"
        raise InputError(wrong, "unwritable-file")
    return folder


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Report an `OSError` raised inside, but for a closed pipe, as a path that cannot be written.

    Raises:
        InputError: With the path and the reason.
    """
    try:
        yield
    except BrokenPipeError:  # the reader of the output has gone
        raise
    except OSError as error:
        wrong = f"{path}: cannot be written: {error.strerror or error}"
        raise InputError(wrong, "unwritable-file") from error


def replace_file(path: Path, text: str) -> None:
    """Write a file atomically; a link in its position is replaced, not followed.

    Raises:
        OSError: It cannot be written.
    """
    new = path.with_name(f"{path.name}.new")
    new.unlink(missing_ok=True)
    with new.open("x", encoding="utf-8") as file:
        file.write(text)
    new.replace(path)


def write_report(folder: Path, registry: Registry) -> tuple[str, WrittenReport | None]:
    """Write the report of a run or a study; return a line with its file, or why there is none."""
    try:
        report: WrittenReport | None = registry.manager.hook.star_report(
            folder=folder, registry=registry
        )
    except StarError as error:
        return f"no report: {error.message}", None
    if report is None:
        return "no report: no installed plugin writes one", None
    return f"report: {report.page}", report


def add_set_option(line: argparse.ArgumentParser) -> None:
    """Add the option ``--set``: values that are set in the mission before it is checked."""
    line.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="set a value of the mission: avoider.radius=0.3, transport=radio",
    )


def positive_integer(text: str) -> int:
    """Return a number from 1 up, as a ``type`` for argparse."""
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


positive_integer.__name__ = "positive whole number"  # as argparse calls it
