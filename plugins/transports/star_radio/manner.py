"""How drones are to be connected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from star_radio.tables import Tables


@dataclass(frozen=True, slots=True)
class Manner:
    """How drones are to be connected.

    Attributes:
        tables: Of contents, kept from one flight to the next.
        period: Time between two reports, s.
        patience: After which a drone that does not answer is absent, s.
        deadline: After which one that answers slowly is given up, s.
        reset: Whether its estimator starts anew where it stands.
        parameters: What to set, by ``group.name``.
    """

    tables: Tables
    period: float
    patience: float = 2.0
    deadline: float = 30.0
    reset: bool = True
    parameters: Mapping[str, float] = field(default_factory=dict)
