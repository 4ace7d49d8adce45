"""Faults of radio links: packet loss, duplicates, delay, jitter and cuts, reproducible by a seed.

`star_fleet.server.Fleet` applies them to its UDP links, in both directions; links over TCP,
which delivers every packet in order, have none.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, TypeAlias

import numpy as np

from star_core.toolkit import Fault

GRAIN: Final = 1e-6  # s, by which sums of times may be off

Deliver: TypeAlias = Callable[[], object]
"""Hands a packet to its receiver."""


class Direction(IntEnum):
    """Where a packet goes; each direction of a link draws its own random numbers."""

    TO_VEHICLE = 0
    TO_CLIENT = 1


@dataclass(frozen=True, slots=True)
class LinkFaults:
    """What happens to the packets of a link, each way, independently for each packet.

    Attributes:
        loss: Probability that a packet is lost, 0 to 1.
        duplicates: Probability that a packet that is not lost arrives twice, 0 to 1.
        delay: Of every packet, s of simulated time.
        jitter: Greatest additional delay, s, uniformly distributed: packets may overtake others.
        cuts: Intervals of simulated time, (from, to), s; packets that are sent in one are lost.
    """

    loss: float = 0.0
    duplicates: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    cuts: tuple[tuple[float, float], ...] = ()

    def with_fault(self, fault: Fault) -> LinkFaults:
        """Return these faults and that of a fault file: off, delayed or intermittent."""
        values = fault.values
        match fault.mode:
            case "delayed":
                return replace(self, delay=values["delay"], jitter=values["jitter"])
            case "intermittent":
                return replace(self, loss=values["loss"], duplicates=values["duplicates"])
        return replace(self, loss=1.0)

    def arrivals(self, sent: float, random: np.random.Generator) -> list[float]:
        """Return when the copies of a packet arrive that is sent at a time, s; none if it is lost.

        >>> LinkFaults(delay=0.5, cuts=((2.0, 3.0),)).arrivals(1.0, np.random.default_rng(0))
        [1.5]
        >>> LinkFaults(delay=0.5, cuts=((2.0, 3.0),)).arrivals(2.0, np.random.default_rng(0))
        []
        """
        lost, twice, *extra = random.random(4).tolist()
        if lost < self.loss or any(begin <= sent < end for begin, end in self.cuts):
            return []
        copies = 2 if twice < self.duplicates else 1
        return [sent + self.delay + self.jitter * share for share in extra[:copies]]


NO_FAULTS: Final = LinkFaults()


class FaultyLinks:
    """The links of a swarm, with the packets that are on their way.

    For use by one thread, except that `faults` may be replaced at any time.

    Attributes:
        faults: Of each link; none at first.
    """

    def __init__(self, n: int, seed: int) -> None:
        self.faults = [NO_FAULTS] * n
        self._random = [
            [np.random.default_rng([seed, row, direction]) for direction in Direction]
            for row in range(n)
        ]
        self._under_way: list[tuple[float, int, Deliver]] = []  # a heap by time of arrival, s
        self._number = itertools.count()  # keeps packets of the same arrival in order

    def send(self, row: int, direction: Direction, now: float, deliver: Deliver) -> None:
        """Carry a packet that is sent at `now`, s; without a delay it is delivered at once."""
        faults = self.faults[row]
        if faults == NO_FAULTS and not self._under_way:
            deliver()
            return
        for due in faults.arrivals(now, self._random[row][direction]):
            heapq.heappush(self._under_way, (due, next(self._number), deliver))
        self.deliver(now)

    def deliver(self, now: float) -> None:
        """Deliver the packets that arrive by `now`, s."""
        while self._under_way and self._under_way[0][0] <= now + GRAIN:
            heapq.heappop(self._under_way)[2]()
