"""Streaming of AI-decks over loopback: what is lost, what it costs, and how soon a deck is back.

``python benchmarks/aideck.py`` prints a table, with ``--json`` one JSON object. AiDecks and clients
share this process. The peer is cflib's own reader of the same stream, ``cflib.cpx.CPX``, with the
image put together from its packets; both read the same images as fast as they can, in turns.
"""

from __future__ import annotations

import contextlib
import io
import statistics
import struct
import time

import numpy as np
from printed import command_line, show

from star_core import Image
from star_fleet.aideck import AideckServer
from star_fleet.cpx import Switchboard
from star_radio.camera.ai_decks import CameraClient

SHAPE = (244, 324)
SIZE = SHAPE[0] * SHAPE[1]
SECONDS = 10.0
ROUNDS, IMAGES = 5, 60
STREAMS = (  # name, decks, images a second, JPEG
    ("3_decks_15_hz", 3, 15.0, False),
    ("3_decks_15_hz_jpeg", 3, 15.0, True),
    ("30_decks_8_hz", 30, 8.0, False),
)
AWAY = np.linspace(1.5, 1.75, ROUNDS)  # s for which a deck is off: clients try every 0.25 s


def stream(decks: int, rate: float, *, jpeg: bool = False) -> tuple[float, float, float]:
    """Return the share of images lost, the greatest delay in ms and the share of one core used."""
    board = Switchboard()
    servers = [AideckServer(port=0, switchboard=board, jpeg=jpeg) for _ in range(decks)]
    clients = [CameraClient(*server.address) for server in servers]
    until(lambda: all(server.connected for server in servers))
    pictures = [np.full(SHAPE, value, np.uint8) for value in range(256)]
    sent, delays = 0, list[float]()
    published: dict[int, float] = {}
    begin, busy = time.monotonic(), time.process_time()
    while (now := time.monotonic()) < begin + SECONDS:
        if now >= begin + sent / rate:
            published[sent % 256] = now
            for server in servers:
                server.publish(pictures[sent % 256], now)
            sent += 1
        for client in clients:
            delays += [1e3 * (s.arrived - published[int(s.image[0, 0])]) for s in client.arrived()]
        time.sleep(0.002)
    load = (time.process_time() - busy) / SECONDS
    time.sleep(0.5)
    got = sum(client.counts.images - client.counts.dropped for client in clients)
    for client in clients:
        client.hang_up()
    for client in clients:
        client.close()
    board.close()
    return 1 - got / (sent * decks), max(delays), load


def back(away: float) -> float:
    """Return how long after a deck that was off for `away` s its client has an image again, s."""
    server = AideckServer(port=0)
    with CameraClient(*server.address) as client:
        client.reached(5.0)
        server.close()
        until(lambda: client.fault is not None)
        time.sleep(away)
        with AideckServer(port=server.address[1]) as again:
            begin = time.monotonic()

            def arrived() -> bool:
                again.publish(np.zeros(SHAPE, np.uint8), 0.0)
                return bool(client.arrived())

            until(arrived)
            return time.monotonic() - begin


def ours(images: list[Image]) -> float:
    """Return the processor time for an image, ms."""
    with AideckServer(port=0) as server, CameraClient(*server.address) as client:
        until(lambda: server.connected)
        busy = time.process_time()
        for image in images:
            server.publish(image, 0.0)
            until(client.arrived)
        return 1e3 * (time.process_time() - busy) / len(images)


def theirs(images: list[Image]) -> float:
    """Return the peer's processor time for an image, ms."""
    from cflib.cpx import CPX, CPXFunction
    from cflib.cpx.transports import SocketTransport

    with AideckServer(port=0) as server, contextlib.redirect_stdout(io.StringIO()):
        cpx = CPX(SocketTransport(*server.address))
        router = cpx._router  # noqa: SLF001 -- to wait for its end
        with contextlib.suppress(Exception):
            cpx.receivePacket(CPXFunction.APP, timeout=0.1)  # nothing is kept before this
        until(lambda: server.connected)
        busy = time.process_time()
        for image in images:
            server.publish(image, 0.0)
            head = cpx.receivePacket(CPXFunction.APP, timeout=5).data
            (size,) = struct.unpack("<I", head[7:])
            body = bytearray()
            while len(body) < size:
                body.extend(cpx.receivePacket(CPXFunction.APP, timeout=5).data)
            assert (np.frombuffer(body, np.uint8).reshape(SHAPE) == image).all()
        took = 1e3 * (time.process_time() - busy) / len(images)
        cpx.close()
        router.join(5)
    return took


def until(holds: object) -> None:
    """Wait until something holds."""
    assert callable(holds)
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.0005)


def main() -> None:
    """Measure and print."""
    options = command_line(__doc__).parse_args()
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, SHAPE, np.uint8) for _ in range(IMAGES)]
    pairs = [(ours(images), theirs(images)) for _ in range(ROUNDS)]
    figures: dict[str, float] = {
        "image_ms": statistics.median(mine for mine, _ in pairs),
        "image_over_cflib": statistics.median(mine / peer for mine, peer in pairs),
        "back_s": max(back(float(away)) for away in AWAY),
    }
    for name, decks, rate, jpeg in STREAMS:
        lost, delay, load = stream(decks, rate, jpeg=jpeg)
        figures |= {f"{name}_lost": lost, f"{name}_delay_ms": delay, f"{name}_load": load}
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
