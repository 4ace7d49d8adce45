"""How sure the poses are that an estimator is sent: told when it changes, until it is heard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from star_radio.answers import Question
from star_radio.parameters import setting
from star_radio.tables import Table

NAMES: Final = ("locSrv.extPosStdDev", "locSrv.extQuatStdDev")  # m and rad
FORGIVEN: Final = 0.1  # share by which a deviation may change without being told


class Deviations:
    """What one drone has been told of them."""

    def __init__(self) -> None:
        self._told = dict.fromkeys(NAMES, 0.0)
        self._unheard: set[str] = set()

    def changed(self, table: Table, position: float, attitude: float) -> Iterator[Question]:
        """Yield what tells of deviations, m and rad, that have changed by more than `FORGIVEN`.

        Args:
            table: The drone's parameters.
            position: Of positions, m.
            attitude: Of attitudes, rad; infinite if none are told.

        Raises:
            PluginError: The firmware has no such parameter.
        """
        for name, deviation in zip(NAMES, (position, attitude), strict=True):
            off = abs(deviation - self._told[name])
            if math.isfinite(deviation) and off > FORGIVEN * self._told[name]:
                question = setting(table, name, deviation)
                question.topic = name
                self._told[name] = deviation
                yield question

    def given_up(self, question: Question) -> bool:
        """Forget a deviation that was never confirmed, so that it is told anew.

        Args:
            question: Of any topic, that has ended.

        Returns:
            Whether the same was given up before, and nothing of it was heard since.
        """
        if question.topic not in self._told:
            return False
        if question.answer is not None:
            self._unheard.discard(question.topic)
            return False
        self._told[question.topic] = 0.0
        before = question.topic in self._unheard
        self._unheard.add(question.topic)
        return before
