"""Standard deviations of pose corrections: sent to an estimator when they change."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from star_radio.answers import Question
from star_radio.parameters import setting
from star_radio.tables import Table

PARAMETERS: Final = ("locSrv.extPosStdDev", "locSrv.extQuatStdDev")  # m and rad
TOLERANCE: Final = 0.1  # relative change that is not sent


class EstimatorNoise:
    """Standard deviations that one drone has been sent."""

    def __init__(self) -> None:
        self._sent = dict.fromkeys(PARAMETERS, 0.0)
        self._unconfirmed: set[str] = set()

    def changed(self, table: Table, position: float, attitude: float) -> Iterator[Question]:
        """Yield parameter settings for values that have changed by more than `TOLERANCE`.

        Args:
            table: The drone's parameters.
            position: Standard deviation of positions, m.
            attitude: Standard deviation of attitudes, rad; infinite if none are sent.

        Raises:
            PluginError: The firmware has no such parameter.
        """
        for name, std in zip(PARAMETERS, (position, attitude), strict=True):
            change = abs(std - self._sent[name])
            if math.isfinite(std) and change > TOLERANCE * self._sent[name]:
                question = setting(table, name, std)
                question.topic = name
                self._sent[name] = std
                yield question

    def given_up(self, question: Question) -> bool:
        """Mark a value that was never confirmed for sending again.

        Args:
            question: An ended question of any topic.

        Returns:
            Whether this parameter was already given up before, without a confirmation since.
        """
        if question.topic not in self._sent:
            return False
        if question.answer is not None:
            self._unconfirmed.discard(question.topic)
            return False
        self._sent[question.topic] = 0.0
        before = question.topic in self._unconfirmed
        self._unconfirmed.add(question.topic)
        return before
