"""Options for connecting drones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from star_radio.tables import Tables


@dataclass(frozen=True, slots=True)
class ConnectionOptions:
    """Options for connecting drones.

    Attributes:
        tables: Cached tables of contents.
        report_period: Time between two state reports, s.
        response_timeout: Time to wait for an answer before a drone counts as absent, s.
        connect_timeout: Time within which a drone must be fully connected, s.
        reset: Whether to reset the on-board estimator.
        parameters: Firmware parameters to set, by ``group.name``.
    """

    tables: Tables
    report_period: float
    response_timeout: float = 2.0
    connect_timeout: float = 30.0
    reset: bool = True
    parameters: Mapping[str, float] = field(default_factory=dict)
