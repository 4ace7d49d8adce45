"""Creation of log blocks over links that lose and duplicate packets.

The firmware's answers do not state the contents of a block. A request repeated because its answer
was lost is executed twice: a second CREATE is refused (EEXIST); a second APPEND, also one that the
link duplicates, appends again as much as fits (E2BIG). So a block is verified by its reports and
recreated if they have the wrong size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from star_core import PluginError
from star_radio import packets
from star_radio.answers import Ask, Question

MAX_TRIES: Final = 2  # for a block that is refused or not reported
VARIABLE: Final = 3  # bytes per variable in a request
_VARIABLES: Final = (packets.MOST - 2) // VARIABLE * VARIABLE  # bytes of variables per packet
_TOO_LARGE, _EXISTS = 7, 17  # errors
_ERRORS: Final = {2: "no such variable", _TOO_LARGE: "it is too large", 12: "it has no memory left"}


def begin(
    number: int,
    variables: bytes,
    period: float,
    ask: Ask,
    what: str,
    reported: Callable[[], bool | None],
) -> None:
    """Create and start a log block.

    Args:
        number: Number of the block; an existing block of this number is replaced.
        variables: Type and number of each variable, in the order of the reports.
        period: Time between two reports, s.
        ask: Asks the drone.
        what: Name of the block, for messages.
        reported: Waits for a report; returns whether it has the right size, None if none arrived.

    Raises:
        PluginError: The drone refuses, does not report, or does not answer.
    """
    tries = 0
    while True:
        error = _build(number, variables, period, ask, what)
        right = reported() if error in {0, _TOO_LARGE} else None
        if right:
            return
        tries += right is None
        if tries == MAX_TRIES:
            if error:
                why = _ERRORS.get(error, f"error {error}")
                raise PluginError(f"it refuses the log block of {what}: {why}")
            raise PluginError(f"it does not report {what}")


def _build(number: int, variables: bytes, period: float, ask: Ask, what: str) -> int:
    """Replace a block; return the error number, else 0.

    The block may be complete despite `_TOO_LARGE`.
    """
    repeated = 0
    for packet in _requests(number, variables, period):
        (answer,) = ask([Question.of(packet, packet[1:3], f"reports of {what}")])
        error = answer[2] if len(answer) > 2 else 0  # noqa: PLR2004 -- command, block, error
        if error == _TOO_LARGE:
            repeated = error
        elif error and packet[1:2] != packets.DELETE and error != _EXISTS:
            return error
    return repeated


def _requests(number: int, variables: bytes, period: float) -> Iterator[bytes]:
    yield packets.delete_block(number)
    command = packets.CREATE
    for at in range(0, len(variables), _VARIABLES):
        yield packets.log_block(number, variables[at : at + _VARIABLES], command)
        command = packets.APPEND
    yield packets.start_block(number, period)
