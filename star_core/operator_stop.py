"""The operator's wish to end a flight."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class OperatorStop:
    """How often the operator asked to end the flight: once to land, twice to stop the motors."""

    count: int = 0
