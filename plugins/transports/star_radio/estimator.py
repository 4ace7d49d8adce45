"""The estimator of a drone: how it starts anew, and how one knows that it has settled."""

from __future__ import annotations

import struct
import time
from collections import deque
from typing import Final

from star_core import PluginError
from star_radio import packets
from star_radio.parameters import set_now
from star_radio.tables import Ask, Table

RESET: Final = "kalman.resetEstimation"
HELD: Final = 0.1  # s, for which the reset is held, as Bitcraze's own tools do
VARIANCES: Final = ("kalman.varPX", "kalman.varPY", "kalman.varPZ")  # of the velocity, m²/s²
SPREAD: Final = 1e-3  # m²/s², between the least and the most of them, as cflib's reset_estimator
PERIOD: Final = 0.05  # s, between two reports of them
SAMPLES: Final = 11  # half a second: without any measurement x and y gain 1.25e-3 m²/s² in it
DEADLINE: Final = 5.0  # s
BLOCK: Final = 2  # number of their log block
_FLOAT: Final = 7  # type of the log protocol
_DATA: Final = struct.Struct("<B3x3f")
_LOOK: Final = 0.005  # s, between two looks


def start_anew(parameters: Table, ask: Ask) -> None:
    """Reset the estimator of a drone.

    Raises:
        PluginError: The drone does not answer, or its firmware has no such parameter.
    """
    set_now(parameters, RESET, 1, ask)
    time.sleep(HELD)
    set_now(parameters, RESET, 0, ask)


class Settling:
    """Waits until the variances of a drone's velocity no longer change.

    They begin anew with a reset. With measurements they come to rest within some tenths of a
    second; without any, acceleration of 0.5 m/s² (the firmware's ``procNoiseAcc_xy``) lets them
    grow by 2.5e-3 m²/s² each second.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, ...]] = deque(maxlen=SAMPLES)

    def hear(self, payload: bytes) -> None:
        """Take a report that is not of the drone's state; here, in the thread that hears it."""
        if len(payload) == _DATA.size and payload[0] == BLOCK:
            self._samples.append(_DATA.unpack(payload)[1:])

    @property
    def settled(self) -> bool:
        """Whether the last half second of reports is all the same, to `SPREAD`."""
        samples = list(self._samples)
        return len(samples) == SAMPLES and all(
            max(axis) - min(axis) <= SPREAD for axis in zip(*samples, strict=True)
        )

    def wait(self, variables: Table, ask: Ask) -> None:
        """Have the variances reported until they have settled, where the firmware has them.

        Args:
            variables: The drone's log table.
            ask: Asks the drone.

        Raises:
            PluginError: They do not settle in `DEADLINE`, or the drone does not answer.
        """
        if any(name not in variables for name in VARIANCES):
            return
        ids = b"".join(
            bytes([_FLOAT]) + variables[name].number.to_bytes(2, "little") for name in VARIANCES
        )
        until = time.monotonic() + DEADLINE
        about = "its estimator"
        for question in (
            packets.log_block(BLOCK, ids),
            packets.start_block(BLOCK, PERIOD),
        ):
            packets.accepted(ask(question, question[1:3], about), "the log block of its estimator")
        while not self.settled:
            if time.monotonic() > until:
                raise PluginError(
                    f"its estimator has not settled in {DEADLINE:g} s: is its Flow deck on, does "
                    "it lie still? 'reset: false' leaves the estimator alone"
                )
            time.sleep(_LOOK)
        question = packets.delete_block(BLOCK)
        ask(question, question[1:3], about)
