"""Waiting for what another thread or process does, and ports that are free."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from random import SystemRandom
from typing import TypeVar

Answer = TypeVar("Answer")

PATIENCE = 60.0  # s, on a busy machine


def eventually(question: Callable[..., Answer], within: float = PATIENCE) -> Answer:
    """Return the answer to a question that is asked until it is true, or for `within` s."""
    deadline = time.monotonic() + within
    while not (answer := question()) and time.monotonic() < deadline:
        time.sleep(0.002)
    return answer


def free_port() -> int:
    """Return a TCP port of the loopback on which nothing listens.

    It is below those that Linux gives to other sockets: no connection takes it in the meantime.
    """
    for port in SystemRandom().sample(range(20_000, 32_000), 100):
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise OSError("no free port")
