"""What a scalar of YAML 1.2 means, as far as JSON can hold it."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from star_core.errors import InputError

if TYPE_CHECKING:
    from ruamel.yaml.resolver import VersionedResolver

# What no text editor shows, or counts as the end of a line where another one does not.
ODD = re.compile(
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_LARGEST = 2**64 - 1  # the largest unsigned 64-bit number; float64 reaches beyond it
_LONGEST = len(f"-{_LARGEST}")


def plain(text: str) -> str | float | bool | None:
    """Return what a scalar without quotes means.

    Example:
        >>> plain("0.5"), plain("true"), plain("no"), plain("~"), plain("1e-3")
        (0.5, True, 'no', None, 0.001)

    Raises:
        InputError: It is a number that is not finite, too large or not written in plain decimals,
            or a date.
    """
    from ruamel.yaml.nodes import ScalarNode

    kind = str(_resolver().resolve(ScalarNode, text, (True, False))).rpartition(":")[2]
    if kind in {"int", "float"}:
        return _number(text)
    if kind == "timestamp":
        raise InputError([f"{_cut(text)} is a date; put it in quotes"])
    return {"null": None, "bool": text.lower() == "true"}.get(kind, text)


def quoted(text: str) -> str:
    """Return what a scalar in quotes, or a block of text, means.

    Raises:
        InputError: An escape stands for a character that cannot be printed.
    """
    try:  # JSON escapes a character beyond U+FFFF as a pair of surrogates
        text = text.encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError as error:
        raise InputError(["half of a pair of surrogates is refused"]) from error
    if found := ODD.search(text):
        raise InputError([odd(found.group())])
    return text


def odd(character: str) -> str:
    """Say that a character is refused."""
    return f"character {character!r} is refused; it cannot be printed"


def _number(text: str) -> float:
    """Return an integer as int and any other number as float.

    Raises:
        InputError: It is none that JSON could hold.
    """
    if _INTEGER.fullmatch(text):
        if len(text) <= _LONGEST and abs(int(text)) <= _LARGEST:
            return int(text)
        raise InputError([f"{_cut(text)} does not fit in 64 bits"])
    if _FLOAT.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    if _FLOAT.fullmatch(text) or "n" in text.lower():  # .nan and .inf
        raise InputError([f"{_cut(text)} is not a finite number"])
    raise InputError(
        [f"{_cut(text)} is not a plain decimal number; write it as one, or in quotes if it is text"]
    )


@cache
def _resolver() -> VersionedResolver:
    from ruamel.yaml.resolver import VersionedResolver

    return VersionedResolver((1, 2))


def _cut(text: str) -> str:
    """Return a number as it is written, or its beginning."""
    longest = 24
    return text if len(text) <= longest else text[:longest] + "..."
