"""Process that receives from a motion-capture system, through the package ``motioncapture``.

Its native code blocks while a system sends nothing, for some systems with the interpreter lock
held, and aborts a process that exits meanwhile. So it runs in a process that can be killed.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Sequence
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from star_core import Array


class Frame(NamedTuple):
    """The rigid bodies at one time.

    Attributes:
        arrived: Arrival, s of the computer's monotonic clock.
        poses: (N, 7) position, m, and quaternion x, y, z, w; NaN for bodies that are not seen.
    """

    arrived: float
    poses: Array


def serve(descriptor: int) -> None:
    """Send an empty string once connected, then every `Frame`; a final string is an error.

    The other end first sends the kind of system, host name, names of bodies, and the connection
    timeout, s. The process exits when the other end is closed.

    Args:
        descriptor: File descriptor of the inherited end of the connection.
    """
    connection = Connection(descriptor)
    kind, hostname, bodies, timeout = connection.recv()
    signal.setitimer(
        signal.ITIMER_REAL, timeout
    )  # kills even while native code holds the interpreter's lock
    try:
        system = import_module("motioncapture").connect(kind, {"hostname": hostname})
        signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send("")
        threading.Thread(target=_exit_with, args=(connection,), daemon=True).start()
        while True:
            system.waitForNextFrame()
            connection.send(Frame(time.monotonic(), _poses(system, bodies)))
    except OSError:  # the flight is over
        pass
    except Exception as error:  # noqa: BLE001 -- the library of a system may raise any type
        connection.send(str(error))
    os._exit(0)  # native threads are not joined


def _poses(system: Any, bodies: Sequence[str]) -> Array:
    rigid_bodies = system.rigidBodies
    poses = np.full((len(bodies), 7), np.nan)
    for row, name in enumerate(bodies):
        if name in rigid_bodies:
            turn = rigid_bodies[name].rotation
            poses[row, :3] = rigid_bodies[name].position
            poses[row, 3:] = turn.x, turn.y, turn.z, turn.w
    return poses


def _exit_with(connection: Connection) -> None:
    """Exit once the other end is closed, even while the system sends nothing."""
    try:
        connection.recv()
    finally:
        os._exit(0)
