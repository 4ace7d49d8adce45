"""Crazyswarm2's ``crazyflies.yaml``: robots, their links and where they stand."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from star_core import InputError
from star_import.located import Value
from star_import.notes import Notes, show

READ: Final = ("enabled", "uri", "initial_position", "type")
NAME: Final = re.compile(r"(?!all$)[A-Za-z][A-Za-z0-9_-]*")  # as the schema of missions has it


@dataclass(frozen=True, slots=True)
class Robot:
    """One agent: its name, where it stands, m, its link if known, and where that is said."""

    name: str
    start: tuple[float, float, float]
    uri: str
    place: str


def robots(file: Value, notes: Notes) -> list[Robot]:
    """Return the robots that are enabled; those that cannot be said are problems of `notes`.

    Args:
        file: The file, with a map under ``robots``.
        notes: Told what was assumed and left out.

    Raises:
        InputError: There is none.
    """
    found: list[Robot] = []
    types = file.map()["robot_types"].map() if "robot_types" in file.map() else {}
    for name, given in file.need("robots").map().items():
        with notes.collected():
            if "enabled" in given.map() and not given.map()["enabled"].flag():
                notes.say(given.place, f"{name} is not enabled; left out")
                continue
            found.append(_robot(name, given, notes))
            kind = given.map().get("type")
            if types and kind is not None and kind.text() not in types:
                raise kind.wrong(f"no type {kind.text()!r} among {', '.join(types)}")
    for name, kind in types.items():
        with notes.collected():
            _told(name, kind, notes)
    for key, value in file.map().items():
        if key not in {"robots", "robot_types"}:
            notes.say(value.place, f"{key!r} is nothing that a mission says; left out")
    if not found and not notes.problems:
        raise file.need("robots").wrong("no robot is enabled")
    return found


def given_on_the_command_line(texts: Sequence[str]) -> list[Robot]:
    """Return the agents of ``--agent NAME=X,Y`` or ``NAME=X,Y,Z``.

    Raises:
        InputError: One of them is written otherwise.
    """
    found = []
    for text in texts:
        name, _, numbers = text.partition("=")
        try:
            x, y, *more = (float(number) for number in numbers.split(","))
            (z,) = more or (0.0,)
        except ValueError:
            name = ""
        if not NAME.fullmatch(name):
            raise InputError([f"--agent {text}: expected NAME=X,Y or NAME=X,Y,Z in m"])
        found.append(Robot(name, (x, y, z), "", f"--agent {text}"))
    return found


def _robot(name: str, given: Value, notes: Notes) -> Robot:
    if not NAME.fullmatch(name):
        raise given.wrong(
            f"{name!r} cannot be an agent's name, expected a letter, then letters, digits, "
            "'_' and '-', and not 'all'"
        )
    place = given.need("initial_position")
    try:
        x, y, z = place.numbers()
    except ValueError:
        raise place.wrong(f"{name} has {len(place.list())} numbers, expected x, y and z") from None
    uri = given.map()["uri"].text() if "uri" in given.map() else ""
    notes.say(given.place, f"{name} stands at {show([x, y, z])} m, yaw 0 degrees")
    for key, value in given.map().items():
        if key not in READ:
            notes.say(value.place, f"{name}: {key!r} is nothing that a mission says; left out")
    return Robot(name, (x, y, z), uri, given.place)


def _told(name: str, kind: Value, notes: Notes) -> None:
    for key, value in kind.map().items():
        if key == "motion_capture" and value.map().get("enabled", value).data is True:
            notes.say(
                value.place,
                f"type {name}: motion capture is left out; the localizer is one that needs none",
            )
        elif key == "battery":
            for inner, volt in value.map().items():
                if inner == "voltage_critical":
                    notes.say(
                        volt.place,
                        f"type {name}: {inner} {show(volt.number())} V does nothing in "
                        "Crazyswarm2; to land below it, add "
                        f"safety: {{battery_low: {{below: {show(volt.number())}}}}}",
                    )
                else:
                    notes.say(
                        volt.place,
                        f"type {name}: {inner!r} is nothing that a mission says; left out",
                    )
        else:
            notes.say(value.place, f"type {name}: {key!r} is nothing that a mission says; left out")
