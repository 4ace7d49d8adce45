"""OptiTrack's Motive, by its protocol NatNet and the package ``natnet``."""

from __future__ import annotations

import queue
import socket
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Final

from star_mocap.source import Frame

SILENCE: Final = 0.5  # s, after which descriptions of the bodies are requested again
RATE_TIME: Final = 0.2  # s, from which the rate of the system's tick counter is known


class Ticks:
    """Converts the server's ticks, whose rate the package does not report, to seconds.

    The rate is that of the frames' time stamps, which are seconds.
    """

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._rate = 0.0  # 1/s

    def times(self, suffix: Any) -> dict[str, float]:
        """Return `Frame.captured` and `Frame.processing` of a frame, as far as they are known."""
        exposure, sent = suffix.stamp_camera_mid_exposure, suffix.stamp_transmit
        if not (exposure and sent):  # before NatNet 3, or a recording that is played back
            return {"captured": float(suffix.timestamp)}
        if self._first is None:
            self._first = exposure, suffix.timestamp
        ticks, seconds = exposure - self._first[0], suffix.timestamp - self._first[1]
        if seconds > RATE_TIME:
            self._rate = ticks / seconds
        if not self._rate:
            return {}
        captured = self._first[1] + ticks / self._rate
        return {"captured": captured, "processing": (sent - exposure) / self._rate}


def frames(*, host: str, multicast: bool, command_port: int) -> Iterator[Frame | None]:
    """Yield the frames of a server, in metres, in the frame of its stream."""
    module: Any = import_module("natnet")
    client = module.NatNetClient(
        server_ip_address=socket.gethostbyname(host),
        local_ip_address=_local_address(host, command_port),
        command_port=command_port,
        use_multicast=multicast,
    )
    received: queue.SimpleQueue[Any] = queue.SimpleQueue()
    names: dict[int, str] = {}

    def describe(descriptions: Any) -> None:
        names.update({body.id_num: body.name for body in descriptions.rigid_bodies})

    client.on_data_frame_received_event.handlers.append(received.put)
    client.on_data_description_received_event.handlers.append(describe)
    try:
        client.connect()
    except TimeoutError:
        raise OSError(f"no server answers at {host}, command port {command_port}") from None
    with client:
        client.request_modeldef()
        client.run_async()
        ticks = Ticks()
        while True:
            try:
                data = received.get(timeout=SILENCE)
            except queue.Empty:
                client.request_modeldef()
                yield None
                continue
            if {body.id_num for body in data.rigid_bodies} - names.keys():
                client.request_modeldef()
            yield frame_of(data, names, ticks)


def frame_of(data: Any, names: dict[int, str], ticks: Ticks) -> Frame:
    """Return a frame of the package as one of a source."""
    labelled = data.labeled_markers or ()
    loose = [marker.pos for marker in labelled if marker.param is not None and marker.unlabeled]
    return Frame(
        {
            names[body.id_num]: (*body.pos, *body.rot)
            for body in data.rigid_bodies
            if body.tracking_valid is not False and body.id_num in names
        },
        loose or data.unlabeled_marker_pos,
        **ticks.times(data.suffix),
    )


def _local_address(host: str, port: int) -> str:
    """Return the address of this computer from which a host is reached."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, port))  # sends nothing
        return str(probe.getsockname()[0])
