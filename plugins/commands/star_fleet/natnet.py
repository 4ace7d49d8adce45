"""A motion-capture server of a fleet: OptiTrack's protocol NatNet 3.1 over UDP, unicast.

It streams what the simulator's positioning system measures, as Motive streams rigid bodies and
markers: in metres, z up, in the map. A client that sends ``connect`` or ``keep alive`` receives
every frame for `CLIENT_TIMEOUT` from then on.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from star_core import Array, PluginError, PoseFixes

CONNECT, SERVER_INFO, MODEL_REQUEST, MODEL, FRAME, KEEP_ALIVE = 0, 1, 4, 5, 7, 10  # messages
VERSION: Final = (3, 1, 0, 0)
NAME: Final = b"STAR fleet"
NAME_LENGTH: Final = 256  # bytes
RIGID_BODY: Final = 1  # type of a description
TICKS: Final = 10_000_000  # of the clock of the cameras, 1/s
CLIENT_TIMEOUT: Final = 5.0  # s
TRACKED, UNLABELLED = 0x01, 0x10  # bits of a body and of a marker
MARKER_SIZE: Final = 0.01  # m
MAX_REQUEST: Final = 1024  # bytes


class NatNetServer:
    """Streams the poses of a fleet's drones.

    Attributes:
        port: Command port.

    Raises:
        PluginError: The port is not available.
    """

    def __init__(self, names: Sequence[str], host: str, port: int) -> None:
        self._names = names
        self._clients: dict[tuple[str, int], float] = {}  # s, until when they receive
        self._frame = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)  # noqa: FBT003 -- its only argument
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            text = f"port {port} of {host} cannot be opened: {error.strerror}"
            raise PluginError(text, "address-in-use") from error
        self.port: int = self._socket.getsockname()[1]

    def serve(self, fixes: PoseFixes, now: float) -> None:
        """Answer requests, and stream measurements that arrive at `now`, s of simulated time."""
        answers: dict[int, Callable[[], bytes]] = {CONNECT: self._server_info}
        answers |= {MODEL_REQUEST: self._model, KEEP_ALIVE: bytes}
        while True:
            try:
                request, client = self._socket.recvfrom(MAX_REQUEST)
            except (BlockingIOError, ConnectionError):
                break
            number = struct.unpack_from("<H", request)[0] if len(request) > 1 else None
            if number in answers:
                self._clients[client] = now + CLIENT_TIMEOUT
                if answer := answers[number]():
                    self._send(answer, client)
        time = np.where(np.isfinite(fixes.taken), fixes.taken, fixes.arrived)
        for at in np.unique(time):
            message = self.frame(fixes, np.equal(time, at), now)
            for client, until in self._clients.items():
                if now < until:
                    self._send(message, client)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def frame(self, fixes: PoseFixes, rows: Array, now: float) -> bytes:
        """Return the message of the measurements of one time, sent at `now`, s."""
        self._frame += 1
        agent, position = fixes.agent[rows], fixes.position[rows]
        markers = [struct.pack("<3f", *point) for point in position[agent < 0].tolist()]
        body = struct.pack("<II", self._frame, 0)  # no sets of markers
        body += struct.pack("<I", len(markers)) + b"".join(markers)
        bodies = self._bodies(agent, position, fixes.attitude[rows])
        body += struct.pack("<I", len(bodies)) + b"".join(bodies)
        body += struct.pack("<II", 0, len(markers))  # no skeletons
        for number, marker in enumerate(markers, 1):
            body += struct.pack("<I", number) + marker
            body += struct.pack("<fHf", MARKER_SIZE, UNLABELLED, 0.0)
        body += struct.pack("<II", 0, 0)  # neither force plates nor devices
        taken = float(fixes.taken[rows][0])
        stamps = (0, 0, 0)  # a system without times
        if np.isfinite(taken):
            exposure, sent = (round((1 + time) * TICKS) for time in (taken, now))
            stamps = exposure, sent, sent
        time = taken if np.isfinite(taken) else now
        body += struct.pack("<IId3QH", 0, 0, time, *stamps, 0)
        return _message(FRAME, body + bytes(4))

    def _bodies(self, agent: Array, position: Array, attitude: Array) -> list[bytes]:
        """Return the bodies of a frame: none for a system that sees markers only."""
        if (agent < 0).any():
            return []
        poses = np.zeros((len(self._names), 7))
        poses[:, 6] = 1.0
        poses[agent] = np.column_stack([position, np.nan_to_num(attitude)])
        tracked = np.isin(np.arange(len(poses)), agent)
        return [
            struct.pack("<I7ffH", row + 1, *pose, 0.0, TRACKED if tracked[row] else 0)
            for row, pose in enumerate(poses.tolist())
        ]

    def _server_info(self) -> bytes:
        body = NAME.ljust(NAME_LENGTH, b"\0") + bytes(VERSION) + bytes(VERSION)
        return _message(SERVER_INFO, body + struct.pack("<QHB4s", TICKS, 0, 0, bytes(4)))

    def _model(self) -> bytes:
        body = struct.pack("<I", len(self._names))
        for row, name in enumerate(self._names):
            body += struct.pack("<I", RIGID_BODY) + name.encode() + b"\0"
            body += struct.pack("<Ii3fI", row + 1, -1 & 0x7FFFFFFF, 0.0, 0.0, 0.0, 0)
        return _message(MODEL, body)

    def _send(self, message: bytes, client: tuple[str, int]) -> None:
        try:
            self._socket.sendto(message, client)
        except OSError:  # it is gone, or its buffer is full
            self._clients[client] = 0.0


def _message(number: int, body: bytes) -> bytes:
    return struct.pack("<HH", number, len(body)) + body
