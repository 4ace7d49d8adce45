"""The operator's controls of a flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable


@runtime_checkable
class Paced(Protocol):
    """A transport that simulates at a pace, which changes nothing but the duration of the flight.

    Attributes:
        speed: Mission seconds per second of wall time; None is as fast as possible. It may be set
            at any time, by any thread.
    """

    speed: float | None


@dataclass(slots=True)
class Operator:
    """The operator's controls of a flight; observers receive them, and may use them in any thread.

    Attributes:
        stops: Requests to end the flight: the first lands all agents, the second stops the motors.
        simulation: Its ``speed`` can be changed during the flight; None if mission time advances by
            itself, or as the transport likes.
        report: ``report(kind, text, agent, details)`` records an event; the last two may be
            omitted. It does nothing before the flight.
        recording: Whether the end of the flight is being recorded, which must not be interrupted.
        await_landings: Return once no drone may be in the air that the transport can still land
            after the flight, or when that is given up; for the caller of the flight, which may
            interrupt it.
        lost: What observers were to record and could not, with the reason: they add it. ``star
            run`` prints it at its end, with exit status 1.
    """

    stops: int = 0
    simulation: Paced | None = None
    report: Callable[..., None] = lambda *_event: None
    recording: bool = False
    await_landings: Callable[[], None] = lambda: None
    lost: list[str] = field(default_factory=list)

    def land_all(self) -> None:
        """Land all agents, and end the flight."""
        self.stops = max(self.stops, 1)

    def stop_motors(self) -> None:
        """Stop the motors of all agents, wherever they are, and end the flight."""
        self.stops = max(self.stops, 2)
