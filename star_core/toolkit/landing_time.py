"""The least time of a landing. Nothing here imports numpy."""

from __future__ import annotations

from typing import Any, Final

MIN_LAND_TIME: Final = 3.0  # s, of a landing from the floor, and
MIN_LAND_TIME_PER_HEIGHT: Final = 2.0  # s/m, with which a plan crosses the floor at 0.3 m/s or less


def min_landing_time(height: Any) -> Any:
    """Return the least duration of a commanded descent to the floor, s.

    The core lengthens shorter ones: a plan that ends below the floor would cross it too fast.

    Args:
        height: Of the agent above the floor, m: a number or an array.

    Example:
        >>> min_landing_time(1.0)
        5.0
    """
    return MIN_LAND_TIME + MIN_LAND_TIME_PER_HEIGHT * height
