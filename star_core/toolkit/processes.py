"""Processes of this interpreter beside a flight, each connected to it by a pipe."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any


def python_process(module: str, **environment: str) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process, and return it and this end of its connection.

    Signals of the terminal do not reach it: an interrupt is for the flight.

    Args:
        module: Its function ``serve`` is called with the file descriptor of the other end, and
            returns when this end is closed.
        environment: Variables of its environment besides those of this process.
    """
    connection, theirs = Pipe()
    with theirs:
        code = f"from {module} import serve; serve({theirs.fileno()})"
        process = subprocess.Popen(  # noqa: S603 -- this very interpreter
            [sys.executable, "-c", code],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | environment,
        )
    return process, connection


def messages_from(connection: Connection) -> Iterator[Any]:
    """Yield what the other end of a connection sends, until it is closed or its process ends."""
    with suppress(EOFError, OSError):  # of which the latter is in the middle of a message
        while True:
            yield connection.recv()
