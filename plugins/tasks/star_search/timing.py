"""How near is there, and how quick a turn."""

from __future__ import annotations

import math
from typing import Final

NEAR: Final = 0.15  # m from its goal a scout has arrived
TURN_RATE: Final = math.radians(90)  # rad/s, the planners' own default
