"""What a process does that follows agents beside the tick."""

from __future__ import annotations

import faulthandler
import logging
import traceback
from multiprocessing.connection import Connection
from typing import NamedTuple

from star_apriltag.agent_group import NOTHING, Group, Learnt, together


class Answer(NamedTuple):
    """What comes back for some ticks.

    Attributes:
        learnt: What they said.
        log: Name of the logger, level and text of what was logged meanwhile.
    """

    learnt: Learnt
    log: tuple[tuple[str, int, str], ...]


class Kept(logging.Handler):
    """Keeps what is logged until it is taken away."""

    def __init__(self) -> None:
        super().__init__()
        self._records: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self._records.append((record.name, record.levelno, record.getMessage()))

    def take(self) -> tuple[tuple[str, int, str], ...]:
        """Return what was logged since the last call."""
        records = tuple(self._records)
        self._records.clear()
        return records


def serve(descriptor: int) -> None:
    """Follow agents until a connection is closed.

    It gives the arguments of `Group`, and from then on lists of `Heard`; each is answered by one
    `Answer`, and so is the beginning. When following fails, the answer is the traceback, and the
    last one.

    Args:
        descriptor: Of the connection's end, which is inherited.
    """
    faulthandler.enable()
    connection = Connection(descriptor)
    logger, kept = logging.getLogger("star_apriltag"), Kept()
    logger.addHandler(kept)
    logger.setLevel(logging.INFO)
    try:
        group = Group(*connection.recv())
        connection.send(Answer(NOTHING, ()))
        while True:
            heard = connection.recv()
            learnt = together([group.follow(one) for one in heard])
            connection.send(Answer(learnt, kept.take()))
    except (EOFError, OSError):  # the parent is gone
        return
    except Exception:  # noqa: BLE001 -- whatever it is, the flight is to know
        connection.send(traceback.format_exc())
