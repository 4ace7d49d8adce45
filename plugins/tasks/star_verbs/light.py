"""The verb ``light``: sets the color of the drones' light decks."""

from __future__ import annotations

from typing import Final

from star_core import Estimate, Health, Scene, Status, TaskOutput
from star_verbs.specs import COLORS

TIMEOUT: Final = 5.0  # s
SOLID_COLOR: Final = 7  # effect of the ring of LEDs
COLOR_DECKS: Final = ("colorLedBot.wrgb8888", "colorLedTop.wrgb8888")


class Light:
    """Sets the firmware's parameters of the ring of LEDs and of both color decks.

    Drones without such a deck, and simulations, show nothing.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, color: str) -> None:
        rgb = int(COLORS.get(color, color)[1:], 16)
        red, green, blue = rgb.to_bytes(3, "big")
        solid = {"ring.solidRed": red, "ring.solidGreen": green, "ring.solidBlue": blue}
        self._parameters = {"ring.effect": SOLID_COLOR, **solid, **dict.fromkeys(COLOR_DECKS, rgb)}

    def begin(self, estimate: Estimate, health: Health) -> float:
        return TIMEOUT

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        return TaskOutput(status=Status.SUCCESS, parameters=self._parameters)
