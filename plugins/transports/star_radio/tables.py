"""Tables of contents: number and type of every log variable and parameter, and their cache."""

from __future__ import annotations

import json
import logging
import os
import struct
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple, TypeAlias

from star_core import PluginError
from star_radio import packets

log = logging.getLogger(__name__)

Ask: TypeAlias = Callable[[bytes, bytes, str], bytes]
"""Sends a packet until an answer that begins so comes, and returns it; raises `PluginError`."""

KINDS: Mapping[int, str] = {packets.LOG: "log", packets.PARAMETER: "parameter"}


class Entry(NamedTuple):
    """One variable.

    Attributes:
        number: What packets call it.
        kind: Its type, in the numbering of its table.
    """

    number: int
    kind: int


Table: TypeAlias = Mapping[str, Entry]
"""Entries by name, ``group.name``."""


class Tables:
    """Tables of contents by their checksum: each firmware's is read once, from one drone.

    Args:
        folder: Where they are kept from one flight to the next; None keeps them nowhere.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._known: dict[str, Table] = {}
        self._lock = threading.Lock()
        self._reading: dict[str, threading.Lock] = {}

    def of(self, port: int, ask: Ask) -> Table:
        """Return a drone's table; drones of one firmware may ask at the same time.

        Args:
            port: `packets.LOG` or `packets.PARAMETER`.
            ask: Asks the drone.

        Raises:
            PluginError: The drone does not answer.
        """
        about = f"its {KINDS[port]} table"
        question = packets.packet(port, packets.TABLE, packets.TABLE_SIZE)
        count, checksum = struct.unpack_from("<HI", ask(question, packets.TABLE_SIZE, about), 1)
        key = f"{KINDS[port]}-{checksum:08X}-{count}"
        with self._lock:
            reading = self._reading.setdefault(key, threading.Lock())
        with reading:  # whoever is first reads it; if that fails, the next one tries
            table = self._known.get(key) or self._load(key, count)
            if table is None:
                table = dict(_item(port, number, ask) for number in range(count))
                self._store(key, table)
            self._known[key] = table
        return table

    def _load(self, key: str, count: int) -> Table | None:
        """Return a table from the folder; None if there is none, or none that can be used."""
        if self._folder is None:
            return None
        try:
            kept: dict[str, Any] = json.loads((self._folder / f"{key}.json").read_text("utf-8"))
            table = {
                str(name): Entry(int(number), int(kind)) for name, (number, kind) in kept.items()
            }
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, AttributeError) as error:
            log.debug("%s is read anew: %s", key, error)
            return None
        return table if len(table) == count else None

    def _store(self, key: str, table: Table) -> None:
        """Keep a table, whole or not at all: several processes may do so at once."""
        if self._folder is None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with NamedTemporaryFile("w", dir=self._folder, delete=False, encoding="utf-8") as file:
                json.dump(table, file)
            try:
                Path(file.name).replace(self._folder / f"{key}.json")
            except OSError:
                with suppress(OSError):
                    Path(file.name).unlink()
                raise
        except OSError as error:
            log.warning("radio: tables of contents are not kept in %s: %s", self._folder, error)


def user_cache() -> Path:
    """Return the folder where this user's tables are kept."""
    above = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(above) / "star-swarm" / "radio"


def _item(port: int, number: int, ask: Ask) -> tuple[str, Entry]:
    question = packets.table_item(port, number)
    about = f"entry {number} of its {KINDS[port]} table"
    answer = ask(question, question[1:4], about)
    group, name, *_ = *answer[4:].split(b"\0"), b""
    if len(answer) < 5 or not name:  # noqa: PLR2004 -- command, number, type, and a name
        raise PluginError(f"{about} cannot be read: {answer.hex()!r}")
    return f"{group.decode('latin-1')}.{name.decode('latin-1')}", Entry(number, answer[3])
