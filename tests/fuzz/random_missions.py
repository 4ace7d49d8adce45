"""Draws valid missions of several agents from the whole language, in random worlds."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tests.fuzz.harness import Draw
from tests.fuzz.random_steps import Author, Infeasible, yaml_text
from tests.fuzz.random_worlds import Data, Room

REACTS: Final = 0.15  # share of the missions with a reaction
LOCALIZERS: Final = ("exact", "flow", "apriltag")
NAMED: Final = 0.3  # share of the missions that name numbers, and of the numbers that stay


@dataclass(frozen=True)
class RandomMission:
    """A mission, its world, and other files.

    Attributes:
        mission: As its file has it.
        world: As its file has it.
        files: Text of other files by name.
    """

    mission: Mapping[str, Any]
    world: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write all files to a folder; return the path of the mission."""
        for name, text in self.files.items():
            (folder / name).write_text(text)
        (folder / "world.yaml").write_text(yaml_text(self.world))
        (folder / "mission.yaml").write_text(yaml_text(self.mission))
        return folder / "mission.yaml"


def random_mission(
    draw: Draw, *, agents: int = 12, steps: int = 5, rate: int = 20
) -> RandomMission:
    """Draw a mission.

    Args:
        draw: Source of all that is random.
        agents: Greatest number of agents.
        steps: Greatest number of steps between take-off and landing.
        rate: Of the control loop, Hz.
    """
    n = draw.randint(2, agents)
    localizer = draw.choice(LOCALIZERS)
    room, author = _begun(draw, n, localizer)
    body = author.body(draw.randint(1, steps))
    planners = (
        ["straight", "visibility"] if not room.obstacles else ["visibility"] * 3 + ["straight"]
    )
    transport: Data = {"use": "sim"}
    if localizer == "exact":
        transport |= {"profile": "ideal", "controller": "ideal", "noise": False}
    transport["camera"] = {"mode": "geometric" if author.cameras or room.landmarks else "off"}
    mission: Data = {
        "star": 1,
        "name": "random",
        "world": "world.yaml",
        "rate": rate,
        "seed": draw.randrange(10000),
        "swarm": {
            name: {"start": list(start), "yaw_deg": draw.randrange(-180, 180, 15)}
            | ({"camera": "aideck"} if author.cameras or room.landmarks else {})
            for name, start in author.start.items()
        },
        "groups": {"team": author.names[: max(2, n // 2)]},
        "transport": transport,
        "localizer": "apriltag" if localizer == "apriltag" else "flow",
        "planner": draw.choice(planners),
        "avoider": draw.choice(["orca"] * 6 + ["voronoi", "potential"]),
    }
    if author.reserve:
        mission["reserve"] = {"agents": author.reserve, "relieve_below": 3.0}
    if draw.random() < REACTS:
        mission["on"] = [author.reaction()]
    names: Data = {}
    if draw.random() < NAMED:
        body = _named(draw, body, names)
        mission["let"] = names
    return RandomMission(mission | {"mission": body}, room.world(), author.files)


def _named(draw: Draw, value: Any, names: Data) -> Any:
    """Return steps with the same numbers, some of them by names, which are added to `names`."""
    if isinstance(value, dict):
        return {key: _named(draw, item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [_named(draw, item, names) for item in value]
    if isinstance(value, bool) or not isinstance(value, int | float) or draw.random() < NAMED:
        return value
    name = f"n{len(names)}"
    names[name] = value
    forms = [f"${name}", f"$({name})", f"$(2 * {name} - {name})", f"$(-(-{name}) * 2 / 2)"]
    return draw.choice(forms)


def _begun(draw: Draw, agents: int, localizer: str) -> tuple[Room, Author]:
    """Return a room in which so many agents can start."""
    while True:
        room = Room(draw, agents, localizer=localizer)
        with suppress(Infeasible):
            return room, Author(draw, room, agents)
