"""How near is there, how quick a turn, and how long what may take."""

from __future__ import annotations

import math
from typing import Final

NEAR: Final = 0.15  # m from its goal a scout has arrived
TURN_RATE: Final = math.radians(90)  # rad/s, the planners' own default
PATIENCE: Final = 3.0
"""Times what is expected: agents brake, and make way for each other; as for all verbs."""
GRACE: Final = 5.0  # s besides


def patience(expected: float) -> float:
    """Return how long what should take `expected` seconds may take, s.

    >>> patience(10.0)
    35.0
    """
    return PATIENCE * expected + GRACE
