"""Frames of CPX, the protocol between the processors of a Crazyflie, as they go over TCP.

A frame is a u16 with the length of what follows, two bytes of routing and the data, little endian:
``RSV:1 LP:1 source:3 destination:3`` and ``version:2 function:6``, LP saying that no packet of the
same message follows (Bitcraze, crazyflie-firmware and cflib.cpx).
"""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
import threading
from collections import deque
from contextlib import suppress
from enum import IntEnum
from typing import Final, NamedTuple, Self

from star_core import PluginError

MTU: Final = 1022  # bytes after the length, the most that the AI-deck's ESP32 carries
ROUTING: Final = 2  # bytes
ROOM: Final = MTU - ROUTING  # for data
VERSION: Final = 0
LAST: Final = 0x40

_HEAD: Final = struct.Struct("<HBB")
_LENGTH: Final = 2  # bytes of the length itself


class Target(IntEnum):
    """Source or destination of a packet."""

    STM32 = 1
    ESP32 = 2
    HOST = 3
    GAP8 = 4


class Function(IntEnum):
    """What a packet is about."""

    SYSTEM = 1
    CONSOLE = 2
    CRTP = 3
    WIFI_CTRL = 4
    APP = 5
    TEST = 14
    BOOTLOADER = 15


class Packet(NamedTuple):
    """One packet and its routing, with at most `ROOM` bytes; `last` of its message or not."""

    source: Target
    destination: Target
    function: Function
    data: bytes
    last: bool = True


class SyncError(Exception):
    """The stream has an invalid frame length, so synchronisation is lost."""


def encode(packet: Packet) -> bytes:
    """Return the frame of a packet.

    Example:
        >>> encode(Packet(Target.HOST, Target.STM32, Function.SYSTEM, bytes([0x21, 1]))).hex(" ")
        '04 00 59 01 21 01'
    """
    routing = packet.source << 3 | packet.destination | (LAST if packet.last else 0)
    return _HEAD.pack(ROUTING + len(packet.data), routing, packet.function) + packet.data


