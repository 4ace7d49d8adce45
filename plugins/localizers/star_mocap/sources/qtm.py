"""Qualisys Track Manager, by its real-time protocol and the package ``qtm-rt``."""

from __future__ import annotations

import asyncio
import math
import xml.etree.ElementTree as ET
from collections.abc import AsyncIterator, Iterator, Sequence
from importlib import import_module
from typing import Any, Final

import numpy as np

from star_core import Array
from star_mocap.source import Frame

SILENCE: Final = 0.5  # s
MM: Final = 1e-3  # m
US: Final = 1e-6  # s


def frames(*, host: str, port: int) -> Iterator[Frame | None]:
    """Yield the frames of a server, with times since the start of its measurement."""
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    stream = _frames(host, port)
    while True:
        yield loop.run_until_complete(anext(stream))


async def _frames(host: str, port: int) -> AsyncIterator[Frame | None]:
    module: Any = import_module("qtm_rt")
    connection = await module.connect(host, port=port)
    if connection is None:
        raise OSError(f"no server at {host}:{port}")
    names = body_names(await connection.get_parameters(parameters=["6d"]))
    received: asyncio.Queue[Any] = asyncio.Queue()
    await connection.stream_frames(components=["6d", "3dnolabels"], on_packet=received.put_nowait)
    while connection.has_transport():
        try:
            packet = await asyncio.wait_for(received.get(), SILENCE)
        except TimeoutError:
            yield None
            continue
        yield frame_of(packet, names)
    raise OSError("the server closed the connection")


def body_names(settings: bytes | str) -> list[str]:
    """Return the names of the bodies in the server's settings, in its order."""
    root = ET.fromstring(settings)  # noqa: S314 -- of the system that is trusted with positions
    return [name.text.strip() for name in root.iter("Name") if name.text]


def frame_of(packet: Any, names: Sequence[str]) -> Frame:
    """Return a packet of the package as a frame; lost bodies are NaN in it."""
    _, bodies = packet.get_6d() or (None, ())
    _, markers = packet.get_3d_markers_no_label() or (None, ())
    return Frame(
        {
            name: (position.x * MM, position.y * MM, position.z * MM, *quaternion)
            for name, (position, turn) in zip(names, bodies, strict=False)
            if math.isfinite(position.x)
            for quaternion in (_quaternion(np.array(turn.matrix)).tolist(),)
        },
        [(marker.x * MM, marker.y * MM, marker.z * MM) for marker in markers],
        captured=packet.timestamp * US,
    )


def _quaternion(matrix: Array) -> Array:
    """Return the quaternion x, y, z, w of a rotation matrix, its columns one after the other."""
    from scipy.spatial.transform import Rotation

    quaternion: Array = Rotation.from_matrix(matrix.reshape(3, 3).T).as_quat()
    return quaternion
