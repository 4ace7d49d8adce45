"""The quality of a link over a Crazyradio: told once when it stays low."""

from __future__ import annotations

import logging
import math
from typing import Final

log = logging.getLogger(__name__)

LOW: Final = 70.0  # %: three of ten tries to send a packet are in vain; chosen, not measured
LASTS: Final = 2.0  # s
_NAME: Final = "link_quality"  # cflib's: 100 less ten times the retries of a packet, mean of 100


class Quality:
    """What a dongle says of one link.

    Args:
        name: Of the agent.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._since = math.inf  # s, since when it is low
        self._told = False

    def note(self, quality: dict[str, float], now: float) -> None:
        """Take what cflib says of a link at `now`, s; in the thread of its driver."""
        percent = quality.get(_NAME)
        if percent is None or self._told:
            return
        self._since = min(self._since, now) if percent < LOW else math.inf
        if now - self._since >= LASTS:
            self._told = True
            log.warning(
                "radio: the link of %s is weak: its quality is %.0f %%, below %g %% for %g s",
                self._name,
                percent,
                LOW,
                LASTS,
            )
