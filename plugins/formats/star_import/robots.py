"""Robots of Crazyswarm2's ``crazyflies.yaml`` and of Crazyswarm's ``allCrazyflies.yaml``."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from star_core import InputError
from star_core.formats import Value
from star_core.toolkit import shortlist
from star_import import firmware
from star_import.import_log import NOT_SUPPORTED, ImportLog

READ: Final = (
    "enabled",
    "uri",
    "initial_position",
    "initial_quaternion",
    "type",
    "ip_add",
    "port",
    "connection",
    "motion_capture",
    *firmware.KEYS,
)
HOST: Final = re.compile(r"[A-Za-z0-9.-]+")
URI: Final = re.compile(r"(radio://)\*(/.*)")
PORT: Final = 5000  # default port of an AI-deck's image stream
LAST_PORT: Final = 65535
LEVEL: Final = 1.0  # degrees, the largest tilt of a start that is not reported
SYSTEMS: Final = {"lighthouse.": "Lighthouse", "loco.": "the Loco positioning system"}
NAME: Final = re.compile(r"(?!all$)[A-Za-z][A-Za-z0-9_-]*")  # as in the mission schema
VOLTAGES: Final = ("voltage_critical", "batteryVoltageCritical", "batteryVoltateCritical")


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
        parameters: Firmware parameters by ``group.name``.
        tracked: Whether motion capture measures its position.
        marker: Name of the configuration of its markers; empty if not given.
    """

    name: str
    start: tuple[float, float, float]
    uri: str
    location: str
    yaw_deg: float = 0.0
    deck: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    tracked: bool = False
    marker: str = ""


def robots(file: Value, types: Value | None, log: ImportLog) -> list[Robot]:
    """Return the enabled robots; invalid ones are added to the problems of `log`.

    Args:
        file: With a map under ``robots``, or with Crazyswarm's list under ``crazyflies``.
        types: Crazyswarm's ``crazyflieTypes.yaml``, if there is one.
        log: Log of assumptions and ignored entries.

    Raises:
        InputError: There are none.
    """
    if "robots" not in file.map():
        return _of_crazyswarm(file, types, log)
    enabled: list[Robot] = []
    of_type = file.map()["robot_types"].map() if "robot_types" in file.map() else {}
    of_all = file.map().get("all")
    listed = file.need("robots")
    for name, spec in listed.map().items():
        with log.collected():
            if "enabled" in spec.map() and not spec.map()["enabled"].flag():
                log.ignored(spec.begins_at, "is not enabled", name)
                continue
            kind = spec.map().get("type")
            if of_type and kind is not None and kind.text() not in of_type:
                raise kind.wrong(f"no type {kind.text()!r} among {', '.join(of_type)}")
            its_type = None if kind is None else of_type.get(kind.text())
            if not _is_connected(spec, its_type):
                text = "has no connection: it is a marker for motion capture, not an agent"
                log.ignored(spec.begins_at, text, name)
                continue
            levels = (of_all, its_type, spec)
            decks = [robot.deck for robot in enabled]
            enabled.append(_robot(name, spec, levels, decks, log))
    for name, kind in of_type.items():
        with log.collected():
            _log_type(name, kind, log)
    if of_all is not None:
        log.ignore_keys(of_all, firmware.KEYS, "all.", NOT_SUPPORTED)
    log.ignore_keys(file, {"all", "robots", "robot_types", "fileversion"}, why=NOT_SUPPORTED)
    return _checked(enabled, listed, log)


def positioning(swarm: Sequence[Robot]) -> str:
    """Return the system by which robots were localized, apart from motion capture, or nothing."""
    names = {name for robot in swarm for name in robot.parameters}
    return next((system for start, system in SYSTEMS.items()
                 if any(name.startswith(start) for name in names)), "")  # fmt: skip


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


def _of_crazyswarm(file: Value, types: Value | None, log: ImportLog) -> list[Robot]:
    """Return the robots of Crazyswarm: ``crazyflies: [{id, channel, initialPosition, type}]``."""
    enabled: list[Robot] = []
    listed = file.need("crazyflies")
    kinds = {} if types is None else types.need("crazyflieTypes").map()
    for spec in listed.list():
        with log.collected():
            number, channel = (spec.need(key).number() for key in ("id", "channel"))
            if number != int(number) or not 0 <= number <= 0xFF:  # noqa: PLR2004 -- a byte
                raise spec.need("id").wrong(f"{number:g}, expected a whole number from 0 to 255")
            kind = spec.map().get("type")
            if kinds and kind is not None and kind.text() not in kinds:
                raise kind.wrong(f"no type {kind.text()!r} among {', '.join(kinds)}")
            its_type = None if kind is None else kinds.get(kind.text())
            enabled.append(
                Robot(
                    name=f"cf{number:.0f}",
                    start=_position(f"cf{number:.0f}", spec.need("initialPosition")),
                    uri=f"radio://0/{channel:.0f}/2M/E7E7E7E7{int(number):02X}",
                    location=spec.begins_at,
                    parameters=firmware.parameters((its_type, spec)),
                    tracked=True,
                )
            )
            read = {"id", "channel", "initialPosition", "type", *firmware.KEYS}
            log.ignore_keys(spec, read, "crazyflies.", NOT_SUPPORTED)
    if enabled:
        text = "links have 2 Mbit/s, the first dongle and the address E7E7E7E7 with the id"
        log.assumed(listed.begins_at, text)
    for name, kind in kinds.items():
        with log.collected():
            _log_type(name, kind, log)
    log.ignore_keys(file, {"crazyflies"}, why=NOT_SUPPORTED)
    if types is not None:
        log.ignore_keys(types, {"crazyflieTypes"}, why=NOT_SUPPORTED)
    return _checked(enabled, listed, log)


