"""Setting of firmware parameters, with confirmation."""

from __future__ import annotations

import struct
from typing import Final

from star_core import PluginError
from star_radio.connection import packets
from star_radio.connection.questions import Ask, Question
from star_radio.connection.tables import Table

FORMATS: Final = {
    0x0: "<b", 0x1: "<h", 0x2: "<i", 0x3: "<q", 0x8: "<B", 0x9: "<H", 0xA: "<I", 0xB: "<Q",
    0x5: "<e", 0x6: "<f", 0x7: "<d",
}  # fmt: skip
REAL: Final = {0x5, 0x6, 0x7}
READ_ONLY: Final = 0x40  # a bit next to the type
_TYPE = 0x0F


def setting(table: Table, name: str, value: float) -> Question:
    """Return the question that sets a parameter ``group.name``; its answer contains the value.

    Raises:
        PluginError: There is no such parameter, it is read-only, or the value does not fit.
    """
    if name not in table:
        raise PluginError(f"its firmware has no parameter {name!r}", "outdated-firmware")
    number, kind = table[name]
    if kind & READ_ONLY:
        raise PluginError(f"parameter {name!r} is read-only", "invalid-option")
    form = FORMATS[kind & _TYPE]
    if kind & _TYPE not in REAL and value != int(value):
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


def set_now(table: Table, name: str, value: float, ask: Ask) -> None:
    """Set a parameter, and wait for the confirmation."""
    ask([setting(table, name, value)])
