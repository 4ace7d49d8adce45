"""Readers of the sheets that were written, which know the formats and nothing of the writers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree as ET

import pytest

from tests.commands import command

main = command("tags")


Areas: TypeAlias = list[tuple[float, list[list[tuple[float, float]]]]]
"""Grey, and outlines in mm with y down from the upper left corner of the paper."""

Sheet: TypeAlias = tuple[tuple[float, float], Areas, list[str]]
"""Width and height of the paper in mm, what is drawn on it, and its texts."""

POINTS = 72 / 25.4  # in a millimetre


def of_pdf(file: bytes) -> Iterator[Sheet]:
    """The size in mm, the areas and the texts of each page, found through the file's own tables."""
    start = int(re.findall(rb"startxref\n(\d+)\n%%EOF\n$", file)[0])
    count = int(re.findall(rb"^xref\n0 (\d+)\n", file[start:])[0])
    table = re.findall(rb"(\d{10}) \d{5} n \n", file[start:])
    assert len(table) == count - 1
    objects = [file[int(offset) :].split(b"\nendobj\n")[0] for offset in table]
    assert all(o.startswith(b"%d 0 obj\n" % n) for n, o in enumerate(objects, start=1))
    (kids,) = re.findall(rb"/Kids \[(.*?)\]", objects[1])
    for kid in re.findall(rb"(\d+) 0 R", kids):
        page = objects[int(kid) - 1]
        _, _, width, height = map(float, re.findall(rb"/MediaBox \[(.*?)\]", page)[0].split())
        content = objects[int(re.findall(rb"/Contents (\d+)", page)[0]) - 1]
        length = int(re.findall(rb"/Length (\d+)", content)[0])
        stream = content.split(b"stream\n", 1)[1]
        assert stream[length:] == b"\nendstream"
        yield drawn(stream[:length].decode("cp1252"), width, height)


def drawn(stream: str, width: float, height: float) -> Sheet:
    """Execute the operators of a page; width and height are in points."""
    areas: Areas = []
    outlines: list[list[tuple[float, float]]] = []
    numbers: list[float] = []
    scale, grey = 1.0, 0.0
    texts = [t.replace("\\(", "(").replace("\\)", ")") for t in re.findall(r"\((.*)\) Tj", stream)]
    for word in re.sub(r"BT.*ET", "", stream).split():
        if re.fullmatch(r"[-+.\d]+", word):
            numbers.append(float(word))
            continue
        if word == "cm":
            scale, b, c, also, e, f = numbers
            assert (b, c, also, e, f) == (0, 0, scale, 0, 0)
        elif word == "g":
            (grey,) = numbers
        elif word in "ml":
            x, y = (value * scale / POINTS for value in numbers)
            if word == "m":
                outlines.append([])
            outlines[-1].append((x, height / POINTS - y))
        elif word == "f":
            areas.append((grey, outlines))
            outlines = []
        else:
            assert word == "h"
        numbers = []
    return (width / POINTS, height / POINTS), areas, texts


def of_svg(text: str) -> Sheet:
    root = ET.fromstring(text)  # noqa: S314 -- our own file
    width, height = (float(root.attrib[key].removesuffix("mm")) for key in ("width", "height"))
    assert [float(v) for v in root.attrib["viewBox"].split()] == [0, 0, width, height]
    areas: Areas = []
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        grey = float(re.findall(r"\d+", path.attrib["fill"])[0]) / 100
        outlines = [
            [(float(x), float(y)) for x, y in re.findall(r"([-.\d]+) ([-.\d]+)", part)]
            for part in path.attrib["d"].split("Z")[:-1]
        ]
        areas.append((grey, outlines))
    texts = [element.text or "" for element in root.iter("{http://www.w3.org/2000/svg}text")]
    return (width, height), areas, texts


@pytest.fixture
def sheets() -> Callable[..., list[Sheet]]:
    """Writes the sheets of a world as a file of that form and reads them back."""

    def written(world: Path, form: str, paper: str = "a4") -> list[Sheet]:
        out = world.with_suffix(f".{form}")
        assert main([str(world), "--out", str(out), "--paper", paper]) == 0
        if form == "pdf":
            return list(of_pdf(out.read_bytes()))
        files = sorted(world.parent.glob("*.svg"), key=lambda file: int(file.stem.split("-")[-1]))
        return [of_svg(file.read_text(encoding="utf-8")) for file in files]

    return written
