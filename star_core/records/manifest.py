"""What to keep of a flight so that it can be flown again."""

from __future__ import annotations

import platform
import re
import shlex
import shutil
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from star_core.mission import Mission, actions
from star_core.plugin_support.registry import Registry

DISTRIBUTION = "star-swarm"


def manifest(mission: Mission, registry: Registry) -> dict[str, Any]:
    """Return the mission, its world and files as flown, plugins, seed, and the software beneath."""
    sources = map(registry.source, sorted(registry.manager.plugins))
    return {
        "mission_file": str(mission.file.path),
        "mission": mission.source,
        "world_file": str(mission.world_file.path),
        "world": mission.world_file.data,
        "files": {
            name: path.read_text(encoding="utf-8", errors="replace")
            for name, path in mission.scene.files.items()
        },
        "seed": mission.scene.seed,
        "plugins": {
            kind: {
                "name": choice.use,
                "options": dict(choice.written),
                "plugin": choice.source.plugin,
                "version": choice.source.version,
            }
            for kind, choice in mission.plugins.items()
        },
        "verbs": {
            action.verb: {"plugin": action.source.plugin, "version": action.source.version}
            for action in actions(mission.all_steps)
        },
        "third_parties": {source.plugin: source.version for source in sources if not source.own},
        **software(),
    }


def software() -> dict[str, Any]:
    """Return the command of this program, its version and those of packages, and the computer.

    ``commit`` is that of the checkout that the program runs from, ``-dirty`` if files in it have
    changed; None if it is installed.
    """
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "commit": _commit(),
        "packages": {**packages()},
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


@cache
def _commit() -> str | None:
    folder = Path(__file__).parents[2]
    git = shutil.which("git")
    if git is None or not (folder / ".git").exists():
        return None
    command = [
        git,
        "-C",
        str(folder),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 -- fixed
    return done.stdout.strip() or None


@cache
def packages() -> dict[str, str]:
    """Versions of this project and of what it is built on."""
    needed = (line for line in requires(DISTRIBUTION) or () if "extra ==" not in line)
    names = [DISTRIBUTION, *(re.split(r"[ <>=~!;\[]", line)[0] for line in needed)]
    versions = {}
    for name in names:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions
