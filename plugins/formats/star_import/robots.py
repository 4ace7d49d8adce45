"""Crazyswarm2's ``crazyflies.yaml``: robots, their links and their start positions."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from star_core import InputError
from star_core.formats import Value
from star_import import firmware
from star_import.import_log import NOT_SUPPORTED, ImportLog, show

READ: Final = (
    "enabled",
    "uri",
    "initial_position",
    "initial_quaternion",
    "type",
    "ip_add",
    "port",
    firmware.KEY,
)
HOST: Final = re.compile(r"[A-Za-z0-9.-]+")
PORT: Final = 5000  # default port of an AI-deck's image stream
LAST_PORT: Final = 65535
LEVEL: Final = 1.0  # degrees, the largest tilt of a start that is not reported
SYSTEMS: Final = {"lighthouse.": "Lighthouse", "loco.": "the Loco positioning system"}
NAME: Final = re.compile(r"(?!all$)[A-Za-z][A-Za-z0-9_-]*")  # as in the mission schema


@dataclass(frozen=True, slots=True)
class Robot:
    """One agent.

    Attributes:
        name: Name of the agent.
        start: Position, m.
        uri: Address of its link; empty if not given.
        location: Source location, ``file:line:col``.
        yaw_deg: Heading at the start, degrees.
        deck: Host, or ``host:port``, of its AI-deck's image stream; empty if not given.
    """

    name: str
    start: tuple[float, float, float]
    uri: str
    location: str
    yaw_deg: float = 0.0
    deck: str = ""


def robots(file: Value, log: ImportLog) -> list[Robot]:
    """Return the enabled robots; invalid ones are added to the problems of `log`.

    Args:
        file: The file, with a map under ``robots``.
        log: Log of assumptions and ignored entries.

    Raises:
        InputError: There are none.
    """
    enabled: list[Robot] = []
    types = file.map()["robot_types"].map() if "robot_types" in file.map() else {}
    for name, spec in file.need("robots").map().items():
        with log.collected():
            if "enabled" in spec.map() and not spec.map()["enabled"].flag():
                log.add(spec.begins_at, f"{name} is not enabled; ignored")
                continue
            enabled.append(_robot(name, spec, [robot.deck for robot in enabled], log))
            kind = spec.map().get("type")
            if types and kind is not None and kind.text() not in types:
                raise kind.wrong(f"no type {kind.text()!r} among {', '.join(types)}")
    for name, kind in types.items():
        with log.collected():
            _log_type(name, kind, log)
    if "all" in file.map():
        log.ignored(file.map()["all"], {firmware.KEY}, "all: ", NOT_SUPPORTED)
    log.ignored(file, {"all", "robots", "robot_types", "fileversion"}, why=NOT_SUPPORTED)
    if not enabled and not log.problems:
        raise file.need("robots").wrong("no robot is enabled")
    return enabled


def positioning(file: Value, names: Sequence[str], parameters: Sequence[str]) -> str:
    """Return the system that localized the robots; empty if the file names none.

    Args:
        file: The file, with a map under ``robots``.
        names: Names of the enabled robots.
        parameters: Names of the firmware parameters that are set.
    """
    types = file.map()["robot_types"].map() if "robot_types" in file.map() else {}
    for name in names:
        kind = file.need("robots").map()[name].map().get("type")
        of_type = types.get(kind.text()) if kind is not None else None
        capture = of_type.map().get("motion_capture") if of_type is not None else None
        if capture is not None and _is_used(capture):
            return "motion capture"
    for start, system in SYSTEMS.items():
        if any(parameter.startswith(start) for parameter in parameters):
            return system
    return ""


def command_line_agents(texts: Sequence[str], option: str) -> list[Robot]:
    """Return the agents of ``NAME=X,Y`` or ``NAME=X,Y,Z``, values of an option.

    Raises:
        InputError: One of them has another form.
    """
    agents = []
    for text in texts:
        name, _, numbers = text.partition("=")
        try:
            x, y, *more = (float(number) for number in numbers.split(","))
            (z,) = more or (0.0,)
        except ValueError:
            name = ""
        if not NAME.fullmatch(name):
            raise InputError([f"{option}{text}: expected NAME=X,Y or NAME=X,Y,Z in m"])
        agents.append(Robot(name, (x, y, z), "", f"{option}{text}"))
    return agents


def _robot(name: str, spec: Value, decks: Sequence[str], log: ImportLog) -> Robot:
    if not NAME.fullmatch(name):
        raise spec.wrong(
            f"{name!r} cannot be an agent's name, expected a letter, then letters, digits, "
            "'_' and '-', and not 'all'"
        )
    start = spec.need("initial_position")
    try:
        x, y, z = start.numbers()
    except ValueError:
        raise start.wrong(f"{name} has {len(start.list())} numbers, expected x, y and z") from None
    uri = spec.map()["uri"].text() if "uri" in spec.map() else ""
    yaw = _yaw_deg(name, spec.map().get("initial_quaternion"), log)
    log.add(spec.begins_at, f"{name} starts at {show([x, y, z])} m, yaw {show(yaw)} degrees")
    deck = _deck(name, spec)
    if deck and deck in decks:
        log.add(
            spec.map()["ip_add"].begins_at,
            f"{name}: the AI-deck at {deck} belongs to another agent already; ignored",
        )
        deck = ""
    log.ignored(spec, READ, f"{name}: ", NOT_SUPPORTED)
    return Robot(name, (x, y, z), uri, spec.begins_at, yaw, deck)


def _yaw_deg(name: str, quaternion: Value | None, log: ImportLog) -> float:
    """Return the heading of a quaternion x, y, z, w, degrees; log a tilt."""
    if quaternion is None:
        return 0.0
    numbers = quaternion.numbers()
    length = math.hypot(*numbers)
    if len(numbers) != 4 or not length:  # noqa: PLR2004 -- a quaternion
        raise quaternion.wrong(f"{name} has {list(numbers)}, expected a quaternion x, y, z, w")
    x, y, z, w = (number / length for number in numbers)
    tilt = math.degrees(math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y)))))
    if tilt > LEVEL:
        log.add(
            quaternion.begins_at,
            f"{name}: initial_quaternion is tilted by {tilt:.0f} degrees; agents start level, so "
            "only its yaw is used",
        )
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def _deck(name: str, spec: Value) -> str:
    """Return the address of a robot's AI-deck; empty if it has none."""
    if "ip_add" not in spec.map():
        return ""
    host = spec.map()["ip_add"].text()
    if not HOST.fullmatch(host):
        raise spec.map()["ip_add"].wrong(f"{name} has {host!r}, expected a host")
    if "port" not in spec.map():
        return host
    port = spec.map()["port"].number()
    if not 0 < port <= LAST_PORT or port != int(port):
        raise spec.map()["port"].wrong(f"{name} has {port:g}, expected a port")
    return host if port == PORT else f"{host}:{port:.0f}"


def _is_used(capture: Value) -> bool:
    """Whether robots of a type are localized by motion capture, in both versions of the format."""
    enabled, tracking = (capture.map().get(key) for key in ("enabled", "tracking"))
    if enabled is not None and enabled.data is False:
        return False
    return tracking is None or tracking.data != "none"


def _log_type(name: str, kind: Value, log: ImportLog) -> None:
    read = {"motion_capture", "battery", firmware.KEY}
    log.ignored(kind, read, f"type {name}: ", NOT_SUPPORTED)
    if "battery" not in kind.map():
        return
    battery = kind.map()["battery"]
    if "voltage_critical" in battery.map():
        voltage = battery.map()["voltage_critical"]
        volts = show(voltage.number())
        log.add(
            voltage.begins_at,
            f"type {name}: voltage_critical {volts} V has no effect in Crazyswarm2; to land below "
            f"it, add safety: {{battery_low: {{below: {volts}}}}}",
        )
    log.ignored(battery, {"voltage_critical"}, f"type {name}: ", NOT_SUPPORTED)