def _checked(enabled: list[Robot], listed: Value, log: ImportLog) -> list[Robot]:
    if not enabled and not log.problems:
        raise listed.wrong("no robot is enabled")
    stars = [robot for robot in enabled if URI.fullmatch(robot.uri)]
    if stars:
        link = URI.fullmatch(stars[0].uri)
        suggestion = f"{link[1]}0{link[2]}" if link else ""
        log.changed(
            stars[0].location,
            "'radio://*' takes any dongle, which STAR's transport `radio` does not; links have no "
            f"uri: name a dongle, as in {suggestion}",
            shortlist(robot.name for robot in stars),
        )
    return enabled


def _is_connected(spec: Value, kind: Value | None) -> bool:
    """Return whether a robot is one that is commanded."""
    for level in (spec, kind):
        if level is not None and (connection := level.map().get("connection")) is not None:
            return connection.data is not None and connection.data != "none"
    return True


def _robot(
    name: str,
    spec: Value,
    levels: tuple[Value | None, Value | None, Value],
    decks: Collection[str],
    log: ImportLog,
) -> Robot:
    if not NAME.fullmatch(name):
        raise spec.wrong(
            f"{name!r} cannot be an agent's name, expected a letter, then letters, digits, "
            "'_' and '-', and not 'all'"
        )
    position = _position(name, spec.need("initial_position"))
    uri = spec.map()["uri"].text() if "uri" in spec.map() else ""
    yaw = _yaw_deg(name, spec.map().get("initial_quaternion"), log)
    deck = _deck(name, spec)
    if deck and deck in decks:
        where = spec.map()["ip_add"].begins_at
        log.ignored(where, f"the AI-deck at {deck} belongs to another agent already", name)
        deck = ""
    log.ignore_keys(spec, READ, "robots.", NOT_SUPPORTED)
    tracked, marker = _capture(levels)
    return Robot(
        name=name,
        start=position,
        uri=uri,
        location=spec.begins_at,
        yaw_deg=yaw,
        deck=deck,
        parameters=firmware.parameters(levels),
        tracked=tracked,
        marker=marker,
    )


def _position(name: str, start: Value) -> tuple[float, float, float]:
    try:
        x, y, z = start.numbers()
    except ValueError:
        raise start.wrong(f"{name} has {len(start.list())} numbers, expected x, y and z") from None
    return x, y, z


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
        text = "agents start level: only the yaw of a tilted initial_quaternion is used"
        log.changed(quaternion.begins_at, text, name)
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


def _capture(levels: Sequence[Value | None]) -> tuple[bool, str]:
    """Return whether motion capture measures a robot, and the name of its markers.

    In both versions of the format; what a robot has overrides what its type has.
    """
    merged: dict[str, Value] = {}
    for level in levels:
        if level is not None and "motion_capture" in level.map():
            merged |= level.map()["motion_capture"].map()
    enabled, tracking = (merged.get(key) for key in ("enabled", "tracking"))
    tracked = bool(merged) and (enabled is None or enabled.data is not False)
    tracked = tracked and (tracking is None or tracking.data not in {None, "none"})
    marker = merged["marker"].text() if "marker" in merged else ""
    return tracked, marker


def _log_type(name: str, kind: Value, log: ImportLog) -> None:
    read = {"motion_capture", "battery", "connection", *VOLTAGES, *firmware.KEYS}
    log.ignore_keys(kind, read, "types.", NOT_SUPPORTED)
    battery = kind.map().get("battery", kind)
    for key in VOLTAGES:
        if key in battery.map():
            volts = battery.map()[key].number()
            text = f"safety: {{battery_low: {{below: {volts:g}}}}} lands agents below that voltage"
            log.ignored(battery.map()[key].begins_at, f"{key} has no effect; {text}", name)
    if battery is not kind:
        log.ignore_keys(battery, VOLTAGES, "types.battery.", NOT_SUPPORTED)
