"""What carries a link's packets, and what it tells the link."""

from __future__ import annotations

from typing import Protocol


class Wire(Protocol):
    """Carries packets to one drone; nobody who gives it one waits."""

    def send(self, packet: bytes) -> None:
        """Send a packet after those before it; a setpoint that still waits is void."""
        ...

    def steer(self, setpoint: bytes) -> None:
        """Send a setpoint in place of one that still waits."""
        ...

    def close(self) -> None:
        """Carry no more. Safe to call twice."""
        ...


class Ear(Protocol):
    """Whom a wire tells what comes, each call in the wire's own thread."""

    def hear(self, packet: bytes, arrived: float) -> None:
        """Take a packet that arrived, s of the computer's clock."""
        ...

    def idle(self, now: float) -> None:
        """Look whether something is to be said, some times a second."""
        ...

    def complain(self, message: str) -> None:
        """Note what went wrong; the wire may well recover."""
        ...

    def note_quality(self, quality: dict[str, float]) -> None:
        """Note what a dongle says of the link, by cflib's names."""
        ...
