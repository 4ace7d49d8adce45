"""Link quality of a Crazyradio: warns once when it stays low."""

from __future__ import annotations

import logging
import math
from typing import Final

log = logging.getLogger(__name__)

MIN_QUALITY: Final = 70.0  # %: three of ten transmissions fail; chosen, not measured
MIN_DURATION: Final = 2.0  # s below it, before the warning
_NAME: Final = "link_quality"  # in cflib: 100 minus ten times the retries per packet, mean of 100


class Quality:
    """Monitors the quality of one link.

    Args:
        name: Name of the agent.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._since = math.inf  # s, time since which it is low
        self._warned = False

    def note(self, quality: dict[str, float], now: float) -> None:
        """Add cflib's link statistics at `now`, s; runs in the thread of the driver."""
        percent = quality.get(_NAME)
        if percent is None or self._warned:
            return
        self._since = min(self._since, now) if percent < MIN_QUALITY else math.inf
        if now - self._since >= MIN_DURATION:
            self._warned = True
            log.warning(
                "radio: the link of %s is weak: its quality is %.0f %%, below %g %% for %g s",
                self._name,
                percent,
                MIN_QUALITY,
                MIN_DURATION,
            )
