"""Fuzzing of readers that take bytes, guided by coverage.

``python -m tests.fuzz.guided_fuzzing READER`` tries inputs until one breaks the reader. It needs
atheris (``pip install atheris``), which has wheels for few platforms, and so is no dependency.
Further arguments are libFuzzer's, such as ``-max_total_time=60`` and a folder for the inputs that
reached new code.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

import atheris

READ_BY: Final = ["ruamel.yaml", "star_core", "star_external", "star_fleet", "star_radio"]

with atheris.instrument_imports(include=READ_BY):
    import ruamel.yaml  # noqa: F401 -- `parse` imports it when it is called

    from star_core import InputError
    from star_core.testing import scene
    from star_external.protocol import read
    from star_fleet.cpx import MTU, Decoder, SyncError
    from star_radio.camera.stream import Counts, Stream
    from star_radio.connection.link import Link
    from star_radio.report import BLOCK, SOURCES, Layout
    from star_radio.vehicle import Vehicle
    from star_yaml.yaml_reader import parse

SHAPE: Final = (8, 16)
ROOM: Final = scene(2)
LAYOUT: Final = Layout(tuple(sources[0] for sources in SOURCES))  # of reports
MAX_TIMEOUT: Final = 60.0  # s


def yaml(data: bytes) -> None:
    """Text of a YAML file."""
    with suppress(InputError):
        parse(data.decode("utf-8", "replace"), "m.yaml")


def external(data: bytes) -> None:
    """A line of an external program."""
    with suppress(InputError):
        read(data, ROOM, ["cf1", "cf2"])


def cpx(data: bytes) -> None:
    """A stream of CPX frames, in two pieces."""
    decoder = Decoder()
    with suppress(SyncError):
        for piece in (data[: len(data) // 2], data[len(data) // 2 :]):
            decoder.feed(piece)
            assert len(decoder._rest) < MTU + 2


def camera(data: bytes) -> None:
    """A stream of images, in two pieces."""
    stream = Stream(SHAPE, Counts())
    for piece in (data[: len(data) // 2], data[len(data) // 2 :]):
        stream.feed(piece, 0.0)
        assert len(stream._rest) < MTU + 2


def crtp(data: bytes) -> None:
    """Packets of a drone, each after its length."""
    link = Link("udp://127.0.0.1:1", "cf1")
    vehicle = Vehicle("cf1", link)
    vehicle.stream.layout = LAYOUT
    link.report = vehicle.stream._take
    vehicle.arm()
    now = 1.0
    while data:
        length, now = 1 + data[0] % 31, now + 0.01
        packet, data = data[1 : 1 + length], data[1 + length :]
        link.hear(packet or bytes([BLOCK]), now)
        assert 0 <= link._answers.timeout < MAX_TIMEOUT
    vehicle.retry(now)


READERS: Final[dict[str, Callable[[bytes], None]]] = {
    reader.__name__: reader for reader in (yaml, external, cpx, camera, crtp)
}


def main() -> None:
    name, *rest = sys.argv[1:] or [""]
    if name not in READERS:
        sys.exit(f"usage: guided_fuzzing.py {{{','.join(READERS)}}} [OPTIONS] [FOLDER]")
    fuzzer: Any = atheris
    fuzzer.Setup([sys.argv[0], *rest], READERS[name])
    fuzzer.Fuzz()


if __name__ == "__main__":
    main()
