"""Options of simulated receivers of a positioning system: ``sim``'s option ``onboard``."""

from __future__ import annotations

from typing import Any

OPTIONS: dict[str, Any] = {
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
