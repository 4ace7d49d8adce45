"""Targets: what drones and other programs send to a flight."""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from star_core import Frames, InputError, PluginError
from star_core.testing import scene
from star_external.protocol import read
from star_fleet.cpx import MTU, Decoder, Function, Packet, SyncError, encode
from star_fleet.cpx import Target as Processor
from star_fleet.packet import Port, join
from star_fleet.server import Fleet
from star_fleet.variables import VARIABLES
from star_radio import orders
from star_radio.connection import packets
from star_radio.connection.link import Link
from star_radio.connection.questions import Question
from star_radio.connection.tables import Entry, Table, Tables, setting
from star_radio.report import BLOCK, Layout
from star_radio.report_stream import MAX_BUFFERED_REPORTS
from star_radio.telemetry import TelemetryBuffer
from star_radio.vehicle import Vehicle
from tests.fuzz.harness import Draw, Target, Try
from tests.fuzz.mutants import damaged, spoiled
from tests.fuzz.vehicles import GOOD
from tests.simulators import ideal_fleet

MAX_TIMEOUT: Final = 60.0  # s, of an answer, whatever was heard
ALTERED: Final = 0.02  # of the answers
LONG: Final = 64  # bytes of a datagram that are received


class Sink:
    """A driver that keeps nothing."""

    def send(self, packet: bytes) -> None:
        assert 1 <= len(packet) <= 1 + packets.MAX_PAYLOAD

    steer = send

    def close(self) -> None:
        pass


@contextmanager
def answers(_folder: Path) -> Iterator[Try]:
    """Packets of a drone: answers to open questions, reports and echoes."""
    fleet = ideal_fleet(scene(1))
    try:
        heard = [answer for packet in GOOD for answer in fleet.handle(0, packet)]
    finally:
        fleet.close()
    table: Table = {entry.name: Entry(i, entry.code) for i, entry in enumerate(VARIABLES)}
    link = Link("udp://127.0.0.1:1", "cf1")
    link._driver = Sink()
    vehicle = Vehicle("cf1", link)
    vehicle.version, vehicle.stream.layout = 12, Layout.of(table)
    size = vehicle.stream.layout.size
    link.report = vehicle.stream._take
    telemetry, began, number = TelemetryBuffer([vehicle]), time.monotonic(), 0

    def packet_of(draw: Draw, now: float) -> bytes:
        report = bytes([BLOCK]) + (1000 + number).to_bytes(3, "little") + draw.randbytes(size - 4)
        good = [*[join(Port.LOG, 2, report)] * 9, packets.echo(now - 0.01), *heard]
        packet = draw.choice(good) if draw.random() < 0.7 else draw.randbytes(30)
        return packet if draw.random() < 0.3 else damaged(packet, draw)[:LONG] or b"\0"

    def attempt(draw: Draw) -> str:
        nonlocal number
        number, now = number + 1, time.monotonic()
        if number % 10 == 0:
            packet = draw.choice((orders.takeoff(0.8, 2.0), orders.land(0.0, 2.0), orders.stop()))
            vehicle.order(packet, "take off")
            vehicle.arm()
        link.hear(packet_of(draw, now), now)
        vehicle.retry(now + 10.0 * (number % 50 == 0))
        timeout = link._answers.timeout
        assert 0 <= timeout <= MAX_TIMEOUT, timeout
        assert len(vehicle.stream._samples) <= MAX_BUFFERED_REPORTS
        assert len(link._answers._open) < 10
        if number % 20 == 0:
            told = telemetry.gather(began, Frames.none())
            assert told.position.shape == (1, 3)
            assert math.isfinite(told.time)
        return "report" if vehicle.stream.heard == now else "other"

    yield attempt


class Altered:
    """A drone some of whose answers are altered on their way.

    Attributes:
        draw: Alters the answers; None leaves them as they are.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self.draw: Draw | None = None

    def ask(self, questions: Sequence[Question]) -> list[bytes]:
        return [self._answer(question) for question in questions]

    def _answer(self, question: Question) -> bytes:
        answer = self._fleet.handle(0, question.packet)[0]
        if self.draw is not None and self.draw.random() < ALTERED:
            answer = damaged(answer, self.draw)[:LONG]
        if not answer[1:].startswith(question.start):
            raise PluginError("no answer", "no-answer")
        return answer[1:]


@contextmanager
def tables(folder: Path) -> Iterator[Try]:
    """Tables of contents of a drone that answers wrongly, and those that are cached."""
    fleet = ideal_fleet(scene(1))
    drone = Altered(fleet)

    def attempt(draw: Draw) -> str:
        drone.draw = draw if draw.random() < 0.5 else None
        port = draw.choice((packets.LOG, packets.PARAMETER))
        with TemporaryDirectory(dir=folder) as name:
            cache = Path(name)
            try:
                Tables(cache).of(port, drone.ask)
                (file,) = cache.iterdir()
                file.write_bytes(damaged(file.read_bytes(), draw))
                _use(Tables(cache).of(port, drone.ask), port)
            except (PluginError, IndexError, struct.error):  # reported with the drone's name
                return "refused"
        return "read"

    try:
        yield attempt
    finally:
        fleet.close()


def _use(table: Table, port: int) -> None:
    if port == packets.LOG:
        layout = Layout.of(table)
        assert layout.variables(table)
    else:
        for name in ("stabilizer.controller", "locSrv.extPosStdDev"):
            setting(table, name, 1.0)


@contextmanager
def cpx(_folder: Path) -> Iterator[Try]:
    """A stream of CPX frames to a simulated deck, in pieces."""
    whole = b"".join(
        encode(Packet(Processor.HOST, Processor.STM32, Function.CRTP, packet)) for packet in GOOD
    )
    decoder = Decoder()

    def attempt(draw: Draw) -> str:
        nonlocal decoder
        stream, packets = damaged(whole, draw), 0
        try:
            while stream:
                size = draw.choice((1, 2, 3, 50, 2000))
                packets += len(decoder.feed(stream[:size]))
                assert len(decoder._rest) < MTU + 2
                stream = stream[size:]
        except SyncError:
            decoder = Decoder()  # the client is disconnected
            return "disconnected"
        return "packets" if packets else "nothing"

    yield attempt


@contextmanager
def lines(_folder: Path) -> Iterator[Try]:
    """Lines of the program that the verb `external` listens to."""
    room = scene(2)
    goal = {"position": [1.0, 0.0, 0.8], "velocity": [0.1, 0, 0], "yaw": 0.5, "speed": 0.3}
    good = [
        json.dumps(message).encode()
        for message in ({"goals": {"cf1": goal, "cf2": goal}}, {"done": True}, {"fail": "no way"})
    ]

    def attempt(draw: Draw) -> str:
        line = draw.choice((spoiled, damaged))(draw.choice(good), draw)
        try:
            read(line, room, ["cf1", "cf2"])
        except InputError as error:
            return f"refused: {error.code}"
        return "read"

    yield attempt


TARGETS: Final = (
    Target("packets of a drone", 2_000, 100_000, answers),
    Target("tables of a drone", 15, 2_000, tables),
    Target("CPX stream", 200, 20_000, cpx),
    Target("lines of an external program", 300, 50_000, lines),
)
