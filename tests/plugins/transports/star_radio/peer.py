"""A scripted Crazyflie: it answers, reports and remembers."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import TracebackType
from typing import Any, Self

from tests.plugins.transports.star_radio.virtual import VirtualTime

LOG_TYPES = {1: "<B", 2: "<H", 3: "<I", 4: "<b", 5: "<h", 6: "<i", 7: "<f", 8: "<e"}
VALUES: dict[str, float] = {
    "stateEstimateZ.x": 0, "stateEstimateZ.y": 0, "stateEstimateZ.z": 0,
    "stateEstimateZ.vx": 0, "stateEstimateZ.vy": 0, "stateEstimateZ.vz": 0,
    "stateEstimate.roll": 0, "stateEstimate.pitch": 0, "stateEstimate.yaw": 0,
    "stateEstimateZ.rateYaw": 0, "pm.vbatMV": 4000, "supervisor.info": 15,
    "radio.rssi": 44,
}  # fmt: skip
PARAMETERS: dict[str, tuple[int, bytes]] = {
    "kalman.resetEstimation": (0x08, b"\0"),
    "locSrv.extPosStdDev": (0x06, struct.pack("<f", 0.01)),
    "locSrv.extQuatStdDev": (0x06, struct.pack("<f", 4.5e-3)),
    "ring.effect": (0x18, b"\6"),
    "system.selftestPassed": (0x48, b"\1"),
    "velCtlPid.vxKp": (0x06, struct.pack("<f", 25.0)),
    "motorPowerSet.enable": (0x08, b"\0"),
}


LINK_TIMEOUT = 1.0  # s without a packet, after which log blocks are deleted


class Peer:
    """One Crazyflie, as far as a client can tell.

    Args:
        uri: Its address.
        version: Of the protocol.
        lacks: Log variables and parameters that its firmware does not have.

    Attributes:
        values: What it reports, in the firmware's units, by log variable.
        got: Every packet that came but echoes, header masked, oldest first.
        echoes: How many of those came.
        mute: Set to say nothing more.
        lose: How many answers to packets that begin like that get lost.
        delay: Time that each packet takes to the client, s.
        errors: Error numbers with which to answer high-level orders, by command.
        boot: Its clock's lead, s.
    """

    def __init__(self, uri: str = "", *, version: int = 12, lacks: tuple[str, ...] = ()) -> None:
        self.uri = uri
        self.version = version
        self.values = {name: value for name, value in VALUES.items() if name not in lacks}
        self.parameters = {k: v for k, v in PARAMETERS.items() if k not in lacks}
        self.stored = {name: value for name, (_kind, value) in self.parameters.items()}
        self.got: list[bytes] = []
        self.echoes = 0
        self.mute = threading.Event()
        self.lose: Counter[bytes] = Counter()
        self.delay = 0.0
        self.errors: dict[int, list[int]] = {}
        self.refuses_block = 0
        self.memory = bytearray(4096)
        self.boot = 3.0
        self._packet_at = 0.0  # s, when the last packet came
        self._blocks: dict[int, list[tuple[int, int]]] = {}
        self._periods: dict[int, float] = {}
        self._due: dict[int, float] = {}
        self._under_way: list[tuple[float, bytes]] = []  # with the time to send it, s
        self.send: Callable[[bytes], object] = lambda _packet: None  # to its client
        self.until: Callable[..., bool] = lambda _done, **_how: False  # lets time pass

    def sent_to(self, port: int, channel: int) -> list[bytes]:
        """Payloads that came to a port and channel."""
        return [packet[1:] for packet in list(self.got) if packet[0] == port << 4 | channel]

    @property
    def ordered(self) -> list[bytes]:
        """Payloads of the orders to the high-level commander, without those that set its groups."""
        return [payload for payload in self.sent_to(8, 0) if payload[0] != 0]

    def advance(self, now: float) -> None:
        """Send what is due at `now`, s."""
        while self._under_way and self._under_way[0][0] <= now:
            self.send(self._under_way.pop(0)[1])
        for block, period in list(self._periods.items()):
            if now >= self._due.setdefault(block, 0.0):
                if now - self._packet_at >= LINK_TIMEOUT:
                    self._blocks.clear()
                    self._periods.clear()
                    return
                self._due[block] = max(self._due[block] + period, now)
                self.report(now, block)

    def take(self, data: bytes) -> None:
        self._packet_at = time.monotonic()
        packet = bytes([data[0] & 0xF3]) + data[1:]
        if packet[0] == 0xF3:
            return
        if packet[0] == 0xF0:
            self.echoes += 1
        else:
            self.got.append(packet)
        if self.mute.is_set():
            return
        answer = self._answer(packet[0] >> 4, packet[0] & 3, packet[1:])
        if answer is None:
            return
        for start, times in self.lose.items():
            if times and packet.startswith(start):
                self.lose[start] -= 1
                return
        self.say(packet[:1] + answer)

    def say(self, packet: bytes) -> None:
        if self.delay:
            self._under_way.append((time.monotonic() + self.delay, packet))
        else:
            self.send(packet)

    def _answer(self, port: int, channel: int, payload: bytes) -> bytes | None:  # noqa: C901, PLR0911
        match port, channel:
            case 15, 0:
                return payload
            case 13, 1:
                return bytes([payload[0], self.version])
            case 5, 0:
                return self._table(payload, [(name, 7) for name in self.values], 0xAAAA0001)
            case 5, 1:
                return self._log(payload)
            case 2, 0:
                kinds = [(name, kind) for name, (kind, _value) in self.parameters.items()]
                return self._table(payload, kinds, 0xBBBB0002)
            case 2, 1:
                name = list(self.parameters)[int.from_bytes(payload[:2], "little")]
                return payload[:2] + b"\0" + self.stored[name]
            case 2, 2:
                return self._write(payload)
            case 8, 0:
                errors = self.errors.get(payload[0], [])
                return (payload + b"\0")[:3] + bytes([errors.pop(0) if errors else 0])
            case 9, 1 if payload[0] == 1:
                return bytes([0x81, 1, payload[1]])
            case 4, 0:
                return (
                    b"\1\2"
                    if payload == b"\1"
                    else payload + bytes([0x12 * payload[1]]) + bytes(12)
                )
            case 4, 2:
                at = int.from_bytes(payload[1:5], "little")
                self.memory[at : at + len(payload) - 5] = payload[5:]
                return payload[:5] + b"\0"
        return None

    def _table(self, payload: bytes, entries: list[tuple[str, int]], salt: int) -> bytes:
        if payload == b"\3":
            return b"\3" + struct.pack("<HI", len(entries), salt + len(entries)) + b"\x10\x80"
        name, kind = entries[int.from_bytes(payload[1:3], "little")]
        return payload[:3] + bytes([kind]) + name.replace(".", "\0").encode() + b"\0"

    def _log(self, payload: bytes) -> bytes:
        if payload == b"\5":
            self._blocks.clear()
            self._periods.clear()
            return b"\5\0\0"
        block = payload[1]
        if payload[0] in {6, 7}:
            if self.refuses_block:
                return payload[:2] + bytes([self.refuses_block])
            if (payload[0] == 6) == (block in self._blocks):
                return payload[:2] + bytes([17 if payload[0] == 6 else 2])
            return payload[:2] + bytes([self._append(block, payload[2:])])
        if block not in self._blocks:
            return payload[:2] + bytes([2])
        if payload[0] == 3:
            self._periods[block] = payload[2] / 100
        elif payload[0] == 2:
            self._periods.pop(block, None)
            del self._blocks[block]
        return payload[:2] + b"\0"

    def _append(self, block: int, variables: bytes) -> int:
        """Append what fits, as the firmware does; return an error number."""
        held = self._blocks.setdefault(block, [])
        for kind, number in struct.iter_unpack("<BH", variables):
            if sum(struct.calcsize(LOG_TYPES[code]) for code, _number in [*held, (kind, 0)]) > 26:
                return 7
            held.append((kind, number))
        return 0

    def _write(self, payload: bytes) -> bytes | None:
        name = list(self.parameters)[int.from_bytes(payload[:2], "little")]
        if self.parameters[name][0] & 0x40:
            return None
        self.stored[name] = payload[2:]
        return payload

    def report(self, now: float, block: int = 1) -> None:
        """Send a block once."""
        if self.mute.is_set():
            return
        names = list(self.values)
        data = b"".join(
            struct.pack(
                LOG_TYPES[kind],
                self.values[names[number]] if kind > 6 else int(self.values[names[number]]),
            )
            for kind, number in self._blocks[block]
        )
        stamp = int((now + self.boot) * 1000) % (1 << 24)
        self.say(bytes([0x52, block]) + stamp.to_bytes(3, "little") + data)


class PeerClock(VirtualTime):
    """Peers on a virtual clock. At other addresses there is none."""

    def __init__(self) -> None:
        super().__init__()
        self.peers: dict[str, Peer] = {}

    def start(self, n: int, **how: Any) -> list[Peer]:
        """Add some peers."""
        first = len(self.peers)
        made = [Peer(f"udp://peer:{first + i + 1}", **how) for i in range(n)]
        for peer in made:
            self.peers[peer.uri] = peer
            peer.send = partial(self.deliver, peer.uri)
            peer.until = self.until
        return made

    def simulate(self) -> float:
        for peer in self.peers.values():
            peer.advance(self.now)
        return super().simulate()

    def carry(self, uri: str, packet: bytes) -> None:
        if uri in self.peers:
            self.peers[uri].take(packet)

    def poll(self, uri: str) -> None:
        self.carry(uri, b"\xff")


class UdpPeer(Peer):
    """A peer behind a UDP socket, in real time."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.002)
        super().__init__(f"udp://127.0.0.1:{self._socket.getsockname()[1]}")
        self._ended = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended = True
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        while not self._ended:
            with suppress(OSError):  # nothing came, or the client is gone
                data, client = self._socket.recvfrom(64)
                self.send = partial(self._send, client)
                self.take(data)
            self.advance(time.monotonic())

    def _send(self, client: tuple[str, int], packet: bytes) -> None:
        with suppress(OSError):
            self._socket.sendto(packet, client)
