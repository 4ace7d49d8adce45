"""The avoider `gentle`: everybody flies a share of what is wanted."""

from __future__ import annotations

from dataclasses import replace

from star_core import Estimate, Setpoint


class Gentle:
    """Avoids nobody, but slowly.

    Args:
        share: Share of the wanted velocity to fly, 0 to 1.
    """

    def __init__(self, share: float) -> None:
        self._share = share

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        return replace(wanted, velocity=self._share * wanted.velocity)
