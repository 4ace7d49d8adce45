"""A drone's state estimator: its reset, its convergence, and the noise of its corrections."""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from collections.abc import Iterator
from typing import Final

from star_core import PluginError
from star_radio.connection import log_blocks, packets
from star_radio.connection.questions import Ask, Question
from star_radio.connection.tables import Table, set_now, setting

RESET: Final = "kalman.resetEstimation"
RESET_DURATION: Final = 0.1  # s, for which the parameter stays set, as in Bitcraze's tools
VARIANCES: Final = ("kalman.varPX", "kalman.varPY", "kalman.varPZ")  # of the velocity, m²/s²
MAX_SPREAD: Final = 1e-3  # m²/s², between least and greatest, as in cflib's reset_estimator
REPORT_PERIOD: Final = 0.05  # s
SAMPLES: Final = 11  # 0.5 s, in which x and y gain 1.25e-3 m²/s² without measurements
CONVERGENCE_TIMEOUT: Final = 5.0  # s
REPORT_TIMEOUT: Final = 1.0  # s without a report of the variances, then the block is recreated
BLOCK: Final = 2  # number of their log block
NOISE: Final = ("locSrv.extPosStdDev", "locSrv.extQuatStdDev")  # of corrections, m and rad
TOLERANCE: Final = 0.1  # relative change of the noise that is not sent
_FLOAT: Final = 7  # type of the log protocol
_DATA: Final = struct.Struct("<B3x3f")


def reset_estimator(parameters: Table, ask: Ask) -> None:
    """Reset the estimator of a drone."""
    set_now(parameters, RESET, 1, ask)
    time.sleep(RESET_DURATION)
    set_now(parameters, RESET, 0, ask)


class ConvergenceWait:
    """Waits until the variances of a drone's velocity no longer change.

    A reset reinitialises them. With measurements they converge within some tenths of a second;
    without any, acceleration noise of 0.5 m/s² (the firmware's ``procNoiseAcc_xy``) makes them
    grow by 2.5e-3 m²/s² per second.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, ...]] = deque(maxlen=SAMPLES)
        self._heard = -math.inf  # s of the computer's clock

    def hear(self, payload: bytes) -> None:
        """Store a report of the variances; runs in the receiving thread."""
        if len(payload) == _DATA.size and payload[0] == BLOCK:
            self._samples.append(_DATA.unpack(payload)[1:])
            self._heard = time.monotonic()

    @property
    def converged(self) -> bool:
        """Whether the variances of the last 0.5 s differ by at most `MAX_SPREAD`."""
        samples = list(self._samples)
        return len(samples) == SAMPLES and all(
            max(axis) - min(axis) <= MAX_SPREAD for axis in zip(*samples, strict=True)
        )

    def wait(self, variables: Table, ask: Ask) -> None:
        """Wait until the variances have converged, if the firmware's log table has them."""
        if any(name not in variables for name in VARIANCES):
            return
        ids = b"".join(packets.log_variable(_FLOAT, variables[name].number) for name in VARIANCES)
        until = time.monotonic() + CONVERGENCE_TIMEOUT
        while not self.converged:
            if self._silent:
                log_blocks.begin(BLOCK, ids, REPORT_PERIOD, ask, "its estimator", self._reported)
                until = time.monotonic() + CONVERGENCE_TIMEOUT
            if time.monotonic() > until:
                raise PluginError(
                    f"its estimator has not converged in {CONVERGENCE_TIMEOUT:g} s: check that the "
                    "Flow deck is attached and the drone does not move, or set 'reset: false'",
                    "estimator-unsettled",
                )
            time.sleep(log_blocks.POLL_PERIOD)
        packet = packets.delete_block(BLOCK)
        ask([Question.of(packet, packet[1:3], "the end of reports of its estimator")])

    @property
    def _silent(self) -> bool:
        return time.monotonic() - self._heard > REPORT_TIMEOUT

    def _reported(self) -> bool | None:
        """Wait for a report; return True if one arrived, else None."""
        return log_blocks.await_report(lambda: None if self._silent else True, REPORT_TIMEOUT)


class EstimatorNoise:
    """Standard deviations of pose corrections that one drone has been sent."""

    def __init__(self) -> None:
        self._sent = dict.fromkeys(NOISE, 0.0)
        self._unconfirmed: set[str] = set()

    def changed(self, table: Table, position: float, attitude: float) -> Iterator[Question]:
        """Yield parameter settings for values that have changed by more than `TOLERANCE`.

        Args:
            table: The drone's parameters.
            position: Standard deviation of positions, m.
            attitude: Standard deviation of attitudes, rad; infinite if none are sent.
        """
        for name, std in zip(NOISE, (position, attitude), strict=True):
            if math.isfinite(std) and abs(std - self._sent[name]) > TOLERANCE * self._sent[name]:
                question = setting(table, name, std)
                question.topic = name
                self._sent[name] = std
                yield question

    def given_up(self, question: Question) -> bool:
        """Mark a value that was never confirmed for sending again.

        Returns whether this parameter was already given up before, without a confirmation since.
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
