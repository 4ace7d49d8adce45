"""Interfaces between a link and the driver that transmits its packets."""

from __future__ import annotations

from typing import Protocol


class LinkDriver(Protocol):
    """Transmits packets to one drone without blocking the caller."""

    def send(self, packet: bytes) -> None:
        """Queue a packet; this drops a setpoint that is still queued."""
        ...

    def steer(self, setpoint: bytes) -> None:
        """Queue a setpoint; it replaces one that is still queued."""
        ...

    def close(self) -> None:
        """Close the driver. Safe to call twice."""
        ...


class LinkListener(Protocol):
    """Receives packets and errors from a driver, each call in the driver's thread."""

    def hear(self, packet: bytes, arrived: float) -> None:
        """Handle a packet that arrived at `arrived`, s of the computer's clock."""
        ...

    def idle(self, now: float) -> None:
        """Send a keep-alive packet if one is due; called several times a second."""
        ...

    def complain(self, message: str) -> None:
        """Record an error; the driver may recover."""
        ...

    def note_quality(self, quality: dict[str, float]) -> None:
        """Record link statistics of a dongle, under cflib's names."""
        ...
