"""What to keep of a flight so that it can be flown again."""

from __future__ import annotations

import platform
import re
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from star_core.mission import Mission

DISTRIBUTION = "star-swarm"


def manifest(mission: Mission) -> dict[str, Any]:
    """Return the mission and world as flown, its plugins, its seed, and the software beneath."""
    return {
        "mission_file": str(mission.document.path),
        "mission": mission.document.data,
        "world_file": str(mission.world.path),
        "world": mission.world.data,
        "seed": mission.scene.seed,
        "plugins": {
            kind: {
                "name": part.use,
                "options": dict(part.options),
                "plugin": part.source.plugin,
                "version": part.source.version,
            }
            for kind, part in mission.parts.items()
        },
        "packages": packages(),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def packages() -> dict[str, str]:
    """Versions of this project and of what it is built on."""
    needed = (line for line in requires(DISTRIBUTION) or () if "extra ==" not in line)
    names = [DISTRIBUTION, *(re.split(r"[ <>=~!;\[]", line)[0] for line in needed)]
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
