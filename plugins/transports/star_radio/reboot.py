"""Reboot detection: a drone that rebooted still answers, but has lost its log block."""

from __future__ import annotations

import errno
from typing import Final

from star_radio import packets
from star_radio.answers import Question
from star_radio.report import BLOCK

TOPIC: Final = "reboot"
REPORT_TIMEOUT: Final = 0.5  # s without a report, after which a drone is probed
PROBE_PERIOD: Final = 0.5  # s


class RebootWatch:
    """Probes a drone that sends no reports by starting its log block, which a reboot deletes."""

    def __init__(self) -> None:
        self._due = 0.0  # s, earliest time of the next probe

    def question(self, now: float, heard: float, period: float) -> Question | None:
        """Return the probe to send at `now`, s, if one is due.

        Args:
            now: s.
            heard: Arrival of its last report, s.
            period: Period of its reports, s.
        """
        if now - heard < REPORT_TIMEOUT or now < self._due:
            return None
        self._due = now + PROBE_PERIOD
        packet = packets.start_block(BLOCK, period)
        place = (packets.LOG, packets.SETTINGS)
        return Question(packet, place, packet[1:3], "its reports", topic=TOPIC)

    @staticmethod
    def shows(question: Question) -> bool:
        """Whether the answer to a question shows that the drone rebooted."""
        answer = question.answer
        return answer is not None and len(answer) > 2 and answer[2] == errno.ENOENT  # noqa: PLR2004
