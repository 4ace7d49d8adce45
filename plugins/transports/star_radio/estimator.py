"""Reset of a drone's state estimator, and detection of its convergence."""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from typing import Final

from star_core import PluginError
from star_radio import log_blocks, packets
from star_radio.answers import Ask, Question
from star_radio.parameters import set_now
from star_radio.tables import Table

RESET: Final = "kalman.resetEstimation"
RESET_DURATION: Final = 0.1  # s, for which the parameter stays set, as in Bitcraze's tools
VARIANCES: Final = ("kalman.varPX", "kalman.varPY", "kalman.varPZ")  # of the velocity, m²/s²
MAX_SPREAD: Final = 1e-3  # m²/s², between least and greatest, as in cflib's reset_estimator
REPORT_PERIOD: Final = 0.05  # s
SAMPLES: Final = 11  # 0.5 s, in which x and y gain 1.25e-3 m²/s² without measurements
CONVERGENCE_TIMEOUT: Final = 5.0  # s
REPORT_TIMEOUT: Final = 1.0  # s without a report of the variances, then the block is recreated
BLOCK: Final = 2  # number of their log block
_FLOAT: Final = 7  # type of the log protocol
_DATA: Final = struct.Struct("<B3x3f")
_POLL_PERIOD: Final = 0.005  # s


def reset_estimator(parameters: Table, ask: Ask) -> None:
    """Reset the estimator of a drone.

    Raises:
        PluginError: The drone does not answer, or its firmware has no such parameter.
    """
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
        """Wait until the variances have converged, if the firmware reports them.

        Args:
            variables: The drone's log table.
            ask: Asks the drone.

        Raises:
            PluginError: They do not converge within `CONVERGENCE_TIMEOUT`, or the drone does not
                answer.
        """
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
                    "Flow deck is attached and the drone does not move, or set 'reset: false'"
                )
            time.sleep(_POLL_PERIOD)
        question = packets.delete_block(BLOCK)
        ask([Question.of(question, question[1:3], "the end of reports of its estimator")])

    @property
    def _silent(self) -> bool:
        return time.monotonic() - self._heard > REPORT_TIMEOUT

    def _reported(self) -> bool | None:
        """Wait for a report; return True if one arrived, else None."""
        until = time.monotonic() + REPORT_TIMEOUT
        while self._silent and time.monotonic() < until:
            time.sleep(_POLL_PERIOD)
        return None if self._silent else True
