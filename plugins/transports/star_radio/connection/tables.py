"""Tables of contents (number and type of log variables and parameters), and their parameters."""

from __future__ import annotations

import json
import logging
import os
import struct
import threading
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Final, NamedTuple, TypeAlias

from star_core import PluginError
from star_radio.connection import packets
from star_radio.connection.questions import Ask, Question

log = logging.getLogger(__name__)

FORMATS: Final = {
    0x0: "<b", 0x1: "<h", 0x2: "<i", 0x3: "<q", 0x8: "<B", 0x9: "<H", 0xA: "<I", 0xB: "<Q",
    0x5: "<e", 0x6: "<f", 0x7: "<d",
}  # fmt: skip
REAL: Final = {0x5, 0x6, 0x7}
READ_ONLY: Final = 0x40  # a bit next to the type
_TYPE = 0x0F
_VALUE = 3  # bytes before the value in the answer to a reading: number and status
REFUSED: Final = ("motorPowerSet.", "health.")
"""Groups that run motors whatever the commander does: their parameters are not set."""
KINDS: Mapping[int, str] = {packets.LOG: "log", packets.PARAMETER: "parameter"}


class Entry(NamedTuple):
    """One variable or parameter.

    Attributes:
        number: Its id in packets.
        kind: Its type, in the numbering of its table.
    """

    number: int
    kind: int


Table: TypeAlias = Mapping[str, Entry]
"""Entries by name, ``group.name``."""


class Tables:
    """Tables of contents by checksum: each firmware's is read once, from one drone."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tables: dict[str, Table] = {}
        self._lock = threading.Lock()
        self._reading: dict[str, threading.Lock] = {}

    def of(self, port: int, ask: Ask) -> Table:
        """Return a drone's table of the port LOG or PARAMETER; callable from several threads."""
        about = f"its {KINDS[port]} table"
        question = packets.packet(port, packets.TABLE, packets.TABLE_SIZE)
        (answer,) = ask([Question.of(question, packets.TABLE_SIZE, about)])
        count, checksum = struct.unpack_from("<HI", answer, 1)
        key = f"{KINDS[port]}-{checksum:08X}-{count}"
        with self._lock:
            reading = self._reading.setdefault(key, threading.Lock())
        with reading:  # the first thread reads the table; if that fails, the next one tries
            table = self._tables.get(key) or self._load(key, count)
            if table is None:
                items = (packets.table_item(port, number) for number in range(count))
                answers = ask(
                    [Question.of(item, item[1:4], _about(port, i)) for i, item in enumerate(items)]
                )
                table = dict(_entry(port, *numbered) for numbered in enumerate(answers))
                self._store(key, table)
            self._tables[key] = table
        return table

    def _load(self, key: str, count: int) -> Table | None:
        """Return a cached table; None if there is none or it is invalid."""
        try:
            kept: dict[str, Any] = json.loads((self._folder / f"{key}.json").read_text("utf-8"))
            table = {
                str(name): Entry(int(number), int(kind)) for name, (number, kind) in kept.items()
            }
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, AttributeError) as error:
            log.debug("cannot read the cached %s: %s", key, error)
            return None
        return table if len(table) == count else None

    def _store(self, key: str, table: Table) -> None:
        """Cache a table, atomically: several processes may do so at once."""
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
            log.warning("radio: cannot cache tables of contents in %s: %s", self._folder, error)


def user_cache() -> Path:
    """Return the user's cache folder for tables."""
    above = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(above) / "star-swarm" / "radio"


def _about(port: int, number: int) -> str:
    return f"entry {number} of its {KINDS[port]} table"


def _entry(port: int, number: int, answer: bytes) -> tuple[str, Entry]:
    group, name, *_ = *answer[4:].split(b"\0"), b""
    if len(answer) < 5 or not name:  # noqa: PLR2004 -- command, number, type, and a name
        text = f"{_about(port, number)} cannot be read: {answer.hex()!r}"
        raise PluginError(text, "invalid-answer")
    return f"{group.decode('latin-1')}.{name.decode('latin-1')}", Entry(number, answer[3])


def setting(table: Table, name: str, value: float) -> Question:
    """Return the question that sets a parameter ``group.name``; its answer contains the value."""
    if name.startswith(REFUSED):
        text = f"parameter {name!r} would run motors past the safety filter"
        raise PluginError(text, "invalid-option")
    if name not in table:
        raise PluginError(f"its firmware has no parameter {name!r}", "outdated-firmware")
    number, kind = table[name]
    if kind & READ_ONLY:
        raise PluginError(f"parameter {name!r} is read-only", "invalid-option")
    form = FORMATS[kind & _TYPE]
    if kind & _TYPE not in REAL and not float(value).is_integer():
        text = f"parameter {name!r} is a whole number, got {value!r}"
        raise PluginError(text, "invalid-option")
    try:
        coded = struct.pack(form, value if kind & _TYPE in REAL else int(value))
    except (struct.error, OverflowError) as error:
        text = f"parameter {name!r} cannot be {value!r}: {error}"
        raise PluginError(text, "invalid-option") from error
    packet = packets.write_parameter(number, coded)
    question = Question.of(packet, packet[1:3], f"parameter {name!r}")
    question.accepts = lambda payload: payload[2:] == coded
    return question


def read_now(table: Table, names: Iterable[str], ask: Ask) -> dict[str, float]:
    """Return the values of parameters by name, without those that the firmware lacks."""
    present = [name for name in names if name in table]
    requests = [packets.read_parameter(table[name].number) for name in present]
    answers = ask(
        [
            Question.of(request, request[1:3], f"parameter {name!r}")
            for name, request in zip(present, requests, strict=True)
        ]
    )
    values = {}
    for name, answer in zip(present, answers, strict=True):
        form = FORMATS[table[name].kind & _TYPE]
        if answer[2:3] == b"\0" and len(answer) == _VALUE + struct.calcsize(form):
            values[name] = float(struct.unpack_from(form, answer, _VALUE)[0])
    return values


def set_now(table: Table, name: str, value: float, ask: Ask) -> None:
    """Set a parameter, and wait for the confirmation."""
    ask([setting(table, name, value)])
