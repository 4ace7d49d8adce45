"""Creation of log blocks over links that lose and duplicate packets.

The firmware's answers do not state the contents of a block. A request repeated because its answer
was lost is executed twice: a second CREATE is refused (EEXIST); a second APPEND, also one that the
link duplicates, appends again as much as fits (E2BIG). So a block is verified by its reports and
recreated if they have the wrong size.

The firmware deletes all blocks after a second without a packet. `Restorer` creates one again in
flight, without blocking.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from typing import Final

from star_core import PluginError
from star_radio.connection import packets
from star_radio.connection.link import Link
from star_radio.connection.questions import Ask, Question

POLL_PERIOD: Final = 0.005  # s, between checks for the first report
MAX_TRIES: Final = 2  # for a block that is refused or not reported
TOPIC: Final = "reports"  # with which the topics of the questions of a `Restorer` begin
_VARIABLES: Final = (packets.MAX_PAYLOAD - 2) // 3 * 3  # bytes of variables per packet, 3 for each
_TOO_LARGE, _EXISTS = errno.E2BIG, errno.EEXIST
_ERRORS: Final = {
    errno.ENOENT: "no such variable",
    _TOO_LARGE: "it is too large",
    errno.ENOMEM: "it has no memory left",
}


def begin(
    number: int,
    variables: bytes,
    period: float,
    ask: Ask,
    what: str,
    reported: Callable[[], bool | None],
) -> None:
    """Create and start a log block, or replace that of the same number.

    Args:
        number: Number of the block.
        variables: Type and number of each variable, in the order of the reports.
        period: Time between two reports, s.
        ask: Asks the drone.
        what: Name of the block, for messages.
        reported: Waits for a report, by `await_report`; returns what that does.
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
                raise PluginError(f"it refuses the log block of {what}: {why}", "refused-request")
            raise PluginError(f"it does not report {what}", "no-answer")


def await_report(arrived: Callable[[], bool | None], timeout: float) -> bool | None:
    """Wait up to `timeout`, s, for a report; return whether it has the right size, None if none.

    `arrived` returns the same at once.
    """
    end = time.monotonic() + timeout
    while (right := arrived()) is None and time.monotonic() <= end:
        time.sleep(POLL_PERIOD)
    return right


class Restorer:
    """Restarts a log block, or creates it again if the drone has lost it; never blocks.

    Each request follows the answer to the one before it, in the receiving thread. The link repeats
    those without an answer.

    Args:
        link: To the drone.
        block: Number, variables and period, as for `begin`.
        after: Time without a report after which the drone may have lost it, s.
    """

    def __init__(self, link: Link, block: tuple[int, bytes, float], after: float) -> None:
        self._link, self._block, self._after = link, block, after
        self._question: Question | None = None
        self._due = 0.0  # s

    def restore(self, now: float, heard: float, *, anew: bool = False) -> bool:
        """Restart the block if that is due at `now`, s; create it `anew` whether or not it exists.

        Returns whether it was due: its last report arrived at `heard`, s, which is long ago, and
        the last request is no longer repeated.
        """
        question = self._question
        busy = question is not None and question.answer is None and question.retries >= 0
        if busy or now - heard < self._after or now < self._due:
            return False
        self._due = now + self._after
        self._restart(anew=anew)
        return True

    def _restart(self, *, anew: bool) -> None:
        number, _variables, period = self._block
        if anew:
            self._request(_requests(*self._block))
        else:
            self._request(iter([packets.start_block(number, period)]))

    def _request(self, requests: Iterator[bytes]) -> None:
        """Send the first of some requests, and the others once it is answered."""
        packet = next(requests, None)
        if packet is None:
            return

        def go_on(answer: bytes) -> None:
            error = answer[2] if len(answer) > 2 else 0  # noqa: PLR2004 -- command, block, error
            command = packet[1:2]
            if command == packets.START and error == errno.ENOENT:
                self._restart(anew=True)
            elif command == packets.DELETE or error in {0, _EXISTS, _TOO_LARGE}:
                self._request(requests)

        topic = f"{TOPIC} {self._block[0]}"
        question = Question.of(packet, packet[1:3], "its reports", topic=topic)
        question.on_answer = go_on
        self._question = question
        self._link.assure(question)


def _build(number: int, variables: bytes, period: float, ask: Ask, what: str) -> int:
    """Replace a block; return the error number. It may be complete despite `_TOO_LARGE`."""
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
