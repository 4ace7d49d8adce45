"""Options of simulated positioning systems: ``sim``'s ``positioning`` and ``onboard``."""

from __future__ import annotations

from typing import Any

from star_core.toolkit import number, positive

POSITIONING: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "description": "A positioning system that measures the positions of all drones in the map, for "
    "localizer `mocap`; none if not given.",
    "examples": [{"std": 0.03, "dropout_rate": 0.05}],
    "properties": {
        "std": number(
            "Standard deviation of the error along each axis, m.",
            minimum=0,
            maximum=10,
            default=0.01,
        ),
        "yaw_std_deg": {
            "type": ["number", "null"],
            "minimum": 0,
            "maximum": 180,
            "default": 1.0,
            "description": "Standard deviation of headings, independent in each measurement, "
            "degrees; null measures positions only.",
        },
        "correlation_time": number(
            "Time constant with which the error of a position changes, s; 0 makes those of two "
            "measurements independent.",
            minimum=0,
            maximum=3600,
            default=1.0,
        ),
        "rate": positive("Measurements of each drone, 1/s.", maximum=100, default=20.0),
        "latency": number(
            "Time from a measurement to its arrival, s.", minimum=0, maximum=2, default=0.02
        ),
        "jitter": number(
            "Standard deviation of further delay, which differs from one measurement to the next, "
            "s.",
            minimum=0,
            maximum=1,
            default=0.0,
        ),
        "timestamps": {
            "type": "boolean",
            "default": True,
            "description": "Whether measurements carry their times.",
        },
        "markers": {
            "type": "boolean",
            "default": False,
            "description": "Whether the system sees one marker on each drone, without a name or a "
            "heading.",
        },
        "dropout_rate": number(
            "Mean number of dropouts of each drone, 1/s.", minimum=0, maximum=100, default=0.0
        ),
        "dropout_time": positive("Duration of a dropout, s.", maximum=3600, default=1.0),
    },
}

ONBOARD: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["system"],
    "description": "A positioning system whose receivers are on board, for localizer `onboard`; "
    "none if not given.",
    "examples": [{"system": "lighthouse"}],
    "properties": {
        "system": {
            "enum": ["lighthouse", "loco", "poses"],
            "description": "'lighthouse' or 'loco', with the base stations or anchors of the "
            "world, or 'poses' that another program sends.",
        },
        "flow_deck": {
            "type": "boolean",
            "default": True,
            "description": "Whether a Flow deck measures heights and velocities too; without, they "
            "are those of the positioning system and the IMU.",
        },
    },
}
