"""Spoils files at random, as slips of the hand, of an editor, of the disk and of a link do."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

SCALAR = re.compile(r"(?<=[\[ ])[^\s\[\]{}#:,]+(?=[\],} \n])")
KEY = re.compile(r"\b[A-Za-z_]\w*(?=:)")
VALUES = (
    *(".nan", ".inf", "-1", "0", "0.0001", "1e308", "-1e308", "1e-308", "9" * 40, "2026-01-01"),
    *('""', "null", "true", "[]", "{}", "[1, 2]", "[[[]]]", "{a: 1}", "all", "cf1", "cf9", "../x"),
    *(
        "/",
        "$height",
        "'" + "x" * 5000 + "'",
        "\u5c71\U0001f681",
        '"\\ud83d"',
        "*a",
        "&a b",
        "!t x",
    ),
)
KEYS = (
    *("agents", "until", "timeout", "parallel", "repeat", "each", "include", "file", "to", "by"),
    *("path", "size", "spacing", "height", "use", "times", "steps", "start", "x", ""),
)
WORDS = (
    *(b"\0", b"\xff", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"\r\n", b"\n---\n"),
    *b"""
    18446744073709551615 null true [] {} '' [[0,0]] ../ / all cf9 use: agents: file: parallel:
    repeat: land:{} ' " | > % @ ` &a *a !b <<: --- # ? : , -
""".split(),
)

Draw = random.Random


def spoiled(content: bytes, draw: Draw) -> bytes:
    """Return what is left of a text file, one to four slips later."""
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        content = draw.choice(SLIPS)(content, draw)
    return content


def damaged(content: bytes, draw: Draw) -> bytes:
    """Return what is left of a binary file or stream, one to eight faults later."""
    for _ in range(draw.choice((1, 1, 2, 4, 8))):
        content = draw.choice(FAULTS)(content, draw)
    return content


def _text(slip: Callable[[str, Draw], str]) -> Callable[[bytes, Draw], bytes]:
    """Return a slip of text as one of bytes."""

    def changed(content: bytes, draw: Draw) -> bytes:
        return slip(content.decode("utf-8", "surrogateescape"), draw).encode(
            "utf-8", "surrogateescape"
        )

    return changed


def _lines(slip: Callable[[list[str], int, Draw], None]) -> Callable[[bytes, Draw], bytes]:
    """Return a slip with one of the lines of a text as one of bytes."""

    def changed(text: str, draw: Draw) -> str:
        if lines := text.split("\n"):
            slip(lines, draw.randrange(len(lines)), draw)
        return "\n".join(lines)

    return _text(changed)


def _without_line(lines: list[str], at: int, _draw: Draw) -> None:
    del lines[at]


def _line_twice(lines: list[str], at: int, draw: Draw) -> None:
    lines.insert(draw.randrange(len(lines)), lines[at])


def _lines_swapped(lines: list[str], at: int, draw: Draw) -> None:
    other = draw.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]


def _indented(lines: list[str], at: int, draw: Draw) -> None:
    bare = lines[at].lstrip()
    lines[at] = draw.choice(("", " ", "  ", "   ", "      ", "\t", " " * 60)) + bare


def _line_repeated(lines: list[str], at: int, _draw: Draw) -> None:
    lines[at:at] = [lines[at]] * 1000


def _replaced(pattern: re.Pattern[str], values: tuple[str, ...]) -> Callable[[bytes, Draw], bytes]:
    """Put one of some values in the place of what fits a pattern."""

    def changed(text: str, draw: Draw) -> str:
        if not (matches := list(pattern.finditer(text))):
            return text
        begin, end = draw.choice(matches).span()
        return text[:begin] + draw.choice(values) + text[end:]

    return _text(changed)


def _exchanged(pattern: re.Pattern[str]) -> Callable[[bytes, Draw], bytes]:
    """Put what fits a pattern in one place in the place of what fits it in another."""

    def changed(text: str, draw: Draw) -> str:
        if not (matches := list(pattern.finditer(text))):
            return text
        begin, end = draw.choice(matches).span()
        return text[:begin] + draw.choice(matches)[0] + text[end:]

    return _text(changed)


def _misspelt(text: str, draw: Draw) -> str:
    if not (keys := list(KEY.finditer(text))):
        return text
    at = draw.randrange(*draw.choice(keys).span())
    return text[:at] + draw.choice(("", text[at] * 2, text[at].upper(), "_", " ")) + text[at + 1 :]


def _characters_lost(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    return content[:at] + content[at + draw.choice((1, 1, 2, 10)) :]


def _bytes_put_in(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    return content[:at] + draw.randbytes(draw.choice((1, 2, 8))) + content[at:]


def _signs_put_in(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    return content[:at] + draw.choice(b"[]{}:,-#&*!|>'\"%@`? \n\t").to_bytes() + content[at:]


def _cut_off(content: bytes, draw: Draw) -> bytes:
    return content[: draw.randrange(len(content) + 1)]


def _moved(content: bytes, draw: Draw) -> bytes:
    begin = draw.randrange(len(content) + 1)
    piece = content[begin : begin + draw.randint(1, 40)]
    at = draw.randrange(len(content) + 1)
    return content[:at] + piece + content[at + draw.choice((0, len(piece))) :]


def _words_put_in(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    return content[:at] + draw.choice(WORDS) + content[at + draw.choice((0, 0, 1, 5, 20)) :]


def _bit_flipped(content: bytes, draw: Draw) -> bytes:
    if not content:
        return content
    at = draw.randrange(len(content))
    return content[:at] + bytes([content[at] ^ 1 << draw.randrange(8)]) + content[at + 1 :]


def _number_replaced(content: bytes, draw: Draw) -> bytes:
    """Put a number that is often not expected in the place of one, two, four or eight bytes."""
    size = draw.choice((1, 2, 4, 8))
    at = draw.randrange(len(content) + 1)
    number = draw.choice((0, 1, 1 << 8 * size - 1, (1 << 8 * size - 1) - 1, (1 << 8 * size) - 1))
    return content[:at] + number.to_bytes(size, "little") + content[at + size :]


def _block_lost(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    return content[:at] + content[at + draw.randrange(1, 2000) :]


def _block_zeroed(content: bytes, draw: Draw) -> bytes:
    at = draw.randrange(len(content) + 1)
    size = min(draw.randrange(1, 600), len(content) - at)
    return content[:at] + bytes(size) + content[at + size :]


FAULTS: tuple[Callable[[bytes, Draw], bytes], ...] = (
    _bit_flipped,
    _bit_flipped,
    _number_replaced,
    _number_replaced,
    _bytes_put_in,
    _characters_lost,
    _block_lost,
    _block_zeroed,
    _moved,
    _cut_off,
)
"""Each takes what a binary file holds, and returns it with one fault."""

SLIPS: tuple[Callable[[bytes, Draw], bytes], ...] = (
    _lines(_without_line),
    _lines(_line_twice),
    _lines(_lines_swapped),
    _lines(_indented),
    _lines(_line_repeated),
    _replaced(SCALAR, VALUES),
    _replaced(SCALAR, VALUES),
    _replaced(SCALAR, VALUES),
    _exchanged(SCALAR),
    _replaced(KEY, KEYS),
    _exchanged(KEY),
    _text(_misspelt),
    _characters_lost,
    _bytes_put_in,
    _signs_put_in,
    _words_put_in,
    _moved,
    _cut_off,
)
"""Each takes what a file holds, and returns it with one slip."""
