"""The process of a source: it sends the frames of a system, with the times of their arrival."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection

from star_core import deferred


def serve(descriptor: int) -> None:
    """Send each frame of a source with its arrival, s of the computer's clock.

    The other end first sends ``module:function``, the options, and the timeout of the first frame,
    s. A text at the end is an error. The process exits when the other end is closed.

    Args:
        descriptor: File descriptor of the inherited end of the connection.
    """
    connection = Connection(descriptor)
    target, options, timeout = connection.recv()
    # kills even while native code holds the interpreter's lock
    signal.setitimer(signal.ITIMER_REAL, timeout)
    threading.Thread(target=_exit_with, args=(connection,), daemon=True).start()
    try:
        for frame in deferred(target)(**options):
            if frame is not None:
                signal.setitimer(signal.ITIMER_REAL, 0)
                connection.send((time.monotonic(), *frame))
        connection.send("it has sent all its frames")
    except Exception as error:  # noqa: BLE001 -- the library of a system may raise any type
        _report(connection, error)
    os._exit(0)  # native threads are not joined


def _report(connection: Connection, error: Exception) -> None:
    """Send what failed, unless it is this connection."""
    with suppress(OSError):  # the flight is over
        connection.send(str(error) or type(error).__name__)


def _exit_with(connection: Connection) -> None:
    """Exit once the other end is closed, even while the system sends nothing."""
    try:
        connection.recv()
    finally:
        os._exit(0)
