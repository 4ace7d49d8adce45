"""Output folders of commands, their arguments, and errors of files that cannot be written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from star_core.cli.run_folders import new_folder
from star_core.errors import InputError


def output_folder(out: str | None, name: str, marker: str) -> Path:
    """Return the folder that a command writes to and resumes; it is not created.

    Args:
        out: Value of ``--out``; None for a `new_folder`.
        name: Of the new folder.
        marker: File that an earlier run of the command has left in it.

    Raises:
        InputError: It is a file, or has other contents.
    """
    if out is None:
        return new_folder(name)
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {out}: is not a folder", "unwritable-file")
    if folder.exists() and any(folder.iterdir()) and not (folder / marker).is_file():
        wrong = f"--out {out}: contains other files (no {marker}); name another folder"
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


def positive_integer(text: str) -> int:
    """Return a number from 1 up, as a ``type`` for argparse."""
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


positive_integer.__name__ = "positive whole number"  # as argparse calls it
