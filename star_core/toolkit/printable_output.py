"""Output of commands in which no control character reaches the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import TYPE_CHECKING, Any, cast

from star_core.errors import StarError, printable

if TYPE_CHECKING:
    from typing import TextIO


class PrintableStream:
    """Writes text to a stream with its control characters escaped, line breaks excepted.

    Args:
        stream: A text stream; all that is not writing is its own.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text; return its length.

        Raises:
            StarError: It cannot be written: the disk is full, for example.
        """
        with written():
            self.stream.write(printable(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def written() -> Iterator[None]:
    """Report an `OSError` of a stream, but for a closed pipe, as output that cannot be written.

    Raises:
        StarError: With the reason.
    """
    try:
        yield
    except BrokenPipeError:  # what reads it has exited
        raise
    except OSError as error:
        raise StarError(f"output cannot be written: {error.strerror}", "unwritable-file") from error


@contextmanager
def printable_output() -> Iterator[None]:
    """Escape control characters of all that is printed, on stdout and stderr."""
    out, err = (cast("TextIO", PrintableStream(stream)) for stream in (sys.stdout, sys.stderr))
    with redirect_stdout(out), redirect_stderr(err):
        yield


def unescaped(stream: TextIO) -> TextIO:
    """Return the stream below, for output whose control characters are its own."""
    return stream.stream if isinstance(stream, PrintableStream) else stream


def escape_below_bars() -> None:
    """Escape what is printed while bars are shown, on streams that rich puts in front of these."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(getattr(stream, "rich_proxied_file", None), PrintableStream):
            setattr(sys, name, PrintableStream(stream))