class Decoder:
    """Takes a stream apart as it comes, in pieces of any size.

    Frames with a version, a function or a target that there is not are passed over.
    """

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that `data` completes.

        Raises:
            SyncError: A frame has an invalid length. Packets before it are lost too; the next
                `feed` starts a new stream.
        """
        stream, at, packets = self._rest + data, 0, []
        self._rest = b""
        while len(stream) - at >= _LENGTH:
            (length,) = struct.unpack_from("<H", stream, at)
            if not ROUTING <= length <= MTU:
                wrong = f"frame of {length} bytes, expected {ROUTING} to {MTU}"
                raise SyncError(wrong)
            end = at + _LENGTH + length
            if len(stream) < end:
                break
            packet = _packet(stream[at + _LENGTH : end])
            if packet is not None:
                packets.append(packet)
            at = end
        self._rest = stream[at:]
        return packets


def _packet(frame: bytes) -> Packet | None:
    """Return the content of a frame without its length; None if it is invalid."""
    routing, function = frame[:ROUTING]
    try:
        return Packet(
            Target(routing >> 3 & 7),
            Target(routing & 7),
            Function(function),  # with the version in its upper bits: 0
            frame[ROUTING:],
            bool(routing & LAST),
        )
    except ValueError:
        return None


CHUNK: Final = 65_536  # bytes to read at a time
SEND_BUFFER: Final = 80_000  # bytes, about an image, for the kernel to buffer (Linux doubles it)
BACKLOG: Final = 8  # clients that may wait for the first one to disconnect
CLOSE_TIMEOUT: Final = 1.0  # s

log = logging.getLogger(__name__)


class Switchboard:
    """An event loop in its own thread, which serves any number of ports."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="aideck", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Disconnect all clients and end the thread. Safe to call twice."""
        if self._thread.is_alive():
            self.loop.call_soon_threadsafe(self.loop.stop)
            self._thread.join()

    def _run(self) -> None:
        try:
            self.loop.run_forever()
            self.loop.run_until_complete(self._end())
        finally:
            self.loop.close()

    async def _end(self) -> None:
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class TcpPort:
    """A listening port; a context manager that closes it.

    As on an AI-deck, a second client waits, connected, until the first has disconnected.

    Args:
        host: Address of the interface.
        port: Number; 0 for any that is free.
        max_waiting: Messages that may wait behind the one that is being sent.
        switchboard: Shared switchboard; the port has its own if not given.

    Attributes:
        address: Host and port on which it listens.

    Raises:
        PluginError: The port is not available.
    """

    def __init__(
        self, host: str, port: int, max_waiting: int, switchboard: Switchboard | None
    ) -> None:
        try:
            listener = socket.create_server((host, port), backlog=BACKLOG)
        except OSError as error:
            reason = str(error.strerror or error).partition(" (while")[0]  # without the port
            raise PluginError(
                f"cannot listen on {host}:{port}: {reason}", "address-in-use"
            ) from error
        self.address: tuple[str, int] = listener.getsockname()[:2]
        board = switchboard or Switchboard()
        self._own_board = None if board is switchboard else board
        self._loop = board.loop
        self._max_waiting = max_waiting
        self._waiting: deque[bytes] = deque()
        self._lock = threading.Lock()  # for the queue and the client
        self._client: socket.socket | None = None
        self._filled = asyncio.Event()
        self._ended = threading.Event()
        self._listener = listener
        listener.setblocking(False)  # noqa: FBT003 -- a positional-only argument
        self._serving = asyncio.run_coroutine_threadsafe(self._serve(), self._loop)

    @property
    def connected(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    def heard(self, packet: Packet) -> None:
        """Handle a packet of the client, in the switchboard's thread; an error disconnects it."""

    def put(self, message: bytes) -> bool:
        """Queue a message of whole frames, without waiting; without a client it is dropped.

        Returns whether an older message was dropped to make room.
        """
        with self._lock:
            if self._client is None:
                return False
            full = len(self._waiting) >= self._max_waiting
            if full:
                self._waiting.popleft()
            idle = not self._waiting
            self._waiting.append(message)
        if idle:
            with suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._filled.set)
        return full

    def hang_up(self) -> None:
        """Disconnect the client."""
        with self._lock, suppress(OSError):  # it has disconnected
            if self._client is not None:
                self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Disconnect the client and stop listening. Safe to call twice."""
        if self._serving.cancel():
            self._ended.wait(CLOSE_TIMEOUT)
        self._listener.close()
        if self._own_board is not None:
            self._own_board.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    async def _serve(self) -> None:
        """Serve one client after the other."""
        try:
            while True:
                await self._called()
                with suppress(OSError):  # gone again
                    client, _address = self._listener.accept()
                    with client:
                        await self._serve_client(client)
        finally:
            self._ended.set()

    async def _called(self) -> None:
        """Wait for a client; `loop.sock_accept` may leave one unclosed when it is cancelled."""
        called = asyncio.Event()
        self._loop.add_reader(self._listener, called.set)
        try:
            await called.wait()
        finally:
            self._loop.remove_reader(self._listener)

    async def _serve_client(self, client: socket.socket) -> None:
        client.setblocking(False)  # noqa: FBT003
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        with self._lock:
            self._client = client
        sending = self._loop.create_task(self._send(client))
        decoder = Decoder()
        try:
            while data := await self._loop.sock_recv(client, CHUNK):
                for packet in decoder.feed(data):
                    self.heard(packet)
        except SyncError as error:
            log.warning("%s:%d: client disconnected: %s", *self.address, error)
        except OSError:
            pass
        except Exception:
            log.exception("%s:%d: client disconnected", *self.address)
        finally:
            with self._lock:
                self._client = None
                self._waiting.clear()
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send(self, client: socket.socket) -> None:
        while True:
            await self._filled.wait()
            self._filled.clear()
            while message := self._next():
                await self._loop.sock_sendall(client, message)

    def _next(self) -> bytes | None:
        with self._lock:
            return self._waiting.popleft() if self._waiting else None
