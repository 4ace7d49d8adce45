"""The avoider ``gentle``."""

from dataclasses import replace


class Gentle:
    def __init__(self, share):
        self._share = share

    def avoid(self, estimate, wanted):
        return replace(wanted, velocity=self._share * wanted.velocity)
